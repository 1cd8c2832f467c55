//! The camera: its place, the ray of every pixel, the world size of a pixel, and the frustum.

use crate::ensure::ensure;
use crate::geometry::box_corners;
use crate::numbers::exact;
use crate::placement::Placement;
use crate::ray::Ray;
use Projection::{Orthographic, Perspective};
use glam::{DMat3, DQuat, DVec2, DVec3};
use serde::{Deserialize, Serialize};

/// The least opening angle of a perspective camera, degrees.
pub const LEAST_FOV_DEG: f64 = 0.001;

/// How rays leave the camera.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Projection {
    /// Rays meet in the eye.
    Perspective {
        /// Full vertical opening angle in degrees: at least [`LEAST_FOV_DEG`], and less than 180.
        fov_y_deg: f64,
    },
    /// Rays are parallel and start on the plane through the eye.
    Orthographic {
        /// World height of the picture.
        height: f64,
    },
}

/// A camera in world space.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Camera {
    /// World position of the eye.
    pub eye: DVec3,
    /// World position the camera looks at.
    pub target: DVec3,
    /// The picture's up direction, as far as possible: any non-zero vector not along the view direction.
    pub up: DVec3,
    /// Perspective or orthographic projection.
    pub projection: Projection,
}

/// Why a camera cannot be used.
#[derive(Debug, thiserror::Error, PartialEq)]
pub enum CameraError {
    /// Eye and target coincide, or a coordinate is not finite.
    #[error("the camera's eye {eye} and target {target} give no direction")]
    NoDirection {
        /// World position of the camera's eye.
        eye: DVec3,
        /// World position of the camera's target.
        target: DVec3,
    },
    /// The up vector is zero or along the view direction.
    #[error("the camera's up vector {0} is zero or along the view direction: choose another")]
    Up(DVec3),
    /// The projection's opening angle or height is out of range; the text names it.
    #[error("{0}")]
    Projection(String),
    /// The picture has no pixel; the numbers are its width and height.
    #[error("a picture of {0}x{1} pixels: expected at least one each way")]
    Size(u32, u32),
}

/// Unit vector towards the default camera: 30 degrees from -y to +x, and raised by 20.
fn oblique() -> DVec3 {
    let (azimuth, elevation) = (30f64.to_radians(), 20f64.to_radians());
    DVec3::new(azimuth.sin() * elevation.cos(), -azimuth.cos() * elevation.cos(), elevation.sin())
}

impl Camera {
    /// Returns a perspective camera with the whole box in view from -y, a little from the right and from above, z up.
    pub fn looking_at_box(world_box: (DVec3, DVec3)) -> Self {
        Self::looking_from(oblique(), DVec3::Z, world_box)
    }

    /// Returns a perspective camera with a patient's whole box in view: from the front, a little from the patient's left and from above.
    pub fn looking_at_patient(world_box: (DVec3, DVec3)) -> Self {
        let DVec3 { x, y, z } = oblique();
        Self::looking_from(DVec3::new(-x, -y, z), DVec3::Z, world_box)
    }

    /// Returns a perspective camera with the whole box in view; `from` points to the viewer.
    pub fn looking_from(from: DVec3, up: DVec3, (low, high): (DVec3, DVec3)) -> Self {
        let centre = (low + high) * 0.5;
        let radius = (high - low).length() * 0.5;
        let fov_y_deg = 30.0f64;
        let distance = radius / (fov_y_deg * 0.5).to_radians().sin();
        Self { eye: centre + from * distance, target: centre, up, projection: Perspective { fov_y_deg } }
    }

    /// Moves a perspective camera along its view until the box just fits into a picture of this size, with a margin; other cameras are unchanged. A
    /// box off the target's centre fits too, but leaves more of the picture empty. A picture wider than high counts as square, so windows and
    /// pictures of equal height show the same.
    pub fn fitted(&self, world_box: (DVec3, DVec3), size_px: (u32, u32)) -> Self {
        /// Share of the picture for the box, along each side.
        const FILLED: f64 = 0.94;
        let (width, height) = size_px;
        let (Perspective { .. }, Ok(rays)) = (self.projection, self.rays(width.min(height), height)) else {
            return *self;
        };
        let needed = box_corners(world_box).into_iter().map(|corner| {
            let by = corner - self.target;
            // Sideways offset, where the picture's edge is at 1, at distance 1.
            let aside = [rays.right, rays.up].map(|edge| (by.dot(edge) / edge.length_squared()).abs());
            aside[0].max(aside[1]) / FILLED - by.dot(rays.forward)
        });
        let distance = needed.fold(0.0, f64::max);
        if distance > 0.0 { Self { eye: self.target - rays.forward * distance, ..*self } } else { *self }
    }

    /// Returns this camera turned by `angle_deg` degrees around its target, about its up vector.
    pub fn orbited(&self, angle_deg: f64) -> Self {
        let turn = DQuat::from_axis_angle(self.up.normalize_or_zero(), angle_deg.to_radians());
        Self { eye: self.target + turn * (self.eye - self.target), ..*self }
    }

    /// Interpolates between two cameras, `t` from 0 to 1, turning about the target the shorter way round, so two cameras of an orbit stay on it.
    /// Targets move straight; distances, opening angles and heights change at a constant ratio.
    ///
    /// # Errors
    /// If either camera cannot be used, or one is perspective and the other orthographic.
    pub fn between(&self, other: &Self, t: f64) -> Result<Self, CameraError> {
        let mix = |from: f64, to: f64| from * (to / from).powf(t);
        let projection = match (self.projection, other.projection) {
            (Perspective { fov_y_deg: from }, Perspective { fov_y_deg: to }) => {
                Perspective { fov_y_deg: mix(from, to) }
            }
            (Orthographic { height: from }, Orthographic { height: to }) => Orthographic { height: mix(from, to) },
            _ => {
                let problem = "a perspective and an orthographic view cannot be mixed: give all cameras one kind";
                return Err(CameraError::Projection(problem.into()));
            }
        };
        let turn = self.turn()?.slerp(other.turn()?, t);
        let distance = mix(self.eye.distance(self.target), other.eye.distance(other.target));
        let target = self.target.lerp(other.target, t);
        Ok(Self { eye: target + turn * DVec3::Z * distance, target, up: turn * DVec3::Y, projection })
    }

    /// The rotation from the axes x, y and z to the picture's right, its up, and the viewer.
    fn turn(&self) -> Result<DQuat, CameraError> {
        let ViewRays { right, up, forward, .. } = self.rays(1, 1)?;
        Ok(DQuat::from_mat3(&DMat3::from_cols(right.normalize(), up.normalize(), -forward)))
    }

    /// Returns the rays of a picture of `width` x `height` square pixels.
    ///
    /// # Errors
    /// If the picture has no pixel, eye and target give no direction, up is zero or along the view, or the projection's angle or height is out of
    /// range.
    pub fn rays(&self, width: u32, height: u32) -> Result<ViewRays, CameraError> {
        ensure(width > 0 && height > 0, || CameraError::Size(width, height))?;
        let forward = (self.target - self.eye).try_normalize();
        let forward = forward.filter(|_| self.eye.is_finite() && self.target.is_finite());
        let forward = forward.ok_or(CameraError::NoDirection { eye: self.eye, target: self.target })?;
        let right = forward.cross(self.up.normalize_or_zero());
        // The sine of the angle between up and the view: below a millionth the picture's roll is noise.
        let right = right.try_normalize().filter(|_| right.length() > 1e-6).ok_or(CameraError::Up(self.up))?;
        let up = right.cross(forward);
        let half_height = match self.projection {
            Perspective { fov_y_deg } if (LEAST_FOV_DEG..180.0).contains(&fov_y_deg) => {
                Ok((fov_y_deg * 0.5).to_radians().tan())
            }
            Orthographic { height } if height > 0.0 && height.is_finite() => Ok(height * 0.5),
            Perspective { fov_y_deg } => {
                let fov = exact(fov_y_deg, false);
                Err(format!("a field of view of {fov}: expected degrees, from {LEAST_FOV_DEG} to less than 180"))
            }
            Orthographic { height } => Err(format!("an orthographic height of {height}: expected a positive one")),
        };
        let half_height = half_height.map_err(CameraError::Projection)?;
        let half_width = half_height * width as f64 / height as f64;
        let orthographic = matches!(self.projection, Orthographic { .. });
        Ok(ViewRays {
            eye: self.eye,
            forward,
            right: right * half_width,
            up: up * half_height,
            lean: DVec2::ZERO,
            orthographic,
            width,
            height,
        })
    }
}

/// A camera resolved for one picture size.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ViewRays {
    /// World position of the eye.
    pub eye: DVec3,
    /// Unit view direction, at right angles to the picture's plane.
    pub forward: DVec3,
    /// World vector from the picture's centre to its right edge: at distance 1 in perspective, on the eye plane in orthographic views.
    pub right: DVec3,
    /// World vector from the picture's centre to its top edge: at distance 1 in perspective, on the eye plane in orthographic views.
    pub up: DVec3,
    /// Lean of the rays to the right and up, in units of `right` and `up` per unit forward: 0 except for stereo eyes and rays off the centres of
    /// pixels.
    pub lean: DVec2,
    /// Whether rays are parallel.
    pub orthographic: bool,
    /// Picture width in pixels.
    pub width: u32,
    /// Picture height in pixels.
    pub height: u32,
}

impl ViewRays {
    /// Returns the ray through a point of the picture in pixels: pixel `(i, j)` has its centre at `(i + 0.5, j + 0.5)`, row 0 is the top.
    pub fn ray(&self, x_px: f64, y_px: f64) -> Ray {
        let u = 2.0 * x_px / self.width as f64 - 1.0;
        let v = 1.0 - 2.0 * y_px / self.height as f64;
        if self.orthographic {
            Ray { origin: self.eye + self.right * u + self.up * v, direction: self.middle() }
        } else {
            let offset = self.right * (u + self.lean.x) + self.up * (v + self.lean.y);
            Ray { origin: self.eye, direction: (self.forward + offset).normalize() }
        }
    }

    /// Projects a world point to its pixel: the ray through there passes the point. `None` if the point is not in front of a perspective eye.
    pub fn pixel(&self, point: DVec3) -> Option<[f64; 2]> {
        let from_eye = point - self.eye;
        let depth = from_eye.dot(self.forward);
        if !self.orthographic && depth <= 0.0 {
            return None;
        }
        let scale = if self.orthographic { 1.0 } else { depth };
        let u = (from_eye.dot(self.right) / self.right.length_squared() - depth * self.lean.x) / scale;
        let v = (from_eye.dot(self.up) / self.up.length_squared() - depth * self.lean.y) / scale;
        Some([(1.0 + u) * 0.5 * self.width as f64, (1.0 - v) * 0.5 * self.height as f64])
    }

    /// Unit direction of the ray through the picture's centre; all rays of an orthographic view have it.
    pub fn middle(&self) -> DVec3 {
        self.straight().normalize()
    }

    /// Returns the rays of an eye `by` world units farther to the right, with all points of the plane at `distance` ahead in the same pixels:
    /// off-axis in perspective, oblique in orthographic views.
    pub fn from_aside(&self, by: f64, distance: f64) -> Self {
        let by = by / self.right.length();
        Self { eye: self.eye + self.right * by, lean: self.lean - DVec2::X * (by / distance), ..*self }
    }

    /// Returns the rays shifted by this many pixels to the right and down in the picture.
    pub fn moved_by_px(&self, [right_px, down_px]: [f64; 2]) -> Self {
        let (right, up) = (2.0 * right_px / self.width as f64, -2.0 * down_px / self.height as f64);
        if self.orthographic {
            Self { eye: self.eye + self.right * right + self.up * up, ..*self }
        } else {
            Self { lean: self.lean + DVec2::new(right, up), ..*self }
        }
    }

    /// The direction of the ray through the picture's centre, 1 long along `forward`.
    fn straight(&self) -> DVec3 {
        self.forward + self.right * self.lean.x + self.up * self.lean.y
    }

    /// World size of one pixel at distance `t` from the eye, at the picture's centre.
    pub fn pixel_size(&self, t: f64) -> f64 {
        let height = 2.0 * self.up.length() / self.height as f64;
        if self.orthographic { height } else { height * t }
    }

    /// All pixels of the picture.
    pub fn whole(&self) -> PixelRect {
        PixelRect { x0: 0, x1: self.width, y0: 0, y1: self.height }
    }

    /// The view frustum of the picture.
    pub fn frustum(&self) -> Frustum {
        self.frustum_of(self.whole())
    }

    /// The view frustum of a rectangle of pixels.
    pub fn frustum_of(&self, PixelRect { x0, x1, y0, y1 }: PixelRect) -> Frustum {
        let middle = self.middle();
        let [left, right] = [x0, x1].map(|x| self.right * (2.0 * x as f64 / self.width as f64 - 1.0));
        let [top, bottom] = [y0, y1].map(|y| self.up * (1.0 - 2.0 * y as f64 / self.height as f64));
        let side = |edge: DVec3, along: DVec3, outward: DVec3| {
            // A plane through the edge; its normal points inward.
            let (through, outermost) =
                if self.orthographic { (self.eye + edge, middle) } else { (self.eye, self.straight() + edge) };
            let normal = along.cross(outermost).normalize();
            let normal = if normal.dot(outward) > 0.0 { -normal } else { normal };
            (normal, -normal.dot(through))
        };
        let planes = [
            side(right, self.up, self.right),
            side(left, self.up, -self.right),
            side(top, self.right, self.up),
            side(bottom, self.right, -self.up),
            (self.forward, -self.forward.dot(self.eye)),
        ];
        Frustum { planes }
    }
}

/// The pixels in columns `x0..x1` of rows `y0..y1`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PixelRect {
    /// The first column.
    pub x0: u32,
    /// One past the last column.
    pub x1: u32,
    /// The first row.
    pub y0: u32,
    /// One past the last row.
    pub y1: u32,
}

impl PixelRect {
    /// Whether the two share a pixel.
    pub const fn meets(&self, other: &Self) -> bool {
        self.x0 < other.x1 && other.x0 < self.x1 && self.y0 < other.y1 && other.y0 < self.y1
    }
}

/// A view frustum of five planes `(normal, offset)`: left, right, top, bottom, and the one through the eye. Normals point inward: a point `p` is
/// inside where `normal . p + offset >= 0` for all planes.
#[derive(Clone, Copy, Debug)]
pub struct Frustum {
    planes: [(DVec3, f64); 5],
}

impl Frustum {
    /// Transforms this frustum from the scene's world to a volume's own.
    pub fn in_volume(&self, placement: &Placement) -> Self {
        let origin = placement.world_from_volume(DVec3::ZERO);
        let plane = |(normal, offset): (DVec3, f64)| (placement.volume_normal(normal), offset + normal.dot(origin));
        Self { planes: self.planes.map(plane) }
    }

    /// Whether the box may be visible: false only if it lies wholly outside one plane.
    pub fn meets_box(&self, low: DVec3, high: DVec3) -> bool {
        self.planes.iter().all(|(normal, offset)| {
            let farthest = DVec3::select(normal.cmpge(DVec3::ZERO), high, low);
            normal.dot(farthest) + offset >= 0.0
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera(projection: Projection) -> Camera {
        Camera { eye: DVec3::new(0.0, 0.0, -10.0), target: DVec3::ZERO, up: DVec3::Y, projection }
    }

    #[test]
    fn the_corner_pixels_see_the_field_of_view() {
        let rays = camera(Projection::Perspective { fov_y_deg: 90.0 }).rays(200, 100).unwrap();
        let top = rays.ray(100.0, 0.0).direction;
        assert!((top.y - top.z).abs() < 1e-12 && top.x.abs() < 1e-12, "{top}");
        // Looking along +z with y up, x grows to the left (right-handed).
        assert!(rays.ray(200.0, 50.0).direction.x < -0.89);
        assert!((rays.pixel_size(10.0) - 0.2).abs() < 1e-12);
        let ortho = camera(Projection::Orthographic { height: 4.0 }).rays(200, 100).unwrap();
        assert_eq!(ortho.ray(100.0, 0.0).origin, DVec3::new(0.0, 2.0, -10.0));
        assert_eq!(ortho.pixel_size(123.0), 0.04);
    }

    /// The frustum of some pixels keeps their rays' hits, and excludes boxes seen by other pixels only.
    #[test]
    fn the_frustum_of_some_pixels_is_theirs() {
        let projections = [Projection::Perspective { fov_y_deg: 40.0 }, Projection::Orthographic { height: 6.0 }];
        for (projection, by) in projections.into_iter().flat_map(|p| [0.0, 1.5, -1.5].map(|by| (p, by))) {
            let rays = camera(projection).rays(64, 48).unwrap().from_aside(by, 10.0);
            for window in [(0, 64, 0, 48), (10, 20, 30, 31), (63, 64, 0, 1), (0, 5, 40, 48)] {
                let (x0, x1, y0, y1) = window;
                let frustum = rays.frustum_of(PixelRect { x0, x1, y0, y1 });
                for (x, y) in (0..64).flat_map(|x| (0..48).map(move |y| (x, y))) {
                    let ray = rays.ray(x as f64 + 0.5, y as f64 + 0.5);
                    let is_in = (x0..x1).contains(&x) && (y0..y1).contains(&y);
                    for t in [0.1, 3.0, 20.0] {
                        let at = ray.origin + ray.direction * t;
                        assert_eq!(frustum.meets_box(at, at), is_in, "{window:?} {x} {y} {t}");
                    }
                }
            }
        }
    }

    #[test]
    fn the_frustum_keeps_what_rays_hit() {
        let projections = [Projection::Perspective { fov_y_deg: 40.0 }, Projection::Orthographic { height: 6.0 }];
        for (projection, by) in projections.into_iter().flat_map(|p| [0.0, 1.5, -1.5].map(|by| (p, by))) {
            let rays = camera(projection).rays(64, 48).unwrap().from_aside(by, 10.0);
            let frustum = rays.frustum();
            for (x, y) in [(0.5, 0.5), (63.5, 0.5), (0.5, 47.5), (63.5, 47.5), (32.0, 24.0)] {
                let ray = rays.ray(x, y);
                let p = ray.origin + ray.direction * 7.0;
                assert!(frustum.meets_box(p - 0.01, p + 0.01), "{projection:?} {by} {x} {y}");
                // Outside the picture by a pixel and a half.
                let past = rays.ray(if x < 32.0 { x - 2.0 } else { x + 2.0 }, y);
                let p = past.origin + past.direction * 7.0;
                assert!(x == 32.0 || !frustum.meets_box(p - 0.01, p + 0.01), "{projection:?} {by} {x} {y}");
            }
            let behind = DVec3::new(0.0, 0.0, -20.0);
            assert!(!frustum.meets_box(behind - 1.0, behind + 1.0));
            let aside = DVec3::new(50.0, 0.0, 0.0);
            assert!(!frustum.meets_box(aside - 1.0, aside + 1.0));
        }
    }

    #[test]
    fn points_are_seen_where_their_rays_pass() {
        for projection in [Projection::Perspective { fov_y_deg: 40.0 }, Projection::Orthographic { height: 6.0 }] {
            let rays = camera(projection).rays(64, 48).unwrap().from_aside(1.5, 10.0);
            let ray = rays.ray(13.25, 40.5);
            let [x, y] = rays.pixel(ray.origin + ray.direction * 7.0).unwrap();
            assert!((x - 13.25).abs() < 1e-9 && (y - 40.5).abs() < 1e-9, "{x} {y}");
            assert_eq!(rays.pixel(rays.eye - rays.forward).is_none(), !rays.orthographic);
        }
    }

    #[test]
    fn a_fitted_box_touches_the_margin_of_the_picture_and_no_more() {
        for (size_px, high) in
            [((480, 640), [10.0, 20.0, 30.0]), ((300, 900), [40.0, 10.0, 5.0]), ((500, 500), [1.0, 1.0, 1.0])]
        {
            let world_box = (DVec3::new(-3.0, 0.0, 0.0), DVec3::from_array(high));
            let camera = Camera::looking_at_box(world_box).fitted(world_box, size_px);
            let rays = camera.rays(size_px.0, size_px.1).unwrap();
            let reach = |corner| {
                let [x, y] = rays.pixel(corner).unwrap();
                (2.0 * x / f64::from(size_px.0) - 1.0).abs().max((2.0 * y / f64::from(size_px.1) - 1.0).abs())
            };
            let reach = box_corners(world_box).into_iter().map(reach).fold(0.0, f64::max);
            assert!((reach - 0.94).abs() < 1e-9, "{size_px:?}: {reach}");
        }
        let world_box = (DVec3::ZERO, DVec3::new(4.0, 1.0, 2.0));
        let of = |size_px| Camera::looking_at_box(world_box).fitted(world_box, size_px);
        assert_eq!(of((640, 480)), of((480, 480)));
        let flat = camera(Projection::Orthographic { height: 6.0 });
        assert_eq!(flat.fitted((DVec3::ZERO, DVec3::ONE), (8, 8)), flat);
    }

    #[test]
    fn moved_rays_are_those_of_other_places_in_the_picture() {
        for projection in [Projection::Perspective { fov_y_deg: 40.0 }, Projection::Orthographic { height: 6.0 }] {
            let rays = camera(projection).rays(64, 48).unwrap().from_aside(1.5, 10.0);
            let moved = rays.moved_by_px([0.375, -0.125]);
            for (x, y) in [(0.5, 0.5), (63.5, 20.5), (13.25, 47.5)] {
                let (found, expected) = (moved.ray(x, y), rays.ray(x + 0.375, y - 0.125));
                assert!(found.origin.distance(expected.origin) < 1e-12);
                assert!(found.direction.distance(expected.direction) < 1e-12);
                let [px, py] = moved.pixel(found.origin + found.direction * 7.0).unwrap();
                assert!((px - x).abs() < 1e-9 && (py - y).abs() < 1e-9, "{px} {py}");
                let at = expected.origin + expected.direction * 5.0;
                assert!(moved.frustum().meets_box(at, at), "{projection:?} {x} {y}");
                let past = moved.ray(if x < 32.0 { -0.01 } else { 64.01 }, y);
                let at = past.origin + past.direction * 5.0;
                assert!(!moved.frustum().meets_box(at, at), "{projection:?} {x} {y}");
            }
        }
    }

    #[test]
    fn between_two_cameras_of_an_orbit_is_the_orbit() {
        for projection in [Projection::Perspective { fov_y_deg: 40.0 }, Projection::Orthographic { height: 6.0 }] {
            let start = Camera { eye: DVec3::new(3.0, 4.0, -10.0), ..camera(projection) };
            for (from_deg, to_deg) in [(0.0, 120.0), (300.0, 200.0), (-100.0, 70.0)] {
                let [from, to] = [from_deg, to_deg].map(|angle_deg| start.orbited(angle_deg));
                for t in [0.0, 0.25, 1.0] {
                    let expected = start.orbited(from_deg + (to_deg - from_deg) * t).rays(20, 10).unwrap();
                    let found = from.between(&to, t).unwrap().rays(20, 10).unwrap();
                    for (found, expected) in [
                        (found.eye, expected.eye),
                        (found.forward, expected.forward),
                        (found.right, expected.right),
                        (found.up, expected.up),
                    ] {
                        assert!(found.distance(expected) < 1e-9, "{from_deg} {to_deg} {t}: {found}, not {expected}");
                    }
                }
            }
        }
    }

    #[test]
    fn distances_and_angles_change_by_the_same_ratio() {
        let from = camera(Projection::Perspective { fov_y_deg: 10.0 });
        let target = DVec3::new(2.0, 0.0, 0.0);
        let to = Camera { eye: target + DVec3::new(0.0, 0.0, -40.0), target, ..from };
        let to = Camera { projection: Projection::Perspective { fov_y_deg: 90.0 }, ..to };
        let middle = from.between(&to, 0.5).unwrap();
        assert!(middle.target.distance(DVec3::X) < 1e-12 && (middle.eye.distance(middle.target) - 20.0).abs() < 1e-12);
        let Projection::Perspective { fov_y_deg } = middle.projection else { panic!("{middle:?}") };
        assert!((fov_y_deg - 30.0).abs() < 1e-12);
        let flat = Camera { projection: Projection::Orthographic { height: 2.0 }, ..from };
        assert!(matches!(from.between(&flat, 0.5), Err(CameraError::Projection(_))));
        assert!(matches!(from.between(&Camera { up: DVec3::Z, ..to }, 0.5), Err(CameraError::Up(_))));
    }

    #[test]
    fn impossible_cameras_are_refused() {
        let good = camera(Projection::Perspective { fov_y_deg: 40.0 });
        assert!(matches!(Camera { eye: good.target, ..good }.rays(8, 8), Err(CameraError::NoDirection { .. })));
        assert!(matches!(Camera { up: DVec3::Z, ..good }.rays(8, 8), Err(CameraError::Up(_))));
        let flat = Camera { projection: Projection::Perspective { fov_y_deg: 180.0 }, ..good };
        assert!(matches!(flat.rays(8, 8), Err(CameraError::Projection(_))));
    }
}
