//! The media of a row of segments.

use glam::Vec3;

/// A medium of one of the stretch's segments, or of a part of it.
pub(crate) struct Passed {
    pub(crate) segment: i32,
    pub(crate) color: Vec3,
    /// Halvings of the light over a unit distance, and unit distances.
    pub(crate) depth: f64,
    pub(crate) length: f64,
}

/// The media of a row of segments, front to back.
pub(crate) type Row = Vec<Passed>;
