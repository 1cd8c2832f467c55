//! Compositing of layers: the joint look of a picture's layers in one place.
//!
//! **Fog and surfaces** ([`Mode::Dvr`](crate::Mode::Dvr), [`Mode::Isosurface`](crate::Mode::Isosurface)). All layers share one lattice. In each
//! segment a layer renders its part, inside its volume, its crop and the clip, as if alone and by the scene's method: its surfaces cut the part, and
//! each *piece* between them shows a colour and absorbs some light ([`LayerMedium`]). Together, all layers' surfaces cut the segment, in the order
//! of their distances; in each interval between two cuts every layer has its pieces' share, as a medium of the piece's colour spread evenly
//! ([`JointMedium`]). So a single layer gives its own picture, the order of layers does not matter, and constant media are exact at any step.
//!
//! Layers that *mix* are media in the same place: their extinctions add, and their colours mix by extinction. A layer that *adds* emits its colour
//! times its opacity per unit distance, and hides nothing; the mixing layers in the same interval dim its light. Mixing layers' colours are lit
//! before they are mixed, by the gradient of the layer's own field in the scene's world: placements are affine, so gradients transform by the
//! inverse transpose. Adding layers are not lit. Surfaces are lit, whatever their layer's fog does.
//!
//! **Projections.** Each layer is projected and classified on its own, along its own part of the ray. Mixing layers are joined as media of the
//! layers' opacities ([`JointMedium::put`] over length 1): opaque ones show their mean colour and hide everything behind. Adding layers put their
//! colour times their opacity on top ([`JointMedium::flat`]). Layers *over* the others, such as labels over an image, lie above this with their
//! opacities, the last uppermost ([`JointMedium::put_over`]). In fog they mix.

use crate::enum_all::every;
use crate::lighting::LightingModel;
use crate::picture::FrameSettings;
use glam::{DVec3, DVec4};
use serde::{Deserialize, Serialize};

/// How a volume joins others in the same place.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Blend {
    /// As a medium: the volume absorbs light from behind, and its share of the mixed colour is its share of the extinction.
    #[default]
    Mix,
    /// As light alone: the volume's colour is added, and it hides nothing.
    Add,
    /// In projections, on top of the others with the volume's opacity; in fog, as a medium.
    Over,
}

every!(Blend: Mix Add Over);

/// The settings of one volume in a frame of several volumes.
#[derive(Clone, Debug)]
pub struct VolumeFrame {
    /// Settings of a frame of this volume alone. Rays, lattice, mode, sampling, meshes and background are the same for all volumes of a frame.
    pub settings: FrameSettings,
    /// Blending with others in the same place.
    pub blend: Blend,
    /// Opacity of the volume in a projection, 0 to 1. Projections do not use the transfer function's opacity.
    pub opacity: f64,
}

impl VolumeFrame {
    /// Returns the frame of a single volume: it mixes, with opacity 1.
    pub fn alone(settings: FrameSettings) -> Self {
        Self { settings, blend: Blend::Mix, opacity: 1.0 }
    }

    /// Whether this volume alone makes the picture of its settings, unchanged by blend and opacity.
    pub fn is_plain(&self) -> bool {
        self.blend != Blend::Add && (self.opacity >= 1.0 || !self.settings.mode.is_projection())
    }

    /// Whether the volume's fog is lit: the frame has a lighting model, and the volume does not add.
    pub fn is_lit(&self) -> bool {
        self.blend != Blend::Add && self.settings.lighting.model != LightingModel::None
    }
}

/// The medium of one layer in a piece of a segment, accumulated part by part from front to back.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LayerMedium {
    /// Premultiplied colour of a mixing layer, and its depth: halvings of the light on the way through.
    color: DVec3,
    depth: f64,
    /// Light of an adding layer.
    emission: DVec3,
}

/// The depth of an opaque medium, in halvings of the light. It is finite, so sums and shares of it are numbers; after a billionth of a unit distance
/// it looks opaque.
pub const OPAQUE: f64 = 1e30;

impl LayerMedium {
    /// Adds the next part, behind the previous ones: `rgb` is its straight colour, `depth` its halvings of the light over a unit distance, and
    /// `length` its length in unit distances.
    pub fn add(&mut self, blend: Blend, rgb: DVec3, depth: f64, length: f64) {
        let depth = depth.min(OPAQUE);
        match blend {
            Blend::Mix | Blend::Over => {
                let left = (-depth * length).exp2();
                self.color += rgb * ((-self.depth).exp2() * (1.0 - left));
                self.depth += depth * length;
            }
            Blend::Add => self.emission += rgb * ((1.0 - (-depth).exp2()) * length),
        }
    }
}

/// Several media together in one interval of a ray.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct JointMedium {
    /// Of the mixing layers: colour times depth, and depth, in halvings of the light over the interval.
    color: DVec3,
    depth: f64,
    /// Emission of the adding layers.
    emission: DVec3,
    /// Premultiplied colour and opacity of the projections over the others.
    over: DVec4,
}

impl JointMedium {
    /// Adds a uniform medium: `rgb` is its straight colour, `alpha` its opacity over a unit distance, and `length` its length in unit distances.
    pub fn put(&mut self, blend: Blend, rgb: [f64; 3], alpha: f64, length: f64) {
        let mut alone = LayerMedium::default();
        alone.add(blend, DVec3::from_array(rgb), -(1.0 - alpha).log2(), length);
        self.put_share(&alone, 1.0);
    }

    /// Puts a projection's straight colour, with this opacity, on top of all others.
    pub fn put_over(&mut self, rgb: [f64; 3], alpha: f64) {
        self.over = self.over * (1.0 - alpha) + (DVec3::from_array(rgb) * alpha).extend(alpha);
    }

    /// Adds a share, 0 to 1, of a layer's medium in a piece.
    pub fn put_share(&mut self, alone: &LayerMedium, share: f64) {
        let hidden = 1.0 - (-alone.depth).exp2();
        if hidden > 0.0 {
            self.color += alone.color * (alone.depth / hidden * share);
            self.depth += alone.depth * share;
        }
        self.emission += alone.emission * share;
    }

    /// Returns the interval's premultiplied colour, and the share of light it lets through.
    pub fn seen(&self) -> (DVec3, f64) {
        let (mixed, left) = self.mixed();
        // The mean, over the interval, of the transmission to its front.
        let nats = self.depth * std::f64::consts::LN_2;
        let dimmed = if self.depth > 0.0 { ((1.0 - left) / nats).min(1.0) } else { 1.0 };
        (mixed + self.emission * dimmed, left)
    }

    /// Returns the premultiplied colour of the joined projections, and the share of light they let through. Only the layers over them dim the light
    /// of adding layers.
    pub fn flat(&self) -> (DVec3, f64) {
        let (mixed, left) = self.mixed();
        let below = 1.0 - self.over.w;
        (self.over.truncate() + (mixed + self.emission) * below, left * below)
    }

    /// Premultiplied colour and transmission of the mixing layers.
    fn mixed(&self) -> (DVec3, f64) {
        let left = (-self.depth).exp2();
        (if self.depth > 0.0 { self.color * ((1.0 - left) / self.depth) } else { DVec3::ZERO }, left)
    }
}
#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn media_together_do_not_depend_on_how_a_stretch_is_cut() {
        let all = |length: f64| {
            let mut together = JointMedium::default();
            together.put(Blend::Mix, [1.0, 0.2, 0.0], 0.3, length);
            together.put(Blend::Mix, [0.0, 0.5, 1.0], 0.6, length);
            together.put(Blend::Add, [0.1, 0.9, 0.3], 0.2, length);
            together.seen()
        };
        let (whole, left) = all(2.5);
        assert!((left - (0.7f64 * 0.4).powf(2.5)).abs() < 1e-12);
        let (mut color, mut light) = (DVec3::ZERO, 1.0);
        for part in [0.3, 0.01, 1.19, 1.0] {
            let (seen, left) = all(part);
            color += seen * light;
            light *= left;
        }
        assert!((color - whole).length() < 1e-12 && (light - left).abs() < 1e-12, "{color} {whole}");
    }

    #[test]
    fn a_medium_alone_is_what_it_is_without_others() {
        let mut alone = JointMedium::default();
        alone.put(Blend::Mix, [0.4, 0.8, 0.1], 0.3, 0.7);
        let (seen, left) = alone.seen();
        assert!((left - 0.7f64.powf(0.7)).abs() < 1e-12);
        assert!((seen - DVec3::new(0.4, 0.8, 0.1) * (1.0 - left)).length() < 1e-12);
        let mut emission = JointMedium::default();
        emission.put(Blend::Add, [0.4, 0.8, 0.1], 1.0, 0.5);
        assert_eq!(emission.seen(), (DVec3::new(0.2, 0.4, 0.05), 1.0), "no number is past all numbers");
        let mut opaque = JointMedium::default();
        opaque.put(Blend::Mix, [0.4, 0.8, 0.1], 1.0, 0.5);
        assert_eq!(opaque.seen().1, 0.0);
    }

    #[test]
    fn what_lies_over_others_hides_them_by_its_opacity() {
        let mut together = JointMedium::default();
        together.put_over([1.0, 0.0, 0.0], 0.25);
        together.put(Blend::Mix, [0.0, 1.0, 0.0], 0.5, 1.0);
        together.put(Blend::Add, [0.0, 0.0, 1.0], 0.5, 1.0);
        together.put_over([1.0, 1.0, 1.0], 0.5);
        let (seen, left) = together.flat();
        let below = DVec3::new(0.25, 0.75 * 0.5, 0.75 * 0.5);
        assert!(
            (seen - (below * 0.5 + 0.5)).length() < 1e-12 && (left - 0.5 * 0.75 * 0.5).abs() < 1e-12,
            "{seen} {left}"
        );
    }
}
