//! The shaders needed for a frame: the settings fixed when a pipeline is made.

use crate::frame::Framed;
use brickyard_shaders::{Gather, JointVariant, Medium, Surfaces, Variant, Voxels};
use brickyard_volume::{FrameSettings, Gradient, LightingModel, Mode, Sampling, SlotEncoding, SlotFormat};

/// A march's shader variant: for one layer, or for several together.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub(crate) enum Shader {
    Single(Variant),
    Joint(JointVariant),
}

impl Shader {
    /// Whether the shader draws only a slab between meshes.
    pub(crate) fn has_meshes(&self) -> bool {
        match self {
            Self::Single(variant) => variant.has_meshes,
            Self::Joint(variant) => variant.has_meshes,
        }
    }
}

pub(crate) fn gather_of(frame: &FrameSettings) -> Gather {
    match frame.mode {
        Mode::Mip | Mode::MinIp => Gather::Project,
        Mode::Average => Gather::Average,
        Mode::Isosurface if frame.is_one_opaque_surface() => Gather::Isosurface,
        Mode::Dvr | Mode::Isosurface => Gather::Composite,
    }
}

/// Returns how ray segments become media in a composite with this sampling. `has_surfaces`: whether there are
/// isosurfaces; `has_grid`: whether transfer functions depend on gradients.
pub(crate) fn medium_of(frame: &FrameSettings, sampling: Sampling, has_surfaces: bool, has_grid: bool) -> Medium {
    let method = sampling.method;
    let (curve, light) = (method.curve(), frame.lighting.model);
    let surfaces = match frame.mode {
        Mode::Isosurface => Surfaces::Alone,
        _ if has_surfaces => Surfaces::InFog,
        _ => Surfaces::None,
    };
    // Without a use for gradients, all kinds of gradient share one variant.
    let has_gradients = light != LightingModel::None || surfaces != Surfaces::None || has_grid;
    let gradient = if has_gradients { frame.lighting.gradient } else { Gradient::Central };
    if surfaces == Surfaces::Alone {
        // Without fog, methods share one too.
        return Medium { light, gradient, surfaces, ..Medium::PLAIN };
    }
    let (parts, is_pre_integrated) = (sampling.parts(0.0) as u32, method.is_pre_integrated());
    Medium { curve, parts, is_pre_integrated, light, gradient, surfaces, has_grid }
}

pub(crate) fn voxels_of(encoding: &SlotEncoding) -> Voxels {
    let SlotEncoding { has_invalid, is_labels, format, .. } = *encoding;
    Voxels { has_invalid, is_labels, is_float: format == SlotFormat::F32, is_narrow: !encoding.has_whole_table() }
}

pub(crate) fn variant_of(framed: &Framed<'_>) -> Variant {
    let frame = framed.settings;
    let (gather, sampling) = (gather_of(frame), Sampling { method: frame.method(), ..frame.sampling });
    let medium = match gather {
        Gather::Composite => medium_of(frame, sampling, !frame.surfaces.is_empty(), frame.grid().is_some()),
        Gather::Project | Gather::Average | Gather::Isosurface => Medium::PLAIN,
    };
    let has_meshes = !frame.meshes.is_empty();
    Variant {
        gather,
        voxels: voxels_of(&frame.encoding),
        filter: frame.sampling.filter,
        medium,
        has_meshes,
        is_placed: !frame.placement.is_identity(),
        keeps_extremes: frame.keeps_extremes && framed.has_coarse,
    }
}
