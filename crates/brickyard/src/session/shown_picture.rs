//! The picture that a live session has shown last. It stays until there is something of the next one in every place, so no picture has a hole,
//! whatever becomes of slots, pagers and volumes meanwhile. Costs a copy of each picture whose pixels are on the CPU.

use crate::session::frame::Frame;
use brickyard_volume::Picture;

/// The picture that was shown last.
pub(crate) struct ShownPicture {
    frame: Frame,
    /// `None` where they are in a texture of the device's.
    pixels: Option<Picture>,
}

impl ShownPicture {
    /// A frame's picture, of which these are the pixels.
    pub(crate) fn of_pixels(frame: Frame, pixels: Picture) -> Self {
        Self { frame, pixels: Some(pixels) }
    }

    /// A frame's picture in a texture of the device's.
    #[cfg(feature = "gpu")]
    pub(crate) fn on_device(frame: Frame) -> Self {
        Self { frame, pixels: None }
    }

    /// Whether the picture is in a texture of the device's.
    pub(crate) fn is_on_device(&self) -> bool {
        self.pixels.is_none()
    }

    /// The frame that the picture shows.
    pub(crate) fn frame(&self) -> &Frame {
        &self.frame
    }

    /// The picture's pixels; `None` where they are in a texture of the device's.
    pub(crate) fn pixels(&self) -> Option<&Picture> {
        self.pixels.as_ref()
    }
}
