//! The headings of flags in the help, the same in all commands.

/// Results and their files.
pub(crate) const OUTPUT: &str = "Output";
/// The meaning of inputs.
pub(crate) const INPUT: &str = "Input";
/// Generated data.
pub(crate) const MADE: &str = "Made";
/// The part of a store to read.
pub(crate) const READ: &str = "Read";
/// Measurements.
pub(crate) const MEASURED: &str = "Measured";
/// The visible part of the volumes.
pub(crate) const PART: &str = "Shown";
pub(crate) const CAMERA: &str = "Camera";
/// The look of volumes.
pub(crate) const LOOK: &str = "Look";
/// The sampling of rays.
pub(crate) const SAMPLING: &str = "Sampling";
/// Overlays on pictures, at the place where they hide least.
pub(crate) const OVERLAYS: &str = "Overlays";
#[cfg(feature = "viewer")]
pub(crate) const WINDOW: &str = "Window";
/// The backend and its limits.
pub(crate) const DRAWING: &str = "Drawing";
/// Files without a header.
pub(crate) const RAW: &str = "Raw";
/// A store's layout.
pub(crate) const STORE: &str = "Store";
/// The work's limits and files.
pub(crate) const WORK: &str = "Work";
/// Buckets and their servers.
pub(crate) const ADDRESSES: &str = "Addresses";
pub(crate) const ALL: &str = "Everywhere";
