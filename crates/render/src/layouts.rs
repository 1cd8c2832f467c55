//! Bind group layouts: one for each kind of pass, shared by all its pipelines.

use crate::pool::Pool;
use crate::{Compositor, Gpu};
use brickyard_shaders::bindings;
use wgpu::{BindGroupLayoutEntry, BindingType, ShaderStages, TextureViewDimension};

/// Bind group layouts shared by all variants.
#[derive(Clone, Debug)]
pub(crate) struct Layouts {
    /// Whether each pool in a march through all layers holds 32-bit floats, and whether stored gradients are bound.
    pub(crate) of: (Vec<bool>, bool),
    /// The layouts of marches through one layer, of codes and of 32-bit floats.
    march: [wgpu::BindGroupLayout; 2],
    pub(crate) joint: wgpu::BindGroupLayout,
    pub(crate) resolve: wgpu::BindGroupLayout,
    pub(crate) joined: wgpu::BindGroupLayout,
}

/// The layouts added by meshes to those of marches and of resolve passes.
#[derive(Clone, Debug)]
pub(crate) struct MeshLayouts {
    pub(crate) limits: wgpu::BindGroupLayout,
    pub(crate) layer: wgpu::BindGroupLayout,
}

fn buffer(ty: wgpu::BufferBindingType) -> BindingType {
    BindingType::Buffer { ty, has_dynamic_offset: false, min_binding_size: None }
}

/// The binding type of a read-only storage buffer.
pub(crate) fn storage() -> BindingType {
    buffer(wgpu::BufferBindingType::Storage { read_only: true })
}

pub(crate) fn texture(view_dimension: TextureViewDimension, filterable: bool) -> BindingType {
    let sample_type = wgpu::TextureSampleType::Float { filterable };
    BindingType::Texture { sample_type, view_dimension, multisampled: false }
}

/// The binding type of a 2D texture with another sample type than colour, such as depth.
pub(crate) fn texture_of(sample_type: wgpu::TextureSampleType) -> BindingType {
    BindingType::Texture { sample_type, view_dimension: TextureViewDimension::D2, multisampled: false }
}

pub(crate) fn bind_group_layout(
    gpu: &Gpu,
    label: &str,
    entries: &[(u32, ShaderStages, BindingType)],
) -> wgpu::BindGroupLayout {
    let entry = |&(binding, visibility, ty): &(_, _, _)| BindGroupLayoutEntry { binding, visibility, ty, count: None };
    let entries: Vec<_> = entries.iter().map(entry).collect();
    let descriptor = wgpu::BindGroupLayoutDescriptor { label: Some(label), entries: &entries };
    gpu.device.create_bind_group_layout(&descriptor)
}

impl Layouts {
    pub(crate) fn new(gpu: &Gpu, compositor: Compositor, pools: &[Pool], has_gradients: bool) -> Self {
        let are_floats: Vec<bool> = pools.iter().map(Pool::is_float).collect();
        let fragment = ShaderStages::FRAGMENT;
        let gathered = (bindings::GATHERED, fragment, texture(TextureViewDimension::D2, false));
        let frames = (bindings::FRAMES, fragment, storage());
        let emission = (bindings::EMISSION, fragment, texture(TextureViewDimension::D2, false));
        let resolve = [frames, (bindings::TABLE, fragment, storage()), gathered];
        Self {
            march: [false, true].map(|is_float| march_layout(gpu, compositor, &[is_float], has_gradients)),
            joint: march_layout(gpu, compositor, &are_floats, has_gradients),
            of: (are_floats, has_gradients),
            resolve: bind_group_layout(gpu, "resolve", &resolve),
            joined: bind_group_layout(gpu, "joined", &[frames, gathered, emission]),
        }
    }

    pub(crate) fn march(&self, is_float: bool) -> &wgpu::BindGroupLayout {
        &self.march[is_float as usize]
    }
}

/// The layout of a march through layers in pools of 32-bit floats or codes. The hardware filters codes only.
fn march_layout(gpu: &Gpu, compositor: Compositor, are_floats: &[bool], has_gradients: bool) -> wgpu::BindGroupLayout {
    let stage = match compositor {
        Compositor::Sorted | Compositor::Raycast => ShaderStages::FRAGMENT,
        Compositor::Compute => ShaderStages::COMPUTE,
    };
    let mut march = vec![
        (bindings::FRAMES, ShaderStages::VERTEX | stage, storage()),
        (bindings::ATLAS_SAMPLER, stage, BindingType::Sampler(wgpu::SamplerBindingType::Filtering)),
        (bindings::TABLE, stage, storage()),
    ];
    let atlases = (bindings::FIRST_ATLAS..).zip(are_floats.iter().map(|is_float| !is_float));
    let gradients = (bindings::FIRST_GRADIENTS..).zip(are_floats.iter().filter(|_| has_gradients).map(|_| true));
    let texture = |(binding, filters)| (binding, stage, texture(TextureViewDimension::D3, filters));
    march.extend(atlases.chain(gradients).map(texture));
    match compositor {
        Compositor::Sorted => march.extend([
            (bindings::CELLS, ShaderStages::VERTEX, storage()),
            (bindings::CELL_BRICKS, ShaderStages::VERTEX | stage, storage()),
        ]),
        Compositor::Raycast | Compositor::Compute => {
            let read = [bindings::BRICKS, bindings::NODES, bindings::RANGES, bindings::OPAQUE_BEFORE];
            march.extend(read.map(|binding| (binding, stage, storage())));
            let written = buffer(wgpu::BufferBindingType::Storage { read_only: false });
            march.extend(gpu.report.feedback.then_some((bindings::MARKS, stage, written)));
        }
    }
    bind_group_layout(gpu, "march", &march)
}
