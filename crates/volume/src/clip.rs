//! Clipping: the shown part of a volume, inside a box and on the inner sides of planes, all in the world.
//!
//! Renderers shorten a ray's stretch by box and planes before cutting it into segments (see [`lattice`](crate::lattice)). The first and the last
//! segment end just there, so oblique cuts are as smooth as the volume's own faces; beyond this, only the lighting of [cut faces](crate::CutFace)
//! depends on clipping. The pager leaves out bricks wholly outside. Clipping costs a few products per ray and plane. On a GPU
//! `shaders/wgsl/shared/ray.wgsl` (`shown`) does the same.

use crate::ensure::ensure;
use crate::geometry::Geometry;
use crate::lattice::Lattice;
use crate::mode::Mode;
use crate::placement::Placement;
use crate::ray::Ray;
use crate::space::Extent;
use glam::DVec3;
use serde::{Deserialize, Serialize};

/// The most clip planes of a scene.
pub const MAX_CLIP_PLANES: usize = 6;

/// The most clip planes of a layer in a picture: the scene's own, two sides of its slice, and six sides of its box for a volume askew to the scene's
/// world.
pub const MAX_PLANES: usize = MAX_CLIP_PLANES + 2 + 6;

/// A clip plane in the world. The half-space in front of it, plane included, is shown.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ClipPlane {
    /// A world point on the plane.
    pub point: DVec3,
    /// Normal of the plane, towards the shown side; of any length but zero.
    pub normal: DVec3,
}

impl ClipPlane {
    /// Signed distance of a point from the plane, times the normal's length; not negative on the shown side.
    pub fn height(&self, point: DVec3) -> f64 {
        self.normal.dot(point - self.point)
    }

    /// Returns this plane with a normal of length 1.
    ///
    /// # Errors
    /// If a number is not finite or the normal has no length.
    pub fn normalized(&self) -> Result<Self, ClipError> {
        let normal = self.normal.try_normalize().filter(|_| self.point.is_finite() && self.normal.is_finite());
        Ok(Self { normal: normal.ok_or(ClipError::Plane(*self))?, ..*self })
    }
}

/// Why a clip box, a clip plane or a slice cannot be used.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum ClipError {
    /// The clip box is empty, or a corner is not finite.
    #[error("the clip box from {low} to {high} is empty: expected low below high")]
    Box {
        /// The corner that should be the lower one.
        low: DVec3,
        /// The corner that should be the upper one.
        high: DVec3,
    },
    /// The plane's normal is zero, or a number is not finite.
    #[error(
        "the plane through {} with normal {}: expected finite numbers, and a normal that is not zero", .0.point, .0.normal
    )]
    Plane(ClipPlane),
    /// There are too many clip planes; the number is their count.
    #[error("{0} clip planes: expected at most {MAX_CLIP_PLANES}")]
    Planes(usize),
    /// The slice's thickness is negative or not finite.
    #[error("the slice's thickness is {0}: expected a positive number, or 0 for the thinnest slice")]
    Thickness(f64),
    /// The mode cannot show a slice, as it does not give one value per pixel.
    #[error("a slice shows one value per pixel, which mode {} does not have: expected average, mip or minip", .0.name())]
    SliceMode(Mode),
}

/// The shown part of space: the inside of a box, on the inner sides of all planes.
#[derive(Clone, Debug, PartialEq)]
pub struct Clip {
    low: DVec3,
    high: DVec3,
    /// Normals have length 1 in the scene's world.
    planes: Vec<ClipPlane>,
}

impl Clip {
    /// A box without bounds, and no planes.
    const EVERYTHING: Self = Self { low: DVec3::NEG_INFINITY, high: DVec3::INFINITY, planes: Vec::new() };

    /// Clips to the box between two world corners, the lower one first, and to the inner sides of planes. Without corners the box has no bounds.
    ///
    /// # Errors
    /// If the box is empty or not finite, a plane cannot be normalised, or there are more than [`MAX_PLANES`] planes.
    pub fn new(corners: Option<[DVec3; 2]>, planes: &[ClipPlane]) -> Result<Self, ClipError> {
        let [low, high] = corners.unwrap_or([DVec3::NEG_INFINITY, DVec3::INFINITY]);
        let is_box = low.is_finite() && high.is_finite() && low.cmplt(high).all();
        ensure(corners.is_none() || is_box, || ClipError::Box { low, high })?;
        ensure(planes.len() <= MAX_PLANES, || ClipError::Planes(planes.len()))?;
        let planes = planes.iter().map(ClipPlane::normalized).collect::<Result<_, _>>()?;
        Ok(Self { low, high, planes })
    }

    /// Intersects `clip`, of the scene's world, with `crop`, two corners of a box in the volume's own world. The result is in the volume's own world;
    /// `None` shows everything.
    ///
    /// # Errors
    /// If the crop box is empty or not finite.
    pub fn in_volume(
        clip: Option<&Self>,
        placement: &Placement,
        crop: Option<[DVec3; 2]>,
    ) -> Result<Option<Self>, ClipError> {
        let cropped = crop.map(|crop| Self::new(Some(crop), &[])).transpose()?;
        let Some(clip) = clip else { return Ok(cropped) };
        let mut own = cropped.unwrap_or(Self::EVERYTHING);
        if placement.is_identity() {
            // An empty box shows nothing, as it should.
            own = Self { low: own.low.max(clip.low), high: own.high.min(clip.high), planes: clip.planes.clone() };
            return Ok(Some(own));
        }
        let is_bounded = clip.low.is_finite();
        let sides = DVec3::AXES.into_iter().flat_map(|axis| {
            [ClipPlane { point: clip.low, normal: axis }, ClipPlane { point: clip.high, normal: -axis }]
        });
        let planes = clip.planes.iter().copied().chain(sides.filter(|_| is_bounded));
        let placed = |ClipPlane { point, normal }| ClipPlane {
            point: placement.volume_from_world(point),
            normal: placement.volume_normal(normal),
        };
        own.planes = planes.map(placed).collect();
        Ok(Some(own))
    }

    /// Shrinks this clip of a volume's own world by a hair where it cuts through the volume. A cut on a face of voxels then lies in the shown voxels
    /// although rounding moves the points of rays: with the nearest filter no voxel behind the cut shows. The hair is single precision's error of a
    /// point on a ray from `eye`, but at most a hundredth of a voxel and of the distance between two sides, so it stays invisible.
    pub fn inside_voxels(self, geometry: &Geometry, extent: Extent, eye: DVec3) -> Self {
        const MOST_SHARE: f64 = 0.01;
        let hair = geometry.spacing * (0.4 * geometry.rounding_voxels(eye, extent)).min(MOST_SHARE);
        let volume = geometry.world_box(extent);
        let of_box = hair.min((self.high.min(volume.1) - self.low.max(volume.0)).max(DVec3::ZERO) * MOST_SHARE);
        let low = DVec3::select(self.low.cmpgt(volume.0), self.low + of_box, self.low);
        let high = DVec3::select(self.high.cmplt(volume.1), self.high - of_box, self.high);
        let inward = |plane: &ClipPlane| {
            let length = plane.normal.length();
            // Planes that face each other leave a slab; on others a hair makes no visible difference.
            let faces = |other: &&ClipPlane| plane.normal.dot(other.normal) < -0.999 * length * other.normal.length();
            let slabs = self.planes.iter().filter(faces).map(|other| plane.height(other.point) / length);
            let thinnest = slabs.fold(f64::INFINITY, f64::min).max(0.0);
            let by = (plane.normal.abs().dot(hair) / length).min(MOST_SHARE * thinnest);
            let lowest = DVec3::select(plane.normal.cmpge(DVec3::ZERO), volume.0, volume.1);
            let is_cut = plane.height(lowest) < -by * length;
            let by = if is_cut { by } else { 0.0 };
            ClipPlane { point: plane.point + plane.normal * (by / length), ..*plane }
        };
        Self { low, high, planes: self.planes.iter().map(inward).collect() }
    }

    /// Adds two planes of the scene's world to a clip of a volume's own world; `None` is a clip without bounds.
    ///
    /// # Errors
    /// If a plane cannot be normalised.
    pub fn between(clip: Option<Self>, sides: &[ClipPlane; 2], placement: &Placement) -> Result<Self, ClipError> {
        let mut clip = clip.unwrap_or(Self::EVERYTHING);
        let slab = Self::in_volume(Some(&Self::new(None, sides)?), placement, None)?;
        clip.planes.extend(slab.into_iter().flat_map(|slab| slab.planes));
        Ok(clip)
    }

    /// The lower and the upper corner of the clip box; infinite where it has no bounds.
    pub fn corners(&self) -> [DVec3; 2] {
        [self.low, self.high]
    }

    /// The clip planes. Their normals have length 1 in the scene's world, but not always in a volume's own.
    pub fn planes(&self) -> &[ClipPlane] {
        &self.planes
    }

    /// Whether a part of the box from `low` to `high` may be shown. False only if the box misses the clip box, or if their intersection lies wholly
    /// outside one plane.
    pub fn meets_box(&self, low: DVec3, high: DVec3) -> bool {
        let (low, high) = (low.max(self.low), high.min(self.high));
        let farthest = |plane: &ClipPlane| DVec3::select(plane.normal.cmpge(DVec3::ZERO), high, low);
        low.cmplt(high).all() && self.planes.iter().all(|plane| plane.height(farthest(plane)) >= 0.0)
    }

    /// Whether a side of the clip box or a plane meets the box from `low` to `high`.
    pub fn cuts_box(&self, low: DVec3, high: DVec3) -> bool {
        let corner = |plane: &ClipPlane, is_far: bool| {
            let (along, against) = if is_far { (high, low) } else { (low, high) };
            DVec3::select(plane.normal.cmpge(DVec3::ZERO), along, against)
        };
        let side = |side: DVec3| (side.cmpge(low) & side.cmple(high)).any();
        let is_cut =
            |plane: &ClipPlane| plane.height(corner(plane, false)) <= 0.0 && plane.height(corner(plane, true)) >= 0.0;
        side(self.low) || side(self.high) || self.planes.iter().any(is_cut)
    }

    /// Whether the clip may cut a segment of a ray from the scene's `eye` with its middle in the box `own`. The segment belongs to the
    /// box even if the clip misses the box itself. `placement` belongs to the clip's world.
    pub fn cuts_segments(&self, own: (DVec3, DVec3), lattice: &Lattice, placement: &Placement, eye: DVec3) -> bool {
        let (nearest, farthest) = placement.world_box(own);
        let (_, least_stretch) = placement.stretches();
        let reach = lattice.reach((eye - nearest).abs().max((eye - farthest).abs()).length()) / least_stretch;
        self.cuts_box(own.0 - reach, own.1 + reach)
    }

    /// Shortens a ray's stretch `(from, to)` to the inner sides of all planes, ignoring the clip box; an empty stretch ends where it begins, or
    /// before.
    pub fn shorten(&self, ray: &Ray, (mut from, mut to): (f64, f64)) -> (f64, f64) {
        for plane in &self.planes {
            let (height, rise) = (plane.height(ray.origin), plane.normal.dot(ray.direction));
            if rise > 0.0 {
                from = from.max(-height / rise);
            } else if rise < 0.0 {
                to = to.min(-height / rise);
            } else if height < 0.0 {
                to = from;
            }
        }
        (from, to)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn plane(point: [f64; 3], normal: [f64; 3]) -> ClipPlane {
        ClipPlane { point: point.into(), normal: normal.into() }
    }

    #[test]
    fn what_cannot_clip_is_refused() {
        let [zero, one] = [DVec3::ZERO, DVec3::ONE];
        for corners in [[one, zero], [zero, zero], [zero, DVec3::INFINITY], [DVec3::NAN, one]] {
            assert!(matches!(Clip::new(Some(corners), &[]), Err(ClipError::Box { .. })), "{corners:?}");
        }
        let good = plane([1.0, 2.0, 3.0], [0.0, -2.0, 0.0]);
        assert_eq!(Clip::new(None, &[good]).unwrap().planes()[0].normal, DVec3::NEG_Y);
        for bad in
            [plane([0.0; 3], [0.0; 3]), plane([f64::NAN; 3], [1.0; 3]), plane([0.0; 3], [1.0, f64::INFINITY, 0.0])]
        {
            assert!(matches!(Clip::new(None, &[good, bad]), Err(ClipError::Plane(_))), "{bad:?}");
        }
        assert!(Clip::new(None, &[good; MAX_PLANES]).is_ok());
        assert_eq!(Clip::new(None, &[good; MAX_PLANES + 1]), Err(ClipError::Planes(MAX_PLANES + 1)));
    }

    #[test]
    fn a_plane_holds_what_it_touches() {
        let ray = |origin, direction| Ray { origin, direction };
        let clip = Clip::new(None, &[plane([2.0, 0.0, 0.0], [4.0, 0.0, 0.0])]).unwrap();
        assert_eq!(clip.shorten(&ray(DVec3::ZERO, DVec3::X), (0.0, 9.0)), (2.0, 9.0));
        assert_eq!(clip.shorten(&ray(DVec3::X * 5.0, DVec3::NEG_X), (0.0, 9.0)), (0.0, 3.0));
        // Along the plane: all or nothing.
        assert_eq!(clip.shorten(&ray(DVec3::X * 2.0, DVec3::Y), (1.0, 9.0)), (1.0, 9.0));
        assert_eq!(clip.shorten(&ray(DVec3::X * 1.9, DVec3::Y), (1.0, 9.0)), (1.0, 1.0));
    }

    #[test]
    fn a_plane_that_the_clip_box_keeps_away_hides_the_box() {
        // The plane has a corner of the box, but not of its intersection with the clip box.
        let clip =
            Clip::new(Some([DVec3::ZERO, DVec3::splat(0.5)]), &[plane([1.6, 0.0, 0.0], [1.0, 1.0, 0.0])]).unwrap();
        assert!(!clip.meets_box(DVec3::ZERO, DVec3::ONE));
        let unbounded = Clip::new(None, clip.planes()).unwrap();
        assert!(unbounded.meets_box(DVec3::ZERO, DVec3::ONE) && !unbounded.meets_box(DVec3::ZERO, DVec3::splat(0.7)));
    }

    fn vector() -> impl Strategy<Value = DVec3> {
        prop::array::uniform3(-1.0f64..1.0).prop_map(DVec3::from_array)
    }

    proptest! {
        /// A point of a ray is inside all planes exactly where it is on the shortened stretch, and its box is then met.
        #[test]
        fn stretches_hold_what_is_inside(
            planes in prop::collection::vec((vector(), vector()), 0..MAX_PLANES), origin in vector(), direction in vector(),
            t in 0.0f64..3.0, size in 0.0f64..1.0,
        ) {
            prop_assume!(direction.length() > 0.01 && planes.iter().all(|(_, normal)| normal.length() > 0.01));
            let planes: Vec<_> = planes.into_iter().map(|(point, normal)| ClipPlane { point, normal }).collect();
            let clip = Clip::new(None, &planes).unwrap();
            let ray = Ray { origin: origin * 2.0, direction: direction.normalize() };
            let point = ray.origin + ray.direction * t;
            let least = clip.planes().iter().map(|plane| plane.height(point)).fold(f64::INFINITY, f64::min);
            // Rounding decides about points on a plane.
            prop_assume!(least.abs() > 1e-9);
            let (from, to) = clip.shorten(&ray, (0.0, 3.0));
            prop_assert_eq!(least > 0.0, from <= t && t <= to, "{} in {}..{}", t, from, to);
            prop_assert!(least < 0.0 || clip.meets_box(point - size, point + 1e-6));
        }

        /// A box with points on both sides of a plane, or of the clip box, is cut.
        #[test]
        fn boxes_are_cut_that_have_both_sides(
            at in vector(), normal in vector(), low in vector(), size in prop::array::uniform3(0.01f64..1.5),
            shares in prop::collection::vec(prop::array::uniform3(0.0f64..1.0), 30), is_box in any::<bool>(),
        ) {
            prop_assume!(normal.length() > 0.01);
            let plane = ClipPlane { point: at, normal };
            let corners = [at, at + normal.abs() + 0.01];
            let clip = if is_box { Clip::new(Some(corners), &[]) } else { Clip::new(None, &[plane]) }.unwrap();
            let size = DVec3::from_array(size);
            let is_shown = |p: &DVec3| match is_box {
                true => p.cmpge(corners[0]).all() && p.cmple(corners[1]).all(),
                false => plane.height(*p) >= 0.0,
            };
            let points: Vec<bool> = shares.iter().map(|share| is_shown(&(low + size * DVec3::from_array(*share)))).collect();
            let is_mixed = points.contains(&true) && points.contains(&false);
            prop_assert!(!is_mixed || clip.cuts_box(low, low + size));
            // A box before or behind the plane is not cut.
            for side in [-5.0, 5.0] {
                let (away, half) = (at + side * normal.normalize(), DVec3::splat(0.5));
                prop_assert!(is_box || !clip.cuts_box(away - half, away + half));
            }
        }
    }

    #[test]
    fn a_placed_volume_shows_what_is_shown_of_the_world() {
        let placement = Placement::from_text("0 -2 0 1  1 0.5 0 2  0 0 3 3").expect("a map");
        let clip =
            Clip::new(Some([DVec3::new(-3.0, 0.0, 1.0), DVec3::new(2.0, 4.0, 9.0)]), &[plane([0.0; 3], [1.0; 3])]);
        let clip = clip.expect("a clip");
        let crop = [DVec3::ZERO, DVec3::splat(1.5)];
        let own = Clip::in_volume(Some(&clip), &placement, Some(crop)).unwrap().unwrap();
        let is_in = |clip: &Clip, p: DVec3| {
            p.cmpge(clip.low).all()
                && p.cmplt(clip.high).all()
                && clip.planes.iter().all(|plane| plane.height(p) >= 0.0)
        };
        let mut inside = 0;
        for i in 0..1000 {
            let own_point = DVec3::new((i % 10) as f64, (i / 10 % 10) as f64, (i / 100) as f64) * 0.31 - 0.77;
            let is_cropped = own_point.cmpge(crop[0]).all() && own_point.cmplt(crop[1]).all();
            let expected = is_cropped && is_in(&clip, placement.world_from_volume(own_point));
            assert_eq!(is_in(&own, own_point), expected, "{own_point}");
            inside += expected as u32;
        }
        assert!(inside > 20, "{inside}");
        assert_eq!(Clip::in_volume(None, &placement, None), Ok(None));
        assert!(Clip::in_volume(None, &placement, Some([DVec3::ONE, DVec3::ZERO])).is_err());
        let plain = Clip::in_volume(Some(&clip), &Placement::default(), Some(crop)).unwrap().unwrap();
        assert_eq!(plain.corners(), [DVec3::new(0.0, 0.0, 1.0), DVec3::splat(1.5)]);
    }
}
