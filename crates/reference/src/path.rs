//! A pixel's ray in the voxel space of a volume, and its shown stretch.

use crate::Array;
use brickyard_volume::{Clip, CutFace, FrameSettings, Ray};
use glam::DVec3;

/// A pixel's ray in the voxel space of a volume, with distances of the scene's world along it.
pub(crate) struct Path {
    /// The ray in the scene's world.
    pub(crate) world: Ray,
    /// The ray in the volume's own world.
    pub(crate) own: Ray,
    pub(crate) origin: DVec3,
    pub(crate) direction: DVec3,
    /// The cut through which it enters the shown part, if any.
    pub(crate) cut: Option<CutFace>,
}

impl Path {
    /// The path of the ray through a pixel's centre, through a volume with this finest level.
    pub(crate) fn new(frame: &FrameSettings, finest: &Array, x: u32, y: u32) -> Self {
        let world = frame.rays.ray(x as f64 + 0.5, y as f64 + 0.5);
        let own = frame.placement.volume_ray(&world);
        let origin = frame.geometry.voxel_from_world(own.origin);
        let direction = own.direction / frame.geometry.spacing;
        let cut = frame.cut_face(finest.extent, origin, direction, 0.0);
        Self { world, own, origin, direction, cut }
    }

    /// The point in voxel space at a distance.
    pub(crate) fn at(&self, t: f64) -> DVec3 {
        self.origin + self.direction * t
    }

    /// The distances where the ray enters and leaves the shown part of a volume with this finest level; `None` if it
    /// misses that.
    pub(crate) fn stretch(&self, frame: &FrameSettings, finest: &Array) -> Option<(f64, f64)> {
        let inside = clip(self.origin, self.direction, frame.shown_box(finest.extent))?;
        clip_by_planes(&self.own, frame, inside)
    }
}

/// The part of the stretch on the inner sides of all clip planes.
fn clip_by_planes(ray: &Ray, frame: &FrameSettings, (mut t_in, mut t_out): (f64, f64)) -> Option<(f64, f64)> {
    for plane in frame.clip.iter().flat_map(Clip::planes) {
        // The height above the plane is `height + slope * t`.
        let (height, slope) = (plane.height(ray.origin), plane.normal.dot(ray.direction));
        match slope {
            0.0 if height < 0.0 => return None,
            0.0 => {}
            slope if slope > 0.0 => t_in = t_in.max(-height / slope),
            slope => t_out = t_out.min(-height / slope),
        }
    }
    (t_in < t_out).then_some((t_in, t_out))
}

/// The ray's stretch inside the half-open box, `t >= 0`.
fn clip(origin: DVec3, direction: DVec3, (low, high): (DVec3, DVec3)) -> Option<(f64, f64)> {
    let (mut t_in, mut t_out) = (0.0f64, f64::INFINITY);
    for a in 0..3 {
        let (o, d) = (origin[a], direction[a]);
        if d == 0.0 {
            if o < low[a] || o >= high[a] {
                return None;
            }
            continue;
        }
        let (near, far) = ((low[a] - o) / d, (high[a] - o) / d);
        t_in = t_in.max(near.min(far));
        t_out = t_out.min(near.max(far));
    }
    (t_in < t_out).then_some((t_in, t_out))
}
