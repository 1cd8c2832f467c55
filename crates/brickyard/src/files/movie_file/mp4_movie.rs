//! MP4 movies, written by the program ffmpeg from YUV4MPEG2 through a pipe.

use super::y4m_movie::Y4mMovie;
use super::{MovieError, PictureRate};
use crate::files::whole_file::WholeFile;
use brickyard_volume::Picture;
use std::ffi::OsString;
use std::io::{self, BufWriter, Read};
use std::path::Path;
use std::process::{Child, ChildStdin, Command, Stdio};
use std::thread::JoinHandle;

/// Bytes kept of ffmpeg's messages, the last ones.
const SAID_BYTES: usize = 4096;

/// ffmpeg's input options. The header of YUV4MPEG2 cannot state that colours are BT.709 of limited range.
const INPUT: &[&str] = &["-hide_banner", "-loglevel", "error", "-nostats", "-y", "-f", "yuv4mpegpipe", "-i", "pipe:0"];

/// ffmpeg's output options: playable by browsers and players, with hardly visible loss.
#[rustfmt::skip]
const OUTPUT: &[&str] = &[
    "-an", "-vf", "setparams=range=tv:colorspace=bt709:color_primaries=bt709:color_trc=bt709",
    "-c:v", "libx264", "-crf", "18", "-pix_fmt", "yuv420p",
    "-color_range", "tv", "-colorspace", "bt709", "-color_primaries", "bt709", "-color_trc", "bt709",
    "-movflags", "+faststart", "-f", "mp4",
];

pub(super) struct Mp4Movie {
    file: WholeFile,
    size_px: (u32, u32),
    ffmpeg: Ffmpeg,
}

/// Returns the size in pixels, rounded up to even numbers: colours have half the resolution.
pub(super) fn even((width, height): (u32, u32)) -> (u32, u32) {
    (width.next_multiple_of(2), height.next_multiple_of(2))
}

impl Mp4Movie {
    /// Begins a movie, after ffmpeg has written a single black picture of the same size in its place: a missing encoder
    /// is found now.
    pub(super) fn new(file: WholeFile, size_px: (u32, u32), rate: PictureRate) -> Result<Self, MovieError> {
        let size_px = even(size_px);
        let black = Picture { width: size_px.0, height: size_px.1, rgb: vec![[0; 3]; pixels(size_px)] };
        let start = |file| Ok(Self { ffmpeg: Ffmpeg::start(&file, size_px, rate)?, file, size_px });
        let mut trial: Self = start(file)?;
        trial.push(&black)?;
        trial.ffmpeg.finish(&trial.file.path)?;
        start(trial.file)
    }

    /// Writes a picture; it may lack the last column or row of the movie's size.
    pub(super) fn push(&mut self, picture: &Picture) -> Result<(), MovieError> {
        let is_even = (picture.width, picture.height) == self.size_px;
        let written =
            if is_even { self.ffmpeg.push(picture) } else { self.ffmpeg.push(&padded(picture, self.size_px)) };
        let Err(source) = written else { return Ok(()) };
        // It has ended, and reports why.
        self.ffmpeg.finish(&self.file.path)?;
        Err(MovieError::Write { path: self.file.path.clone(), source })
    }

    pub(super) fn finish(mut self) -> Result<(), MovieError> {
        let path = self.file.path.clone();
        self.ffmpeg.finish(&path)?;
        self.file.finish().map_err(|source| MovieError::Write { path, source })
    }
}

/// The running program, killed on drop.
struct Ffmpeg {
    child: Child,
    /// `None` once all pictures are written.
    pictures: Option<Y4mMovie<BufWriter<ChildStdin>>>,
    /// `None` once the program has ended.
    said: Option<JoinHandle<Vec<u8>>>,
}

impl Ffmpeg {
    fn start(file: &WholeFile, size_px: (u32, u32), rate: PictureRate) -> Result<Self, MovieError> {
        let missing = |source| MovieError::NoFfmpeg { path: file.path.clone(), source };
        // A bare name with a colon would be taken for a protocol.
        let mut output = OsString::from("file:");
        output.push(file.temporary());
        let mut command = Command::new("ffmpeg");
        command.args(INPUT).args(OUTPUT).arg(output);
        let mut child =
            command.stdin(Stdio::piped()).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().map_err(missing)?;
        let said = child.stderr.take().map(|stderr| std::thread::spawn(move || last_of(stderr)));
        let mut ffmpeg = Self { child, pictures: None, said };
        let stdin = ffmpeg.child.stdin.take().ok_or_else(|| missing(io::Error::other("it accepts no input")))?;
        let begun = Y4mMovie::new(BufWriter::new(stdin), size_px, rate);
        ffmpeg.pictures = Some(begun.map_err(|source| MovieError::Write { path: file.path.clone(), source })?);
        Ok(ffmpeg)
    }

    fn push(&mut self, picture: &Picture) -> io::Result<()> {
        match &mut self.pictures {
            Some(pictures) => pictures.push(picture),
            None => Err(io::ErrorKind::BrokenPipe.into()),
        }
    }

    /// Ends the pictures and waits for the program. `path` is the movie's.
    fn finish(&mut self, path: &Path) -> Result<(), MovieError> {
        let failed = |source| MovieError::Write { path: path.into(), source };
        let written = self.pictures.take().map_or(Ok(()), |pictures| pictures.finish().map(drop));
        let status = self.child.wait().map_err(failed)?;
        let said = self.said.take().and_then(|said| said.join().ok()).unwrap_or_default();
        if status.success() {
            return written.map_err(failed);
        }
        let said = String::from_utf8_lossy(&said);
        let said = if said.trim().is_empty() { String::new() } else { format!(": {}", said.trim()) };
        Err(MovieError::Ffmpeg { path: path.into(), status, said })
    }
}

impl Drop for Ffmpeg {
    fn drop(&mut self) {
        // It may have ended already. It must not write to its file once this is gone.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Reads a pipe to its end, and returns its last bytes.
fn last_of(mut pipe: impl Read) -> Vec<u8> {
    let (mut last, mut bytes) = (Vec::new(), [0; 1024]);
    loop {
        match pipe.read(&mut bytes) {
            Ok(0) => return last,
            Ok(count) => {
                last.extend_from_slice(&bytes[..count]);
                last.drain(..last.len().saturating_sub(SAID_BYTES));
            }
            Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
            // Keep the bytes before the error.
            Err(_) => return last,
        }
    }
}

/// Enlarges a picture to a size in pixels by repeating its last column and row.
fn padded(picture: &Picture, size_px: (u32, u32)) -> Picture {
    let (width, height) = size_px;
    let mut rgb = Vec::with_capacity(pixels(size_px));
    for y in 0..height {
        let row = y.min(picture.height - 1) as usize * picture.width as usize;
        rgb.extend((0..width).map(|x| picture.rgb[row + x.min(picture.width - 1) as usize]));
    }
    Picture { width, height, rgb }
}

fn pixels((width, height): (u32, u32)) -> usize {
    width as usize * height as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn odd_sizes_repeat_the_last_column_and_row() {
        let colour = |value| [value; 3];
        let picture = Picture { width: 3, height: 1, rgb: [1, 2, 3].map(colour).into() };
        assert_eq!(even((3, 1)), (4, 2));
        assert_eq!(even((4, 2)), (4, 2));
        assert_eq!(padded(&picture, (4, 2)).rgb, [1, 2, 3, 3, 1, 2, 3, 3].map(colour));
    }

    #[test]
    fn the_last_words_are_kept() {
        let text: Vec<u8> = (0..10_000u32).map(|i| b'a' + (i % 26) as u8).collect();
        assert_eq!(last_of(&text[..]), text[10_000 - SAID_BYTES..]);
        assert_eq!(last_of(&b"short"[..]), b"short");
    }
}
