//! Isosurfaces: rules for their intersection and lighting, shared by all renderers.
//!
//! A picture has one opaque surface ([`Mode::Isosurface`](crate::Mode::Isosurface)), or several translucent ones, alone or in the fog of
//! [`Mode::Dvr`](crate::Mode::Dvr).
//!
//! The field is read at the ends of a ray's segments (see [`lattice`](crate::lattice)), each in the brick of the segment before it; the start
//! of the first segment in that segment's own brick. If an end is on the other side of the isovalue than the end before it, the ray has
//! crossed the surface in between; the first crossing is visible. So a ray has exactly one hit where it changes sides: bricks that disagree at
//! their border, by rounding or by their level, leave no gap. An end without a value has no side, and there is no surface at the volume's
//! boundary; at a clip's there are [caps](crate::CutFace), if requested.
//!
//! The crossing is located in the segment's own brick: the first of [`PARTS`] equal parts with its ends on two sides, the same once more
//! within it, then a straight line between its ends. The last step far improves on the 64th of a segment before it.
//!
//! Among several surfaces, the *rank* of a place is the number of isovalues up to its value. Between two ranks a ray crosses all surfaces in
//! between, one after the other, each searched behind the one before. A crossing cuts its segment: the fog in front of it and behind it are
//! segments of their own, with the surface between.

use crate::lighting::{Lighting, LightingModel};
use crate::slot_encoding::{ANYTHING, SlotEncoding, SlotFormat};
use crate::transfer::TransferFunction;
use serde::{Deserialize, Serialize};

/// Rounding tolerance between things of several layers beginning on one cut, as a share of the step.
pub const CAP_TIE: f64 = 0.01;

/// A ray's crossing of a surface, among those of several layers in one segment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Meeting {
    /// The distance of the crossing.
    pub t: f64,
    /// Greatest distance behind another surface at which both count as crossed together, in the order of layers.
    pub tie: f64,
}

impl Meeting {
    /// A surface at a distance. A cap counts as [`CAP_TIE`] of a step before its cut: other layers' fog behind the cut is then behind the cap,
    /// however little of it is needed to hide everything further.
    pub fn new(t: f64, is_cap: bool, step: f64) -> Self {
        let tie = if is_cap { CAP_TIE * step } else { 0.0 };
        Self { t: t - tie, tie }
    }
}

/// Sorts the surfaces crossed in one segment, given in the order of their layers, into the order of crossing.
pub fn sort_met<T>(surfaces: &mut [T], met: impl Fn(&T) -> Meeting) {
    let all: Vec<f64> = surfaces.iter().map(|surface| met(surface).t).collect();
    let passed_at = |surface: &T| {
        let Meeting { t, tie } = met(surface);
        all.iter().copied().filter(|other| (t - tie..=t).contains(other)).fold(t, f64::min)
    };
    surfaces.sort_by(|a, b| passed_at(a).total_cmp(&passed_at(b)));
}

/// The most isosurfaces of a scene's layer.
pub const MAX_SURFACES: usize = 8;

/// An isosurface of a layer, as requested by a scene.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Isosurface {
    /// The isovalue: the value of the field on the surface, in stored units.
    pub value: f64,
    /// Colour of the surface, in 0..=1; `None` is the transfer function's colour at the isovalue.
    pub color: Option<[f64; 3]>,
    /// Opacity of the surface: the absorbed share of light, 0 to 1.
    #[serde(default = "opaque")]
    pub opacity: f64,
}

fn opaque() -> f64 {
    1.0
}

impl Isosurface {
    /// Creates an opaque isosurface of this value, in the transfer function's colour.
    pub fn at(value: f64) -> Self {
        Self { value, color: None, opacity: opaque() }
    }
}

/// An isosurface in the renderers' form.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Surface {
    /// Least value inside; see [`threshold`].
    pub threshold: f64,
    /// Colour of the surface before it is lit.
    pub color: [f32; 3],
    /// Opacity of the surface: the absorbed share of light, 0 to 1.
    pub opacity: f32,
}

impl Surface {
    /// Converts a layer's isosurfaces to the renderers' form, in the order of their values.
    pub fn all(surfaces: &[Isosurface], transfer: &TransferFunction, encoding: &SlotEncoding) -> Vec<Self> {
        let surface = |surface: &Isosurface| {
            let threshold = threshold(surface.value, encoding);
            let color = surface.color.unwrap_or_else(|| transfer.rgb(threshold)).map(|c| c as f32);
            Self { threshold, color, opacity: surface.opacity as f32 }
        };
        let mut all: Vec<_> = surfaces.iter().map(surface).collect();
        all.sort_by(|a, b| a.threshold.total_cmp(&b.threshold));
        all
    }
}

/// The rank of a value: the number of surfaces with a threshold up to it. `surfaces` must be in the order of their values.
pub fn rank(surfaces: &[Surface], value: f64) -> usize {
    surfaces.iter().take_while(|surface| surface.threshold <= value).count()
}

/// The lighting of surfaces in a scene: the fog's, or the Blinn-Phong model if fog is unlit.
pub fn lighting(lighting: &Lighting) -> Lighting {
    let is_unlit = lighting.model == LightingModel::None;
    Lighting { model: if is_unlit { LightingModel::BlinnPhong } else { lighting.model }, ..lighting.clone() }
}

/// Number of equal parts per round of the search for a crossing, in each of [`ROUNDS`] rounds.
pub const PARTS: usize = 8;

/// Number of rounds of the search for a crossing: the second one searches the part found by the first.
pub const ROUNDS: usize = 2;

/// Length of the vector of code differences across two voxels below which a field has no gradient: the rounding error of a flat field
/// ([`SlotEncoding::flat_codes`]).
pub const FLAT_CODES: f64 = 1.0 / 64.0;

/// The same as a share of the value's distance from the transfer table's first, for the greater rounding error of an even field far from
/// there, in 16 bits and in f32 slots of a narrow window. Stored gradients are free of it.
pub const FLAT_SHARE: f64 = 1.0 / (1 << 20) as f64;

/// Depth of surfaces below their isovalue, as a share of a code: where many voxels have exactly this value, rounding does not decide their
/// side.
const BELOW: f64 = 1.0 / 64.0;

/// The threshold of an isosurface at `isovalue`: places with values from it on are inside.
pub fn threshold(isovalue: f64, encoding: &SlotEncoding) -> f64 {
    // Codes of wider numbers are rounded: by half a code at most.
    let is_rounded = encoding.format == SlotFormat::U16 && encoding.voxel_type.bytes() > 2;
    isovalue - (BELOW + if is_rounded { 0.5 } else { 0.0 }) * encoding.code_width()
}

/// Whether samples with codes in a range can be on both sides of a threshold, also in codes.
#[inline(always)]
pub fn straddles(range: [u16; 2], threshold: f32) -> bool {
    let [low, high] = range.map(f32::from);
    range == ANYTHING || low < threshold && threshold <= high
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::voxel_type::VoxelType;

    #[test]
    fn caps_of_one_cut_are_in_the_order_of_layers() {
        // Steps of 1, so a tie is 0.01 long.
        let order = |met: &[(f64, bool)]| {
            let met = met.iter().map(|&(t, is_cap)| Meeting::new(t, is_cap, 1.0));
            let mut all: Vec<(usize, Meeting)> = met.enumerate().collect();
            sort_met(&mut all, |surface| surface.1);
            all.into_iter().map(|surface| surface.0).collect::<Vec<_>>()
        };
        assert_eq!(order(&[(3.0, false), (1.0, false), (2.0, false)]), [1, 2, 0]);
        assert_eq!(
            order(&[(1.004, true), (1.0, true), (0.5, false)]),
            [2, 0, 1],
            "a cap is passed with what is just before it"
        );
        assert_eq!(order(&[(1.02, true), (1.0, true)]), [1, 0], "not with what is farther away");
        assert_eq!(order(&[(1.004, false), (1.0, true)]), [1, 0], "nor a surface that is no cap");
        assert_eq!(order(&[(1.0, false), (1.004, true)]), [1, 0], "which a cap is before if they are at one place");
    }

    #[test]
    fn a_range_straddles_only_what_is_inside_of_it() {
        let cases =
            [([3, 9], true), ([6, 9], false), ([3, 5], false), ([5, 6], true), (crate::macrocells::NONE, false)];
        for (range, expected) in cases {
            assert_eq!(straddles(range, 5.5), expected, "{range:?}");
        }
        assert!(straddles([5, 6], 6.0) && !straddles([6, 7], 6.0), "at the threshold is inside");
    }

    #[test]
    fn voxels_of_just_the_isovalue_are_inside() {
        let encoding = SlotEncoding::new(VoxelType::I16, (0.0, 1.0), false);
        let threshold = encoding.unorm(threshold(-24.0, &encoding)) * 65535.0;
        let code = 32768.0 - 24.0;
        assert!(threshold < code - 0.01 && threshold > code - 0.02, "{threshold}");
    }

    #[test]
    fn voxels_of_just_the_isovalue_are_inside_where_codes_are_rounded() {
        for (voxel_type, range) in
            [(VoxelType::U32, (0.0, 6.0)), (VoxelType::F32, (-3.0, 4.0)), (VoxelType::I32, (0.0, 7e5))]
        {
            let encoding = SlotEncoding::new(voxel_type, range, false);
            let codes = |value: f64| encoding.unorm(value) * 65535.0;
            for isovalue in (0..=60).map(|i| (range.0 + f64::from(i) / 60.0 * (range.1 - range.0)).round()) {
                let begins = codes(threshold(isovalue, &encoding));
                assert!(begins < codes(isovalue).round() && begins > codes(isovalue) - 0.6, "{isovalue} of {range:?}");
            }
        }
    }

    #[test]
    fn surfaces_stand_in_the_order_of_their_values() {
        let encoding = SlotEncoding::new(VoxelType::U8, (0.0, 255.0), false);
        let transfer = TransferFunction::preset("gray", (0.0, 255.0), 1.0).unwrap();
        let red = Isosurface { value: 40.0, color: Some([1.0, 0.0, 0.0]), opacity: 0.5 };
        let all = Surface::all(&[Isosurface::at(51.0), red], &transfer, &encoding);
        assert_eq!((all[0].color, all[0].opacity, all[1].opacity), ([1.0, 0.0, 0.0], 0.5, 1.0));
        // Less by a 64th of a code.
        assert!((all[1].color[0] - 0.2).abs() < 1e-4);
        assert_eq!([39.0, 40.0, 50.9, 51.0, 99.0].map(|value| rank(&all, value)), [0, 1, 1, 2, 2]);
    }
}
