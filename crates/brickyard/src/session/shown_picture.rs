//! The last shown picture of a live session. It stays until the next one is covered everywhere, so no picture has a
//! hole, whatever happens to slots, pagers and volumes meanwhile. Costs a copy of each picture with pixels on the CPU.

use crate::session::frame::Frame;
use brickyard_volume::Picture;

/// The picture shown last.
pub(crate) struct ShownPicture {
    frame: Frame,
    /// `None` where they are in a texture of the device.
    pixels: Option<Picture>,
}

impl ShownPicture {
    pub(crate) fn of_pixels(frame: Frame, pixels: Picture) -> Self {
        Self { frame, pixels: Some(pixels) }
    }

    #[cfg(feature = "gpu")]
    pub(crate) fn on_device(frame: Frame) -> Self {
        Self { frame, pixels: None }
    }

    pub(crate) fn is_on_device(&self) -> bool {
        self.pixels.is_none()
    }

    pub(crate) fn frame(&self) -> &Frame {
        &self.frame
    }

    /// The picture's pixels; `None` where they are in a texture of the device.
    pub(crate) fn pixels(&self) -> Option<&Picture> {
        self.pixels.as_ref()
    }
}
