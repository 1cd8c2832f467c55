//! The media of a row of segments.

use glam::Vec3;

/// A medium of a segment, or of a part of one.
pub(crate) struct Passed {
    pub(crate) segment: i32,
    pub(crate) color: Vec3,
    /// The medium's depth: halvings of the light over a unit distance.
    pub(crate) depth: f64,
    /// The medium's length in unit distances.
    pub(crate) length: f64,
}

/// Media in order, front to back.
pub(crate) type Row = Vec<Passed>;
