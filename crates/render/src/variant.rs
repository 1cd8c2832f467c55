//! The shaders needed for a frame: the settings fixed when a pipeline is made.

use crate::frame::Framed;
use brickyard_shaders::{Curve, Gather, JointVariant, Light, Medium, Surfaces, Variant};
use brickyard_volume::{
    Filter, FrameSettings, Gradient, Lighting, LightingModel, Mode, Sampling, SlotEncoding, SlotFormat, sampling,
};

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
    let curve = match method.curve() {
        sampling::Curve::Middle => Curve::Middle,
        sampling::Curve::Line => Curve::Line,
        sampling::Curve::Cubic => Curve::Cubic,
        sampling::Curve::Field => Curve::Field,
    };
    let light = light_of(&frame.lighting);
    let surfaces = match frame.mode {
        Mode::Isosurface => Surfaces::Alone,
        _ if has_surfaces => Surfaces::InFog,
        _ => Surfaces::None,
    };
    // Without a use for gradients, all kinds of gradient share one variant.
    let has_gradients = light != Light::Unlit || surfaces != Surfaces::None || has_grid;
    let gradient = gradient_of(&frame.lighting, has_gradients);
    if surfaces == Surfaces::Alone {
        // Without fog, methods share one too.
        return Medium { light, gradient, surfaces, ..Medium::PLAIN };
    }
    let (parts, is_pre_integrated) = (sampling.parts(0.0) as u32, method.is_pre_integrated());
    Medium { curve, parts, is_pre_integrated, light, gradient, surfaces, has_grid }
}

fn light_of(lighting: &Lighting) -> Light {
    match lighting.model {
        LightingModel::None => Light::Unlit,
        LightingModel::Phong => Light::Phong,
        LightingModel::BlinnPhong => Light::BlinnPhong,
        LightingModel::Tone => Light::Tone,
    }
}

/// The gradient method; the same for all if unused.
fn gradient_of(lighting: &Lighting, is_lit: bool) -> brickyard_shaders::Gradient {
    match lighting.gradient {
        Gradient::Sobel if is_lit => brickyard_shaders::Gradient::Sobel,
        Gradient::Stored if is_lit => brickyard_shaders::Gradient::Stored,
        _ => brickyard_shaders::Gradient::Central,
    }
}

pub(crate) fn filter_of(sampling: Sampling) -> brickyard_shaders::Filter {
    match sampling.filter {
        Filter::Nearest => brickyard_shaders::Filter::Nearest,
        Filter::Trilinear => brickyard_shaders::Filter::Trilinear,
        Filter::Tricubic => brickyard_shaders::Filter::Tricubic,
    }
}

pub(crate) fn variant_of(framed: &Framed<'_>) -> Variant {
    let frame = framed.settings;
    let (gather, sampling) = (gather_of(frame), Sampling { method: frame.method(), ..frame.sampling });
    let medium = match gather {
        Gather::Composite => medium_of(frame, sampling, !frame.surfaces.is_empty(), frame.grid().is_some()),
        Gather::Project | Gather::Average | Gather::Isosurface => Medium::PLAIN,
    };
    let has_meshes = !frame.meshes.is_empty();
    let SlotEncoding { has_invalid, is_labels, format, .. } = frame.encoding;
    Variant {
        gather,
        has_invalid,
        is_labels,
        is_float: format == SlotFormat::F32,
        is_narrow: !frame.encoding.has_whole_table(),
        filter: filter_of(frame.sampling),
        medium,
        has_meshes,
        is_placed: !frame.placement.is_identity(),
        keeps_extremes: frame.keeps_extremes && framed.has_coarse,
    }
}
