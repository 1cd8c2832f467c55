//! A picture's header, of any kind: the format of its pixels, their size, and remarks.

use super::exif;
use super::rows::Palette;
use crate::error::{ImportError, Result};
use crate::note::Note;
use crate::spacing::{Scale, Spacing, default_note, default_per_inch};
use brickyard_volume::{ChannelLook, VoxelType};
use std::fmt;
use std::path::Path;

/// Description of a picture, available before its pixels are read.
pub(super) struct Header {
    pub(super) format: PictureFormat,
    /// Size of pixels; the distance of planes is unknown.
    pub(super) scale: Scale,
    pub(super) notes: Vec<Note>,
    /// Most memory for decoding the picture.
    pub(super) reader_bytes: u64,
}

/// Format of a picture, common to all of a stack.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct PictureFormat {
    pub(super) width: u32,
    pub(super) height: u32,
    /// Bits of a number as stored, or of a palette's colours. Pictures of unlike depth are on unlike scales.
    pub(super) bits: u32,
    pub(super) channels: Channels,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Channels {
    Gray,
    GrayAlpha,
    Rgb,
    RgbAlpha,
    /// Indices into a palette, as labels.
    Indices,
}

impl Channels {
    fn names(self) -> &'static [&'static str] {
        match self {
            Self::Gray | Self::Indices => &["gray"],
            Self::GrayAlpha => &["gray", "alpha"],
            Self::Rgb => &["red", "green", "blue"],
            Self::RgbAlpha => &["red", "green", "blue", "alpha"],
        }
    }
}

impl PictureFormat {
    pub(super) fn channels(&self) -> u32 {
        self.channels.names().len() as u32
    }

    pub(super) fn voxel_type(&self) -> VoxelType {
        if self.bits > 8 { VoxelType::U16 } else { VoxelType::U8 }
    }

    /// Looks of `channels` channels, of one or more pictures side by side: the colours over all values. Opacity is black, to add nothing. A single gray
    /// channel has none, as in other formats.
    pub(super) fn looks(&self, channels: u32) -> Vec<ChannelLook> {
        let names = self.channels.names();
        if names.len() == 1 {
            return Vec::new();
        }
        let greatest = f64::from((1u32 << self.bits) - 1);
        let look = |name: &&str| {
            let color = match *name {
                "red" => [255, 0, 0],
                "green" => [0, 255, 0],
                "blue" => [0, 0, 255],
                "alpha" => [0; 3],
                _ => [255; 3],
            };
            ChannelLook { name: Some((*name).into()), color: Some(color), window: Some([0.0, greatest]), unit: None }
        };
        names.iter().cycle().take(channels as usize).map(look).collect()
    }
}

impl fmt::Display for PictureFormat {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { width, height, bits, channels } = self;
        let what = match channels {
            Channels::Indices => "indices into a palette".into(),
            channels => channels.names().join(", "),
        };
        write!(f, "{width}x{height} pixels of {bits}-bit {what}")
    }
}

impl Header {
    /// Creates a header with the remarks that follow from the format.
    ///
    /// # Errors
    /// If the picture is empty.
    pub(super) fn new(path: &Path, format: PictureFormat) -> Result<Self> {
        let PictureFormat { width, height, bits, channels } = format;
        if width == 0 || height == 0 {
            return Err(ImportError::invalid(path, format!("a picture of {width}x{height} pixels: expected some")));
        }
        let mut header = Self { format, scale: (None, None), notes: Vec::new(), reader_bytes: 0 };
        let count = format.channels();
        if count > 1 {
            header.note(format!("Each picture holds {count} samples a pixel; they are read as channels."));
        }
        if matches!(channels, Channels::GrayAlpha | Channels::RgbAlpha) {
            header.note("The opacity of pixels is the channel alpha; it is not applied to the others.".into());
        }
        if bits < 8 {
            let greatest = (1 << bits) - 1;
            header.note(format!(
                "Pixels have {bits} {}: the numbers 0 to {greatest} are read as stored, not stretched to 255.",
                if bits == 1 { "bit" } else { "bits" }
            ));
        }
        Ok(header)
    }

    /// Creates a header of a picture with a palette, or with indices as labels: these are on one scale, whatever their bits.
    ///
    /// # Errors
    /// As for [`Header::new`].
    pub(super) fn of_palette(path: &Path, size: [u32; 2], palette: Option<&Palette>) -> Result<Self> {
        let [width, height] = size;
        let Some(palette) = palette else {
            let mut header = Self::new(path, PictureFormat { width, height, bits: 8, channels: Channels::Indices })?;
            header.note("Pixels are indices into a palette of colours: the indices are the labels.".into());
            return Ok(header);
        };
        let channels = if palette.is_gray { Channels::Gray } else { Channels::Rgb };
        let mut header = Self::new(path, PictureFormat { width, height, bits: 8, channels })?;
        header.note(match palette.is_gray {
            true => "Pixels are indices into a palette of grays: its grays are read, not the indices.".into(),
            false => "Pixels are indices into a palette: its colours are read, not the indices.".into(),
        });
        Ok(header)
    }

    pub(super) fn note(&mut self, text: String) {
        self.notes.push(Note::new(text));
    }

    pub(super) fn warn(&mut self, text: impl Into<String>) {
        self.notes.push(Note::warning(text));
    }

    /// Sets the size of pixels by their number per unit of length along x and y, as a TIFF file's: placeholders and the defaults of screens do not
    /// count. `inch` is an inch in this unit.
    pub(super) fn set_density(&mut self, per_unit: [u32; 2], unit: &'static str, inch: f64) {
        let [x, y] = per_unit;
        if x == 0 || y == 0 || (x, y) == (1, 1) {
            return;
        }
        if let Some(dots) = default_per_inch(f64::from(x) * inch).filter(|_| x == y) {
            self.notes.push(default_note(dots));
            return;
        }
        self.scale = (Some(Spacing { x: 1.0 / f64::from(x), y: 1.0 / f64::from(y), z: None }), Some(unit));
    }

    /// Warns of an orientation in Exif data other than that of the rows.
    pub(super) fn check_turn(&mut self, data: &[u8]) {
        if let Some(turn) = exif::orientation(data).filter(|turn| *turn != 1) {
            self.warn(format!(
                "Exif asks to turn or mirror the picture (Orientation {turn}): it is read as stored, not turned."
            ));
        }
    }
}
