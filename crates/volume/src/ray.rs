//! A ray of a picture.

use glam::DVec3;

/// A ray `origin + t * direction`, `t >= 0`. In the scene's world the direction has length 1, so `t` is a world
/// distance. Mapping a ray to a volume's own world by a [placement](crate::Placement::volume_ray) keeps `t`, and
/// may change the length of the direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// The point at `t` = 0: the eye, or on the eye plane of an orthographic camera.
    pub origin: DVec3,
    /// Direction; of length 1 in the scene's world.
    pub direction: DVec3,
}
