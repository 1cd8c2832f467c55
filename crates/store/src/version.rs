//! The version of the store's format.

/// The version of the store format that this program writes and reads, in the `brickyard` attribute.
pub const FORMAT_VERSION: u32 = 2;
