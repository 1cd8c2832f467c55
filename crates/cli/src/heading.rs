//! The headings of flags in the help, the same in all commands.

/// Heading of the flags for results and their files.
pub(crate) const OUTPUT: &str = "Output";
/// Heading of the flags for the meaning of inputs.
pub(crate) const INPUT: &str = "Input";
/// Heading of the flags for generated data.
pub(crate) const MADE: &str = "What is made";
/// Heading of the flags for the part of a store to read.
pub(crate) const READ: &str = "What is read";
/// Heading of the flags for measurements.
pub(crate) const MEASURED: &str = "What is measured";
/// Heading of the flags for the visible part of the volumes.
pub(crate) const PART: &str = "What is shown";
/// Heading of the flags for the camera.
pub(crate) const CAMERA: &str = "Camera";
/// Heading of the flags for the look of volumes.
pub(crate) const LOOK: &str = "Look";
/// Heading of the flags for the sampling of rays.
pub(crate) const SAMPLING: &str = "Sampling";
/// Heading of the flags for overlays on pictures, at the place where they hide least.
pub(crate) const OVERLAYS: &str = "Overlays";
/// Heading of the flags for a window.
#[cfg(feature = "viewer")]
pub(crate) const WINDOW: &str = "Window";
/// Heading of the flags for the backend and its limits.
pub(crate) const DRAWING: &str = "Drawing, memory and time";
/// Heading of the flags for files without a header.
pub(crate) const RAW: &str = "Raw input";
/// Heading of the flags for a store's layout.
pub(crate) const STORE: &str = "Store";
/// Heading of the flags for the work's limits and files.
pub(crate) const WORK: &str = "Work";
/// Heading of the flags of all commands.
pub(crate) const ALL: &str = "All commands";
