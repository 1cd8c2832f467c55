//! Several volumes in one picture: how each of them looks, and what they are together in one place.
//!
//! In each segment of a ray every volume contributes the part of the segment that is inside of it, of its crop and of what is shown,
//! sampled in the middle of that part. Of the volumes that *mix*, extinctions add and colours mix by extinction, as of media that fill
//! the same place; so nothing depends on their order. A volume that *adds* glows: it gives its colour, times its opacity, for every unit
//! distance, and hides nothing. Along a segment all of them are spread evenly, so what glows is dimmed by what mixes in the
//! same segment: the picture of media that do not change is the same for every step.
//!
//! Where the scene is lit, the colour of a volume that mixes is lit before it is mixed, by the gradient of its own field at its sample,
//! in the scene's world: its placement is affine, so gradients go by the inverse transpose. What adds glows, and is not lit.
//!
//! Volumes may have surfaces, too, each its own. A volume's are found in its part of a segment as those of one volume are (see
//! [`surface`](crate::surface)); those of all volumes cut the segment, in the order of their distances. Between two cuts media
//! mix as they do in a whole segment. A volume's sample stands for all its part, and each piece has of that part what lies in
//! it: so nothing is sampled anew, and media that do not change are exact.

use crate::every::every;
use crate::integrals;
use crate::lighting::LightingModel;
use crate::picture::FrameSettings;
use crate::placement::Placement;
use crate::surface::Isosurface;
use crate::transfer::TransferFunction;
use glam::DVec3;
use serde::{Deserialize, Serialize};

/// What a volume does to others in the same place.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Blend {
    /// It takes light from what is behind, and its colour has the share of its extinction.
    #[default]
    Mix,
    /// Its colour is added, and it hides nothing.
    Add,
}

every!(Blend: Mix Add);

/// How one of several volumes looks. Distances are of the volume's own world: what its store says.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct VolumeLook {
    /// Where it stands: from its own world to the scene's.
    pub world_from_volume: Placement,
    /// Its transfer function; `None` is the scene's, or else a gray ramp over the store's default window.
    pub transfer: Option<TransferFunction>,
    /// What its opacities are multiplied by, in 0..=1.
    pub opacity: f64,
    /// What it does to others.
    pub blend: Blend,
    /// Its surfaces, which stand among the fog and the surfaces of all; at most [`MAX_SURFACES`](crate::surface::MAX_SURFACES).
    pub isosurfaces: Vec<Isosurface>,
    /// Two corners of a box of its own world, the lesser first: nothing outside of it is shown, or read.
    pub crop: Option<[DVec3; 2]>,
    /// Its channel; `None` is the scene's.
    pub channel: Option<u32>,
    /// Whether it is shown at all.
    pub visible: bool,
}

impl Default for VolumeLook {
    fn default() -> Self {
        Self {
            world_from_volume: Placement::default(),
            transfer: None,
            opacity: 1.0,
            blend: Blend::Mix,
            isosurfaces: Vec::new(),
            crop: None,
            channel: None,
            visible: true,
        }
    }
}

impl TransferFunction {
    /// The same with all opacities multiplied.
    pub fn scaled(&self, opacity: f64) -> Self {
        let mut scaled = self.clone();
        scaled.opacity.iter_mut().for_each(|point| point[1] *= opacity);
        scaled.regions.iter_mut().for_each(|region| region.opacity *= opacity);
        scaled
    }
}

/// A volume's part of a frame of several.
#[derive(Clone, Debug)]
pub struct VolumeFrame {
    /// As if it were alone. Rays, lattice and background are the same for all volumes of a frame; so is the mode,
    /// [`Mode::Dvr`](crate::Mode::Dvr).
    pub settings: FrameSettings,
    /// What it does to others.
    pub blend: Blend,
}

impl VolumeFrame {
    /// Whether its colours are lit.
    pub fn is_lit(&self) -> bool {
        self.blend == Blend::Mix && self.settings.lighting.model != LightingModel::None
    }
}

/// What several media are together in one segment.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Together {
    /// Of those that mix: colour times depth, and depth, in halvings of the light over the segment.
    color: DVec3,
    depth: f64,
    /// Of those that add.
    glow: DVec3,
}

impl Together {
    /// Puts a medium in, of so many unit distances.
    pub fn put(&mut self, blend: Blend, rgb: [f64; 3], alpha: f64, length: f64) {
        let rgb = DVec3::from_array(rgb);
        match blend {
            Blend::Mix => {
                let depth = integrals::depth(alpha) * length;
                self.color += rgb * depth;
                self.depth += depth;
            }
            Blend::Add => self.glow += rgb * (alpha * length),
        }
    }

    /// What the segment shows, and what passes it.
    pub fn seen(&self) -> (DVec3, f64) {
        let left = (-self.depth).exp2();
        let (mixed, dimmed) = if self.depth > 0.0 {
            let hidden = 1.0 - left;
            // The mean, from the segment's front to its back, of the light that passes from there.
            (self.color * (hidden / self.depth), (hidden / (self.depth * std::f64::consts::LN_2)).min(1.0))
        } else {
            (DVec3::ZERO, 1.0)
        };
        (mixed + self.glow * dimmed, left)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn media_together_do_not_depend_on_how_a_stretch_is_cut() {
        let all = |length: f64| {
            let mut together = Together::default();
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
        let mut alone = Together::default();
        alone.put(Blend::Mix, [0.4, 0.8, 0.1], 0.3, 0.7);
        let (seen, left) = alone.seen();
        assert!((left - 0.7f64.powf(0.7)).abs() < 1e-12);
        assert!((seen - DVec3::new(0.4, 0.8, 0.1) * (1.0 - left)).length() < 1e-12);
        let mut glow = Together::default();
        glow.put(Blend::Add, [0.4, 0.8, 0.1], 1.0, 0.5);
        assert_eq!(glow.seen(), (DVec3::new(0.2, 0.4, 0.05), 1.0), "no number is past all numbers");
        let mut opaque = Together::default();
        opaque.put(Blend::Mix, [0.4, 0.8, 0.1], 1.0, 0.5);
        assert_eq!(opaque.seen().1, 0.0);
    }
}
