//! Pictures made by sessions: settled ones, exact ones, tiles, the oracle's, and overlays on them.

#[cfg(feature = "gpu")]
pub mod exact;
#[cfg(feature = "lettering")]
pub mod lettering;
pub mod offline;
#[cfg(feature = "reference")]
pub mod oracle;
#[cfg(feature = "lettering")]
pub mod overlay;
pub mod tiles;
