//! How a ray's segments are sampled and classified in direct volume rendering, and how the field is filtered: the methods that
//! Gavrilov, Turlapov and others compare in "Measuring the quality of volume rendering" (2013).
//!
//! A method reads the field in the middle of a segment, at its ends, or at its ends and those of its neighbours, and takes
//! the *curve* through what it has read for the field in between. A segment is cut into equal *parts*; each part is classified either
//! by the value in its middle, or by the mean of the transfer function over the values from one of its ends to the other
//! ([pre-integrated](crate::preintegration)). Parts follow one another from front to back.
//!
//! Every place is read in the brick that owns the segment. So [`Needs::apron`] says how far methods reach out of it; steps
//! longer than a voxel reach further, and read what is nearest in the brick.

use crate::enum_all::every;
use crate::gradients::GradientNodes;
use crate::jitter::Jitter;
use crate::lighting::{Lighting, LightingModel};
use crate::mesh::MeshCapacity;
use crate::mode::Mode;
use serde::{Deserialize, Serialize};

/// The widest apron that any picture needs, in voxels.
pub const MAX_REACH: u32 = 4;

/// Default number of virtual samples of a segment: the paper's optimum.
pub const VIRTUAL_SAMPLES: u8 = 3;

/// The most virtual samples that a segment may have.
pub const MOST_VIRTUAL_SAMPLES: u8 = 16;

/// The most parts that [`Method::Asm`] cuts a segment into.
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
    /// Adaptive sampling: as many samples as the difference of the values at the segment's ends asks for.
    Asm,
    /// [`Method::Lvs`] with pre-integrated parts.
    Plvs,
    /// [`Method::Cvs`] with pre-integrated parts.
    Pcvs,
}

/// What a method takes for the field along a segment.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
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
    /// What the method takes for the field along a segment.
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

    /// How far from a segment's middle it reads, in segments.
    const fn reach(self) -> f64 {
        match self.curve() {
            Curve::Middle => 0.0,
            Curve::Line | Curve::Field => 0.5,
            Curve::Cubic => 1.5,
        }
    }
}

/// A filter: how the field is made of voxels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Filter {
    /// The value of the voxel that a place is in: a field of steps, with voxels as they are. A voxel's box is half-open, so that its lower faces
    /// are its own. Steps have no gradient; what is lit, or classified by gradient, takes that of the [`Filter::Trilinear`] field.
    Nearest,
    /// Linear between the eight voxels around a place.
    #[default]
    Trilinear,
    /// The cubic B-spline over the 64 voxels around a place: smooth, but it blurs.
    Tricubic,
}

every!(Filter: Nearest Trilinear Tricubic);

impl Filter {
    /// Voxels that the filter takes on each side of a place, along each axis. The nearest voxel is one of those of the linear filter, so bricks
    /// are the same for both, and a change from one to the other uploads nothing.
    pub const fn taps(self) -> u32 {
        match self {
            Self::Nearest | Self::Trilinear => 1,
            Self::Tricubic => 2,
        }
    }

    /// How far from a place, in voxels, the centres of its outermost voxels can be, less what those inside of the same brick
    /// are: half a voxel less than [`Filter::taps`].
    const fn reach(self) -> f64 {
        self.taps() as f64 - 0.5
    }

    /// How far from a place, in voxels, the nearest face of a voxel can be that the filter takes.
    pub const fn farthest(self) -> f64 {
        match self {
            Self::Nearest => 0.0,
            Self::Trilinear => 0.5,
            Self::Tricubic => 1.5,
        }
    }

    /// The filter of the field whose gradients are taken.
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

/// The cubic curve of Catmull and Rom through four values, at `t` in 0..=1 from the second to the third. It is kept between those two, so that it
/// has no value that was not between samples, and what is known to be clear stays clear.
pub fn cubic([a, b, c, d]: [f64; 4], t: f64) -> f64 {
    let value = catmull_rom([a, b, c, d], t);
    value.clamp(b.min(c), b.max(c))
}

/// The cubic curve of Catmull and Rom through four values, at `t` in 0..=1 from the second to the third. It may leave the range of those two.
pub fn catmull_rom([a, b, c, d]: [f64; 4], t: f64) -> f64 {
    b + 0.5 * t * (c - a + t * (2.0 * a - 5.0 * b + 4.0 * c - d + t * (3.0 * (b - c) + d - a)))
}

/// How rays are sampled: method, filter and jitter.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Sampling {
    /// How segments become media.
    pub method: Method,
    /// Virtual samples of a segment, 1 to [`MOST_VIRTUAL_SAMPLES`]; methods without virtual samples do not use it.
    pub virtual_samples: u8,
    /// How the field is made of voxels.
    pub filter: Filter,
    /// How the lattice of each pixel's ray is moved, so that rays side by side are sampled at different distances.
    pub jitter: Jitter,
}

impl Default for Sampling {
    fn default() -> Self {
        let (method, filter, jitter) = Default::default();
        Self { method, virtual_samples: VIRTUAL_SAMPLES, filter, jitter }
    }
}

impl Sampling {
    /// Number of parts that a segment is cut into. `steps` is the difference of the values at its ends, in the transfer function's [adaptive
    /// steps](crate::TransferTable::adaptive_step); only [`Method::Asm`] depends on it.
    pub fn parts(&self, steps: f64) -> usize {
        match self.method {
            Method::Udvr | Method::Pdvr => 1,
            Method::Lvs | Method::Cvs | Method::Plvs | Method::Pcvs => self.virtual_samples.into(),
            Method::Asm => (steps.ceil() as usize).clamp(1, MOST_PARTS),
        }
    }
}

/// What a picture requires of bricks and of the tables beside them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Needs {
    /// Width of the apron around a brick's core, in voxels.
    pub apron: u32,
    /// Layers of stored gradients outside of a brick's core (see [`GradientNodes`]); 0 if there are no gradients at all.
    pub gradient_layers: u32,
    /// How the field is made of voxels, which decides what values a part of a brick can have.
    pub filter: Filter,
    /// Whether running integrals of the transfer function are among the tables.
    pub is_pre_integrated: bool,
    /// Whether the [grid](crate::TransferGrid) of a transfer function of value and gradient is among the tables.
    pub has_grid: bool,
    /// Size of all meshes that there must be room for.
    pub meshes: MeshCapacity,
}

impl Needs {
    /// The needs of a picture of plain samples: trilinear, unlit, not pre-integrated, without meshes.
    pub const PLAIN: Self = Self {
        apron: 1,
        gradient_layers: 0,
        filter: Filter::Trilinear,
        is_pre_integrated: false,
        has_grid: false,
        meshes: MeshCapacity::NONE,
    };

    /// The needs of a picture without meshes. `has_surfaces` says whether it has isosurfaces, `has_grid` whether a transfer function is one of
    /// value and gradient.
    pub fn new(mode: Mode, sampling: Sampling, lighting: &Lighting, has_surfaces: bool, has_grid: bool) -> Self {
        let filter = sampling.filter;
        let along = match mode {
            Mode::Dvr if has_surfaces => sampling.method.reach().max(Method::Lvs.reach()),
            Mode::Dvr => sampling.method.reach(),
            Mode::Mip | Mode::MinIp | Mode::Average => 0.0,
            Mode::Isosurface => Method::Lvs.reach(),
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

    /// The layout of the gradients that are stored with a brick's core of `edge` voxels.
    pub const fn gradients(&self, edge: u32) -> GradientNodes {
        GradientNodes { edge, layers: self.gradient_layers }
    }

    /// Needs that suffice for the pictures of both `self` and `other`.
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
        // By gradient as if it were lit; projections have nothing of that.
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
