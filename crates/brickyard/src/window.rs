//! Services for a window: background work, files opened and followed, previews, and values under the pointer.

pub mod background;
pub mod curve;
pub mod following;
pub mod opening;
pub mod pick;
pub mod preview;
pub mod probe;
