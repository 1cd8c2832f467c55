//! Sampling and classification of rays' segments in direct volume rendering, and filters of the field: the methods compared by Gavrilov, Turlapov and
//! others in "Measuring the quality of volume rendering" (2013).
//!
//! A method reads the field in the middle of a segment, at its ends, or also at its neighbours' ends, and takes the *curve* through these values for
//! the field in between. A segment is cut into equal *parts*; each is classified by the value in its middle, or by the mean of the transfer function
//! over the values between its ends ([pre-integrated](crate::preintegration)). Parts follow one another from front to back.
//!
//! Every place is read in the segment's own brick. So [`Needs::apron`] covers the methods' reach out of it; steps longer than a voxel reach further,
//! and read the nearest voxels of the brick.

use crate::enum_all::every;
use crate::gradients::GradientNodes;
use crate::jitter::Jitter;
use crate::lighting::{Lighting, LightingModel};
use crate::mesh::MeshCapacity;
use crate::mode::Mode;
use serde::{Deserialize, Serialize};

/// The widest apron of any picture, in voxels.
pub const MAX_REACH: u32 = 4;

/// Default number of virtual samples of a segment: the paper's optimum.
pub const VIRTUAL_SAMPLES: u8 = 3;

/// The most virtual samples of a segment.
pub const MOST_VIRTUAL_SAMPLES: u8 = 16;

/// The most parts of a segment with [`Method::Asm`].
pub const MOST_PARTS: usize = 8;

/// Adaptive sampling ([`Method::Asm`]): the largest difference between a part's ends, as a share of the codes over which a transfer function changes.
pub const ADAPTIVE_SHARE: f64 = 1.0 / 64.0;

/// A sampling method: how a segment becomes a medium.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Method {
    /// One sample in the segment's middle.
    #[default]
    Udvr,
    /// Pre-integration: the transfer function's mean between the values at the segment's ends.
    Pdvr,
    /// Virtual samples on a straight line between the values at the segment's ends.
    Lvs,
    /// Virtual samples on a cubic curve through the values at the ends of the segment and of its neighbours. The curve stays between the values at
    /// the segment's own ends.
    Cvs,
    /// Adaptive sampling: the number of samples grows with the difference of the values at the segment's ends.
    Asm,
    /// [`Method::Lvs`] with pre-integrated parts.
    Plvs,
    /// [`Method::Cvs`] with pre-integrated parts.
    Pcvs,
}

/// A method's model of the field along a segment.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Curve {
    /// The value in the segment's middle, everywhere.
    Middle,
    /// A straight line between the values at the segment's ends.
    Line,
    /// A cubic curve through the values at the ends of the segment and of its neighbours.
    Cubic,
    /// The field itself, read in the middle of each part.
    Field,
}

every!(Method: Udvr Pdvr Lvs Cvs Asm Plvs Pcvs);

impl Method {
    /// The method's model of the field along a segment.
    pub const fn curve(self) -> Curve {
        match self {
            Self::Udvr => Curve::Middle,
            Self::Pdvr | Self::Lvs | Self::Plvs => Curve::Line,
            Self::Cvs | Self::Pcvs => Curve::Cubic,
            Self::Asm => Curve::Field,
        }
    }

    /// Whether the method pre-integrates the parts of a segment.
    pub const fn is_pre_integrated(self) -> bool {
        matches!(self, Self::Pdvr | Self::Plvs | Self::Pcvs)
    }

    /// Whether the method takes virtual samples of a segment.
    pub const fn has_virtual_samples(self) -> bool {
        matches!(self, Self::Lvs | Self::Cvs | Self::Plvs | Self::Pcvs)
    }

    /// Reach of the method's reads from a segment's middle, in segments.
    const fn reach(self) -> f64 {
        match self.curve() {
            Curve::Middle => 0.0,
            Curve::Line | Curve::Field => 0.5,
            Curve::Cubic => 1.5,
        }
    }
}

/// A filter: how voxels become a field.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Filter {
    /// The value of the voxel around a place: a field of steps, with unmixed voxels. A voxel's box is half-open, and includes its lower faces. Steps
    /// have no gradient; lighting, and classification by gradient, use the [`Filter::Trilinear`] field.
    Nearest,
    /// Linear between the eight voxels around a place.
    #[default]
    Trilinear,
    /// The cubic B-spline over the 64 voxels around a place: smooth, but it blurs.
    Tricubic,
}

every!(Filter: Nearest Trilinear Tricubic);

impl Filter {
    /// The filter's voxels on each side of a place, along each axis. The nearest voxel is one of the linear filter's, so both share bricks, and a
    /// change from one to the other uploads nothing.
    pub const fn taps(self) -> u32 {
        match self {
            Self::Nearest | Self::Trilinear => 1,
            Self::Tricubic => 2,
        }
    }

    /// Greatest distance from a place to the filter's outermost voxel centres, less the half voxel from a brick's face to its own: half a voxel less
    /// than [`Filter::taps`].
    const fn reach(self) -> f64 {
        self.taps() as f64 - 0.5
    }

    /// Greatest distance, in voxels, from a place to the nearest face of one of the filter's voxels.
    pub const fn farthest(self) -> f64 {
        match self {
            Self::Nearest => 0.0,
            Self::Trilinear => 0.5,
            Self::Tricubic => 1.5,
        }
    }

    /// The filter of the field for gradients.
    pub const fn of_gradients(self) -> Self {
        match self {
            Self::Nearest | Self::Trilinear => Self::Trilinear,
            Self::Tricubic => Self::Tricubic,
        }
    }
}

/// The uniform cubic B-spline's weights of the four voxels around a place, `t` from the second to the third.
pub fn b_spline(t: f64) -> [f64; 4] {
    let s = 1.0 - t;
    [s * s * s, 4.0 - 6.0 * t * t + 3.0 * t * t * t, 4.0 - 6.0 * s * s + 3.0 * s * s * s, t * t * t].map(|w| w / 6.0)
}

/// The cubic curve of Catmull and Rom through four values, at `t` in 0..=1 from the second to the third, clamped between those two, so clear ranges
/// stay clear.
pub fn cubic([a, b, c, d]: [f64; 4], t: f64) -> f64 {
    let value = catmull_rom([a, b, c, d], t);
    value.clamp(b.min(c), b.max(c))
}

/// The cubic curve of Catmull and Rom through four values, at `t` in 0..=1 from the second to the third. It may leave the range of those two.
pub fn catmull_rom([a, b, c, d]: [f64; 4], t: f64) -> f64 {
    b + 0.5 * t * (c - a + t * (2.0 * a - 5.0 * b + 4.0 * c - d + t * (3.0 * (b - c) + d - a)))
}

/// Sampling settings: method, filter and jitter.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Sampling {
    /// The sampling method.
    pub method: Method,
    /// Virtual samples of a segment, 1 to [`MOST_VIRTUAL_SAMPLES`]; unused by methods without them.
    pub virtual_samples: u8,
    /// The field's filter.
    pub filter: Filter,
    /// Jitter of each pixel's ray, so that neighbouring rays are sampled at different distances.
    pub jitter: Jitter,
}

impl Default for Sampling {
    fn default() -> Self {
        let (method, filter, jitter) = Default::default();
        Self { method, virtual_samples: VIRTUAL_SAMPLES, filter, jitter }
    }
}

impl Sampling {
    /// Number of parts of a segment. `steps` is the difference of the values at its ends, in the transfer function's
    /// [adaptive steps](crate::TransferTable::adaptive_step); only [`Method::Asm`] depends on it.
    pub fn parts(&self, steps: f64) -> usize {
        match self.method {
            Method::Udvr | Method::Pdvr => 1,
            Method::Lvs | Method::Cvs | Method::Plvs | Method::Pcvs => self.virtual_samples.into(),
            Method::Asm => (steps.ceil() as usize).clamp(1, MOST_PARTS),
        }
    }
}

/// A picture's requirements on bricks and the tables beside them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Needs {
    /// Width of the apron around a brick's core, in voxels.
    pub apron: u32,
    /// Layers of stored gradients outside a brick's core (see [`GradientNodes`]); 0 means no gradients at all.
    pub gradient_layers: u32,
    /// The field's filter, on which the values of a part of a brick depend.
    pub filter: Filter,
    /// Whether the tables include running integrals of the transfer function.
    pub is_pre_integrated: bool,
    /// Whether the tables include the [grid](crate::TransferGrid) of a transfer function of value and gradient.
    pub has_grid: bool,
    /// Total size of meshes to make room for.
    pub meshes: MeshCapacity,
}

impl Needs {
    /// The needs of plain samples: trilinear, unlit, not pre-integrated, without meshes.
    pub const PLAIN: Self = Self {
        apron: 1,
        gradient_layers: 0,
        filter: Filter::Trilinear,
        is_pre_integrated: false,
        has_grid: false,
        meshes: MeshCapacity::NONE,
    };

    /// Returns the needs of a picture without meshes. `has_surfaces` means isosurfaces, `has_grid` a transfer function of value and gradient.
    pub fn new(mode: Mode, sampling: Sampling, lighting: &Lighting, has_surfaces: bool, has_grid: bool) -> Self {
        let filter = sampling.filter;
        let along = match mode {
            Mode::Dvr if has_surfaces => sampling.method.reach().max(Method::Lvs.reach()),
            Mode::Dvr => sampling.method.reach(),
            Mode::Isosurface => Method::Lvs.reach(),
            _ => 0.0,
        };
        let has_grid = has_grid && mode == Mode::Dvr;
        let is_fog_lit = mode == Mode::Dvr && lighting.model != LightingModel::None;
        let has_gradients = mode == Mode::Isosurface || has_surfaces || is_fog_lit || has_grid;
        let (across, gradient_layers) = match lighting.gradient.reach() {
            Some(across) if has_gradients => (across, 0),
            None if has_gradients => (0.0, GradientNodes::layers(along)),
            _ => (0.0, 0),
        };
        let is_pre_integrated = mode == Mode::Dvr && sampling.method.is_pre_integrated();
        Self {
            apron: ((along + across + filter.reach()).ceil() as u32).max(2 * gradient_layers),
            gradient_layers,
            filter,
            is_pre_integrated,
            has_grid,
            meshes: MeshCapacity::NONE,
        }
    }

    /// The layout of the stored gradients of a brick's core of `edge` voxels.
    pub const fn gradients(&self, edge: u32) -> GradientNodes {
        GradientNodes { edge, layers: self.gradient_layers }
    }

    /// Returns needs sufficient for the pictures of both `self` and `other`.
    pub fn union(self, other: Self) -> Self {
        Self {
            apron: self.apron.max(other.apron),
            gradient_layers: self.gradient_layers.max(other.gradient_layers),
            filter: if self.filter.taps() > other.filter.taps() { self.filter } else { other.filter },
            is_pre_integrated: self.is_pre_integrated || other.is_pre_integrated,
            has_grid: self.has_grid || other.has_grid,
            meshes: self.meshes.union(other.meshes),
        }
    }

    /// Whether bricks and tables prepared for `self` also satisfy `other`.
    pub fn satisfy(&self, other: &Self) -> bool {
        let has_tables = (self.is_pre_integrated || !other.is_pre_integrated) && (self.has_grid || !other.has_grid);
        self.apron >= other.apron
            && self.gradient_layers >= other.gradient_layers
            && self.filter.taps() >= other.filter.taps()
            && has_tables
            && self.meshes.holds(&other.meshes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lighting::Gradient;

    #[test]
    fn splines_weigh_one_in_all_and_move_with_the_place() {
        for t in [0.0, 0.25, 0.6, 1.0] {
            let weights = b_spline(t);
            assert!((weights.iter().sum::<f64>() - 1.0).abs() < 1e-15);
            let place: f64 = weights.iter().zip([-1.0, 0.0, 1.0, 2.0]).map(|(w, x)| w * x).sum();
            assert!((place - t).abs() < 1e-15, "{t}: {place}");
        }
    }

    #[test]
    fn curves_pass_through_the_ends_and_are_exact_for_parabolas() {
        let parabola = |x: f64| 3.0 + 2.0 * x - 0.5 * x * x;
        let points = [-1.0, 0.0, 1.0, 2.0].map(parabola);
        for t in [0.0, 0.3, 0.5, 1.0] {
            assert!((catmull_rom(points, t) - parabola(t)).abs() < 1e-14);
            assert!((cubic(points, t) - parabola(t)).abs() < 1e-14);
        }
        assert_eq!(cubic([9.0, 0.0, 0.0, 9.0], 0.5), 0.0, "nothing below what was sampled");
    }

    #[test]
    fn aprons_follow_what_is_read() {
        let lit = Lighting { model: LightingModel::BlinnPhong, ..Lighting::default() };
        let apron = |mode, method, filter, lighting: &Lighting| {
            Needs::new(mode, Sampling { method, filter, ..Sampling::default() }, lighting, false, false).apron
        };
        let (none, linear, cubic) = (Lighting::default(), Filter::Trilinear, Filter::Tricubic);
        for (mode, method, lighting) in [(Mode::Mip, Method::Udvr, &none), (Mode::Dvr, Method::Pcvs, &lit)] {
            let [nearest, linear] = [Filter::Nearest, linear].map(|filter| apron(mode, method, filter, lighting));
            assert_eq!(nearest, linear, "the same bricks");
        }
        assert_eq!(apron(Mode::Dvr, Method::Udvr, linear, &none), 1);
        assert_eq!(apron(Mode::Mip, Method::Pcvs, linear, &lit), 1);
        assert_eq!(apron(Mode::Isosurface, Method::Udvr, linear, &none), 2);
        assert_eq!(apron(Mode::Dvr, Method::Udvr, cubic, &none), 2);
        assert_eq!(apron(Mode::Dvr, Method::Plvs, linear, &lit), 2);
        assert_eq!(apron(Mode::Dvr, Method::Pcvs, linear, &none), 2);
        assert_eq!(apron(Mode::Dvr, Method::Cvs, cubic, &lit), MAX_REACH);
        assert_eq!(Needs::new(Mode::Dvr, Sampling::default(), &none, true, false).apron, 2);
        let stored = Lighting { gradient: Gradient::Stored, ..lit };
        let needs = |method, filter, lighting: &Lighting| {
            let needs =
                Needs::new(Mode::Dvr, Sampling { method, filter, ..Sampling::default() }, lighting, false, false);
            (needs.apron, needs.gradient_layers)
        };
        assert_eq!(needs(Method::Udvr, linear, &stored), (2, 1));
        assert_eq!(needs(Method::Plvs, cubic, &stored), (2, 1));
        assert_eq!(needs(Method::Pcvs, cubic, &stored), (MAX_REACH, 2));
        let unlit = Lighting { model: LightingModel::None, ..stored };
        assert_eq!(needs(Method::Udvr, linear, &unlit), (1, 0), "of nothing that is lit there are no gradients");
        // By gradient as if lit; projections need none of this.
        let by_gradient = |mode| Needs::new(mode, Sampling::default(), &none, false, true);
        assert_eq!(
            [Mode::Dvr, Mode::Mip].map(|mode| (by_gradient(mode).apron, by_gradient(mode).has_grid)),
            [(2, true), (1, false)]
        );
    }

    #[test]
    fn adaptive_steps_follow_the_difference() {
        let adaptive = Sampling { method: Method::Asm, ..Sampling::default() };
        assert_eq!([0.0, 0.6, 1.0, 1.2, 60.0].map(|steps| adaptive.parts(steps)), [1, 1, 1, 2, MOST_PARTS]);
    }
}
