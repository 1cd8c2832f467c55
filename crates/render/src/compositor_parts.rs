//! A compositor with everything made for it alone: bind group layouts, buffers, bindings, pipelines. Slots, tables,
//! targets and frames are common to all compositors, so a renderer with two sets of parts draws the same bricks either
//! way.

use crate::buffer_parts::Ends;
use crate::buffers::{RayBuffers, SharedBuffers};
use crate::layer::GpuLayer;
use crate::layouts::{Layouts, MeshLayouts};
use crate::memory::MemoryPlan;
use crate::pipeline_cache::Pipelines;
use crate::pipelines::Maker;
use crate::pool::Pool;
use crate::raycast::Raycast;
use crate::sorted::Sorted;
use crate::{Compositor, Gpu, GpuError};

/// A compositor with its own layouts, buffers, bindings and pipelines.
#[derive(Debug)]
pub(crate) struct CompositorParts {
    pub(crate) compositor: Compositor,
    pub(crate) layouts: Layouts,
    pub(crate) march: March,
    pub(crate) pipelines: Pipelines,
}

/// A compositor's buffers and bindings; `compute` shares those of `raycast`.
#[derive(Debug)]
pub(crate) enum March {
    Sorted(Sorted),
    Raycast(Raycast),
}

/// The parts of a renderer common to all compositors.
pub(crate) struct Common<'a> {
    pub(crate) shared: &'a SharedBuffers,
    pub(crate) layers: &'a [GpuLayer],
    pub(crate) pools: &'a [Pool],
    pub(crate) ends: &'a Ends,
    pub(crate) memory: &'a MemoryPlan,
    pub(crate) has_gradients: bool,
    /// The layouts of meshes; `None` if pictures never have meshes.
    pub(crate) meshes: Option<MeshLayouts>,
}

impl CompositorParts {
    /// Makes a compositor's parts. Pipelines of `kept`, left by an earlier renderer, are used again if they fit.
    ///
    /// # Errors
    /// If the device refuses the buffers.
    pub(crate) fn new(
        gpu: &Gpu,
        compositor: Compositor,
        common: Common<'_>,
        kept: &mut Vec<Pipelines>,
    ) -> Result<Self, GpuError> {
        let Common { shared, layers, pools, ends, memory, has_gradients, meshes } = common;
        let layouts = Layouts::new(gpu, compositor, pools, has_gradients);
        let march = match compositor {
            Compositor::Sorted => March::Sorted(Sorted::new(gpu, &layouts, shared, layers, pools)?),
            _ => March::Raycast(Raycast::new(gpu, &layouts, shared, layers, pools, ends, memory)?),
        };
        let maker = Maker { gpu: gpu.clone(), compositor, layouts: layouts.clone(), meshes };
        Ok(Self { compositor, layouts, march, pipelines: Pipelines::kept_or_new(kept, maker) })
    }

    /// The buffers for rays; `None` for `sorted`.
    pub(crate) fn rays(&self) -> Option<&RayBuffers> {
        match &self.march {
            March::Sorted(_) => None,
            March::Raycast(raycast) => Some(&raycast.buffers),
        }
    }
}
