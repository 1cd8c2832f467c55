//! The last shown picture of a live session. It stays until the next one is covered everywhere, so no picture has a
//! hole, whatever happens to slots, pagers and volumes meanwhile. Costs a copy of each picture with pixels on the CPU.

use crate::session::frame::Frame;
use brickyard_volume::Picture;

/// The picture shown last.
pub(crate) struct ShownPicture {
    pub(crate) frame: Frame,
    /// The picture's pixels; `None` where they are in a texture of the device.
    pub(crate) pixels: Option<Picture>,
}

impl ShownPicture {
    pub(crate) fn is_on_device(&self) -> bool {
        self.pixels.is_none()
    }
}
