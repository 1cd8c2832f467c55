//! The version of the store's format.

/// The version of the store format written and read by this program, in the `brickyard` attribute.
pub const FORMAT_VERSION: u32 = 2;
