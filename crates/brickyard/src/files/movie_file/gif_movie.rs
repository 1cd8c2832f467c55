//! GIF movies. Each picture has its own best 256 colours (NeuQuant), or exactly its own where these are fewer.

use super::PictureRate;
use crate::files::whole_file::WholeFile;
use brickyard_volume::Picture;
use gif::{Encoder, EncodingError, Frame, Repeat};
use std::io;

/// Players show a picture of less than 2 hundredths of a second for 10.
const FASTEST_PER_S: u32 = 50;

/// Least number of pixels, if available, from which NeuQuant learns a picture's colours: more take time and hardly
/// improve it.
const LEARNED_PIXELS: usize = 100_000;

pub(super) struct GifMovie {
    encoder: Encoder<WholeFile>,
    rate: PictureRate,
    pictures: u64,
}

impl GifMovie {
    pub(super) fn check((width, height): (u32, u32), rate: PictureRate) -> Result<(), String> {
        let most = u32::from(u16::MAX);
        if width > most || height > most {
            return Err(format!("a GIF has at most {most}x{most} pixels, not {width}x{height}: write .y4m or .mp4"));
        }
        if rate.exceeds(FASTEST_PER_S) {
            return Err(format!(
                "a GIF shows at most {FASTEST_PER_S} pictures a second, not {rate}: write .y4m or .mp4"
            ));
        }
        Ok(())
    }

    /// Begins a movie of a size and rate that passed [`GifMovie::check`].
    pub(super) fn new(file: WholeFile, (width, height): (u32, u32), rate: PictureRate) -> io::Result<Self> {
        let mut encoder = Encoder::new(file, width as u16, height as u16, &[]).map_err(error)?;
        encoder.set_repeat(Repeat::Infinite).map_err(error)?;
        Ok(Self { encoder, rate, pictures: 0 })
    }

    pub(super) fn push(&mut self, picture: &Picture) -> io::Result<()> {
        let (width, height) = (picture.width as u16, picture.height as u16);
        // Stride between learned pixels, at most 30.
        let sampled = (picture.rgb.len() / LEARNED_PIXELS).clamp(1, 30) as i32;
        let mut frame = Frame::from_rgb_speed(width, height, picture.rgb.as_flattened(), sampled);
        let delay_cs = self.rate.begin_cs(self.pictures + 1) - self.rate.begin_cs(self.pictures);
        // At most 10,000: 0.01 pictures a second.
        frame.delay = delay_cs as u16;
        self.pictures += 1;
        self.encoder.write_frame(&frame).map_err(error)
    }

    /// Writes the end. The file still has its temporary name.
    pub(super) fn finish(self) -> io::Result<WholeFile> {
        self.encoder.into_inner().map_err(error)
    }
}

fn error(error: EncodingError) -> io::Error {
    match error {
        EncodingError::Io(error) => error,
        other => io::Error::other(other),
    }
}
