//! Slices: a plane through the volume, or a slab about it, looked at straight on.
//!
//! A slice is no mode of its own, but the volume between two parallel clip planes, drawn with a projection: the mean, the greatest or the least
//! value between them. Without thickness it is as thin as single precision can resolve, a small part of a voxel: there the mean is the value
//! where the ray meets the plane. So slices are paged, sampled and classified like everything else, touch only the bricks they meet, and work
//! with any camera.
//!
//! With the nearest filter, a thin slab about a face of voxels would show the voxels on both sides. It lies just above the plane there, in the
//! voxels with the plane in their half-open boxes.

use crate::camera::{Camera, Projection, ViewRays};
use crate::clip::{ClipError, ClipPlane};
use crate::ensure::ensure;
use crate::geometry::{Geometry, box_corners};
use crate::placement::Placement;
use crate::space::Extent;
use glam::DVec3;
use serde::{Deserialize, Serialize};

/// A plane through the volume, or a slab of some thickness about it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Slice {
    /// A world point on the plane.
    pub point: DVec3,
    /// Normal of the plane, towards the viewer; of any length but zero.
    pub normal: DVec3,
    /// World distance from one side of the slab to the other; 0 is as thin as possible.
    #[serde(default)]
    pub thickness: f64,
}

impl Slice {
    /// Returns the slice across an axis (0 is x) at a world coordinate, oriented as in images: z slices have x to the right and y downwards, as
    /// stored; y slices x to the right and z upwards; x slices y to the right and z upwards.
    ///
    /// # Panics
    /// If `axis` is more than 2.
    pub fn across(axis: usize, at: f64) -> Self {
        let normal = [DVec3::X, DVec3::NEG_Y, DVec3::NEG_Z][axis];
        Self { point: DVec3::AXES[axis] * at, normal, thickness: 0.0 }
    }

    /// Returns the slice of a patient across an axis (0 is x, to the patient's right) at a world coordinate, in the radiological convention: z
    /// slices from the feet, y slices from the front, x slices from the left. So the patient's left is on the right, and the nose points to the
    /// left.
    pub fn of_patient(axis: usize, at: f64) -> Self {
        let normal = [DVec3::NEG_X, DVec3::Y, DVec3::NEG_Z][axis];
        Self { point: DVec3::AXES[axis] * at, normal, thickness: 0.0 }
    }

    /// Up direction of an image of the slice: z, or -y where the plane is nearer to level than to upright.
    pub fn image_up(&self) -> DVec3 {
        let is_level = self.normal.normalize_or_zero().z.abs() > std::f64::consts::FRAC_1_SQRT_2;
        if is_level { DVec3::NEG_Y } else { DVec3::Z }
    }

    /// Checks that the slice can be shown.
    ///
    /// # Errors
    /// If the thickness is negative or not finite, the normal is zero, or a number of the plane is not finite.
    pub fn check(&self) -> Result<(), ClipError> {
        ensure(self.thickness >= 0.0 && self.thickness.is_finite(), || ClipError::Thickness(self.thickness))?;
        ClipPlane { point: self.point, normal: self.normal }.normalized().map(|_| ())
    }

    /// The two sides of the slab, with inward normals, for a picture of this volume with these rays. `placement` is the volume's, given only with
    /// the nearest filter.
    pub fn sides(
        &self,
        rays: &ViewRays,
        geometry: &Geometry,
        extent: Extent,
        placement: Option<&Placement>,
    ) -> [ClipPlane; 2] {
        let normal = self.normal.normalize_or_zero();
        // Rounding moves a ray's sample point, possibly across a brick's border. The doubled thickness makes the slab meet every brick with
        // possible samples.
        let thinnest_voxels = thinnest_voxels(rays, geometry, extent);
        let thinnest = self.thinnest(rays, geometry, extent);
        let half = 0.5 * self.thickness.max(thinnest);
        // As much again, so all of it is further above the plane than rounding moves a point.
        let above = match placement.filter(|_| self.thickness <= thinnest) {
            Some(placement) => normal * normal.dot(placement.world_vector(geometry.spacing * thinnest_voxels)),
            None => DVec3::ZERO,
        };
        [normal, -normal].map(|normal| ClipPlane { point: self.point + above - normal * half, normal })
    }

    /// Whether the slice is as thin as possible for a picture of this volume with these rays.
    pub fn is_thinnest(&self, rays: &ViewRays, geometry: &Geometry, extent: Extent) -> bool {
        self.thickness <= self.thinnest(rays, geometry, extent)
    }

    /// The thickness of the thinnest slab with this normal, in units of the volume's own world.
    fn thinnest(&self, rays: &ViewRays, geometry: &Geometry, extent: Extent) -> f64 {
        thinnest_voxels(rays, geometry, extent) * (self.normal.normalize_or_zero() * geometry.spacing).length()
    }

    /// Returns an orthographic camera straight in front of the whole slice, in a picture of this size, with `up` as far up as the plane allows.
    pub fn camera(&self, world_box: (DVec3, DVec3), up: DVec3, (width, height): (u32, u32)) -> Camera {
        let normal = self.normal.normalize_or_zero();
        let right = up.cross(normal).normalize_or_zero();
        let upright = normal.cross(right);
        let corners = box_corners(world_box);
        let whole = (world_box.1 - world_box.0).length();
        let size_of = |points: &[DVec3]| {
            let range = |axis: DVec3| {
                let along = points.iter().map(|p| axis.dot(*p - self.point));
                (along.clone().fold(f64::INFINITY, f64::min), along.fold(f64::NEG_INFINITY, f64::max))
            };
            [range(right), range(upright)]
        };
        let mut sides = size_of(&self.outline(&corners));
        if !sides.iter().any(|(low, high)| high - low > 1e-6 * whole) {
            // It passes the volume by.
            sides = size_of(&corners);
        }
        let [(left, right_end), (bottom, top)] = sides;
        let target = self.point + right * (left + right_end) * 0.5 + upright * (bottom + top) * 0.5;
        let world_height = (top - bottom).max((right_end - left) * height as f64 / width as f64);
        // In front of the slab; and not far, for precision.
        let reach = corners.iter().map(|corner| normal.dot(*corner - self.point).abs()).fold(0.0, f64::max);
        let eye = target + normal * (self.thickness.min(2.0 * reach) + world_height);
        Camera { eye, target, up, projection: Projection::Orthographic { height: world_height } }
    }

    /// Intersections of the plane with the edges of the box with these corners.
    fn outline(&self, corners: &[DVec3; 8]) -> Vec<DVec3> {
        let height = |p: DVec3| self.normal.dot(p - self.point);
        let mut points = Vec::new();
        for (i, axis) in (0..8usize).flat_map(|i| (0..3).map(move |axis| (i, axis))) {
            let (a, b) = (corners[i], corners[i | 1 << axis]);
            let (low, high) = (height(a), height(b));
            if i & 1 << axis == 0 && (low <= 0.0) != (high <= 0.0) {
                points.push(a + (b - a) * (low / (low - high)));
            }
        }
        points
    }
}

/// The thickness of the thinnest slices, in voxels, limited for far eyes, where rounding moves points by more.
fn thinnest_voxels(rays: &ViewRays, geometry: &Geometry, extent: Extent) -> f64 {
    const MOST: f64 = 0.25;
    (4.0 * geometry.rounding_voxels(rays.eye, extent)).min(MOST)
}

#[cfg(test)]
mod tests {
    use super::*;

    const BOX: (DVec3, DVec3) = (DVec3::new(-1.0, 2.0, 10.0), DVec3::new(5.0, 4.0, 19.0));

    /// Right and up in the world, and the middle, width and height of the camera's view.
    fn seen(slice: &Slice, size: (u32, u32)) -> (DVec3, DVec3, DVec3, [f64; 2]) {
        let camera = slice.camera(BOX, slice.image_up(), size);
        let rays = camera.rays(size.0, size.1).unwrap();
        let (right, up) = (rays.right.normalize(), rays.up.normalize());
        (right, up, camera.target, [2.0 * rays.right.length(), 2.0 * rays.up.length()])
    }

    #[test]
    fn axes_are_seen_as_images_are() {
        let close = |a: DVec3, b: [f64; 3]| (a - DVec3::from_array(b)).length() < 1e-12;
        let (right, up, middle, size) = seen(&Slice::across(2, 12.0), (300, 300));
        assert!(close(right, [1.0, 0.0, 0.0]) && close(up, [0.0, -1.0, 0.0]) && close(middle, [2.0, 3.0, 12.0]));
        assert!((size[0] - 6.0).abs() < 1e-12 && (size[1] - 6.0).abs() < 1e-12, "{size:?}");
        let (right, up, middle, size) = seen(&Slice::across(1, 2.5), (200, 300));
        assert!(close(right, [1.0, 0.0, 0.0]) && close(up, [0.0, 0.0, 1.0]) && close(middle, [2.0, 2.5, 14.5]));
        assert!((size[0] - 6.0).abs() < 1e-12 && (size[1] - 9.0).abs() < 1e-12, "{size:?}");
        let (right, up, middle, _) = seen(&Slice::across(0, -0.5), (300, 300));
        assert!(close(right, [0.0, 1.0, 0.0]) && close(up, [0.0, 0.0, 1.0]) && close(middle, [-0.5, 3.0, 14.5]));
    }

    /// Rounding moves a point of a ray from there by more than a voxel.
    #[test]
    fn slices_stay_thin_from_far_eyes() {
        let (geometry, extent) = (Geometry::default(), Extent::new(100, 100, 100));
        let slice = Slice { point: DVec3::splat(50.0), normal: DVec3::Z, thickness: 0.0 };
        let eye = DVec3::new(50.0, 50.0, 1e7);
        let camera = Camera { eye, ..slice.camera(geometry.world_box(extent), slice.image_up(), (40, 30)) };
        let rays = camera.rays(40, 30).unwrap();
        assert!(geometry.rounding_voxels(eye, extent) > 1.0);
        for side in slice.sides(&rays, &geometry, extent, None) {
            assert!((side.point.z - 50.0).abs() <= 0.5, "{}", side.point);
        }
    }

    #[test]
    fn oblique_slices_are_seen_whole() {
        let normals = [[1.0, 1.0, 1.0], [-0.3, 0.2, 0.9], [0.0, 5.0, -0.1], [1e-9, 0.0, 1.0], [0.7, 0.0, -0.7]];
        for normal in normals.map(DVec3::from_array) {
            for (thickness, point) in [(0.0, DVec3::new(2.0, 3.0, 14.0)), (7.0, DVec3::new(-0.9, 2.1, 10.1))] {
                let slice = Slice { point, normal, thickness };
                let camera = slice.camera(BOX, slice.image_up(), (400, 300));
                let rays = camera.rays(400, 300).unwrap();
                assert!(rays.forward.dot(normal) < 0.0, "the normal points to the viewer");
                assert!(normal.normalize().dot(camera.eye - point) > thickness * 0.5, "the slab is before the eye");
                let mut fills = 0.0f64;
                for p in slice.outline(&box_corners(BOX)) {
                    let u = rays.right.dot(p - rays.eye) / rays.right.length_squared();
                    let v = rays.up.dot(p - rays.eye) / rays.up.length_squared();
                    assert!(u.abs() < 1.0 + 1e-9 && v.abs() < 1.0 + 1e-9, "{normal} {p}: {u} {v}");
                    fills = fills.max(u.abs()).max(v.abs());
                }
                assert!(fills > 1.0 - 1e-9, "{normal}: the picture is filled");
            }
        }
        // Beside the volume there still is a picture.
        assert!(Slice::across(2, 99.0).camera(BOX, DVec3::NEG_Y, (64, 64)).rays(64, 64).is_ok());
    }

    #[test]
    fn a_slab_lies_about_its_plane() {
        let slice = Slice { thickness: 3.0, ..Slice::across(1, 7.0) };
        let rays = slice.camera(BOX, slice.image_up(), (64, 64)).rays(64, 64).unwrap();
        let extent = Extent::new(6, 2, 9);
        let sides = slice.sides(&rays, &Geometry::default(), extent, None);
        let inside = |y: f64| sides.iter().all(|side| side.height(DVec3::new(1.0, y, 1.0)) >= 0.0);
        assert_eq!([5.49, 5.51, 8.49, 8.51].map(inside), [false, true, true, false]);
        // Without thickness it is thin, but not nothing.
        let thin = Slice::across(1, 7.0).sides(&rays, &Geometry::default(), extent, None);
        let inside = |y: f64| thin.iter().all(|side| side.height(DVec3::new(1.0, y, 1.0)) >= 0.0);
        assert_eq!([6.999, 7.0 - 1e-6, 7.0 + 1e-6, 7.001].map(inside), [false, true, true, false]);
    }

    #[test]
    fn of_the_nearest_voxels_a_thin_slab_is_on_the_upper_side() {
        let extent = Extent::new(6, 2, 9);
        let of = |slice: Slice, placement: &Placement| {
            let rays = slice.camera(BOX, slice.image_up(), (64, 64)).rays(64, 64).unwrap();
            let rounding = Geometry::default().rounding_voxels(rays.eye, extent);
            let [low, high] = slice
                .sides(&rays, &Geometry::default(), extent, Some(placement))
                .map(|side| (side.point - slice.point).dot(slice.normal));
            (low.min(high) / rounding, low.max(high) / rounding)
        };
        let close = |found: (f64, f64), expected: (f64, f64)| {
            assert!((found.0 - expected.0).abs() < 1e-6 && (found.1 - expected.1).abs() < 1e-6, "{found:?}");
        };
        let turned = Placement::from_text("0 0 -1 0  0 1 0 0  1 0 0 0").unwrap();
        // Above in voxels is along z in the world, against the normal; turned, against x.
        close(of(Slice::across(2, 7.0), &Placement::default()), (-6.0, -2.0));
        close(of(Slice { normal: DVec3::X, ..Slice::across(0, 7.0) }, &Placement::default()), (2.0, 6.0));
        close(of(Slice { normal: DVec3::X, ..Slice::across(0, 7.0) }, &turned), (-6.0, -2.0));
        // A slab has its requested thickness, about its plane.
        let (low, high) = of(Slice { thickness: 2.0, ..Slice::across(2, 7.0) }, &Placement::default());
        assert!((low + high).abs() < 1e-3);
    }

    #[test]
    fn impossible_slices_are_refused() {
        let good = Slice::across(0, 1.0);
        assert_eq!(good.check(), Ok(()));
        assert!(matches!(Slice { normal: DVec3::ZERO, ..good }.check(), Err(ClipError::Plane(_))));
        for thickness in [-1.0, f64::NAN, f64::INFINITY] {
            assert!(matches!(Slice { thickness, ..good }.check(), Err(ClipError::Thickness(_))));
        }
    }
}
