//! A ray of a picture.

use glam::DVec3;

/// A ray `origin + t * direction`, `t >= 0`; the direction has length 1, so `t` is a world distance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// Where `t` is 0: the eye, or the eye plane of an orthographic camera.
    pub origin: DVec3,
    /// Unit direction.
    pub direction: DVec3,
}
