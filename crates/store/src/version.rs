//! The version of the store's format.

/// The version of the `brickyard` attribute that is written and read.
pub const FORMAT_VERSION: u32 = 2;
