//! The headings under which flags stand in the help, the same in all commands.

/// What comes out, and where.
pub(crate) const OUTPUT: &str = "Output";
/// What goes in.
pub(crate) const INPUT: &str = "Input";
/// What of the volumes is shown.
pub(crate) const PART: &str = "What is shown";
/// From where it is seen.
pub(crate) const CAMERA: &str = "Camera";
/// How it looks.
pub(crate) const LOOK: &str = "Look";
/// How rays are sampled.
pub(crate) const SAMPLING: &str = "Sampling";
/// Who draws, and what that may take.
pub(crate) const DRAWING: &str = "Drawing, memory and time";
/// How files without a header lie.
pub(crate) const RAW: &str = "Raw input";
/// How a store is laid out.
pub(crate) const STORE: &str = "Store";
/// What the work may take, and what becomes of files.
pub(crate) const WORK: &str = "Work";
/// What all commands have.
pub(crate) const ALL: &str = "All commands";
