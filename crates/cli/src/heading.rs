//! The headings under which flags stand in the help, the same in all commands.

/// Heading of the flags for what comes out, and where.
pub(crate) const OUTPUT: &str = "Output";
/// Heading of the flags for what an input means.
pub(crate) const INPUT: &str = "Input";
/// Heading of the flags for what is made where nothing is read.
pub(crate) const MADE: &str = "What is made";
/// Heading of the flags for the part of a store that is read.
pub(crate) const READ: &str = "What is read";
/// Heading of the flags for what is measured.
pub(crate) const MEASURED: &str = "What is measured";
/// Heading of the flags for the part of the volumes that is shown.
pub(crate) const PART: &str = "What is shown";
/// Heading of the flags for the camera.
pub(crate) const CAMERA: &str = "Camera";
/// Heading of the flags for how volumes look.
pub(crate) const LOOK: &str = "Look";
/// Heading of the flags for how rays are sampled.
pub(crate) const SAMPLING: &str = "Sampling";
/// Heading of the flags for what is drawn on the pictures, where it hides least.
pub(crate) const OVERLAYS: &str = "Overlays";
/// Heading of the flags for a window.
#[cfg(feature = "viewer")]
pub(crate) const WINDOW: &str = "Window";
/// Heading of the flags for who draws, and what drawing may take.
pub(crate) const DRAWING: &str = "Drawing, memory and time";
/// Heading of the flags for files without a header.
pub(crate) const RAW: &str = "Raw input";
/// Heading of the flags for how a store is laid out.
pub(crate) const STORE: &str = "Store";
/// Heading of the flags for what the work may take, and what becomes of files.
pub(crate) const WORK: &str = "Work";
/// Heading of the flags that all commands have.
pub(crate) const ALL: &str = "All commands";
