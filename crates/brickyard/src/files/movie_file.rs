//! Movies: pictures of one size in one file. They are written one by one, so memory does not grow with their number,
//! under a temporary name until the file is complete.
//!
//! | format | fidelity | written by |
//! | --- | --- | --- |
//! | `.gif` | 256 colours of each picture; times to a hundredth of a second | this program |
//! | `.y4m` | all pixels, in 8-bit BT.709 of limited range: within 2 of 255; uncompressed | this program |
//! | `.mp4` | H.264 with colours at half resolution; plays everywhere | `ffmpeg`, which must be installed |

mod gif_movie;
mod mp4_movie;
mod picture_rate;
mod y4m_movie;

pub use picture_rate::PictureRate;

use crate::files::whole_file::WholeFile;
use brickyard_volume::Picture;
use gif_movie::GifMovie;
use mp4_movie::Mp4Movie;
use std::io;
use std::path::{Path, PathBuf};
use y4m_movie::Y4mMovie;

/// A movie's file format.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MovieFormat {
    /// GIF: a palette of 256 colours for each picture; loops forever.
    Gif,
    /// YUV4MPEG2: uncompressed, every pixel's colour.
    Y4m,
    /// H.264 in MP4, by ffmpeg.
    Mp4,
}

impl MovieFormat {
    /// Returns the format of a file by its name.
    ///
    /// # Errors
    /// [`MovieError::Format`] if the name has none.
    pub fn of(path: &Path) -> Result<Self, MovieError> {
        let extension = path.extension().unwrap_or_default().to_ascii_lowercase();
        match extension.to_str() {
            Some("gif") => Ok(Self::Gif),
            Some("y4m") => Ok(Self::Y4m),
            Some("mp4") => Ok(Self::Mp4),
            _ => Err(MovieError::Format(path.into())),
        }
    }
}

/// Errors in writing a movie. Each message begins with the file's path.
#[derive(Debug, thiserror::Error)]
pub enum MovieError {
    /// The file's name has no known format: another name helps.
    #[error("{path}: expected a movie's name, ending in .gif, .y4m or .mp4", path = .0.display())]
    Format(PathBuf),
    /// The format cannot hold such pictures, or not at this rate; the text names a format, size or rate that helps.
    #[error("{path}: {problem}", path = path.display())]
    Unsuited {
        /// The file.
        path: PathBuf,
        /// The limit of the format.
        problem: String,
    },
    /// The format's program does not start: install it, or choose another format.
    #[error(
        "{path}: .mp4 is written by the program ffmpeg, which does not start: {source}; install it in PATH, or write \
         .gif or .y4m",
        path = path.display()
    )]
    NoFfmpeg {
        /// The file.
        path: PathBuf,
        /// The operating system's error.
        source: io::Error,
    },
    /// The format's program failed.
    #[error("{path}: ffmpeg failed ({status}){said}", path = path.display())]
    Ffmpeg {
        /// The file.
        path: PathBuf,
        /// The program's exit status.
        status: std::process::ExitStatus,
        /// Its last output, after a colon; or nothing.
        said: String,
    },
    /// The file cannot be written.
    #[error("{path}: {source}", path = path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// The operating system's error.
        source: io::Error,
    },
}

/// A movie in progress. If dropped before [`MovieFile::finish`], it leaves no file, or the earlier one.
pub struct MovieFile {
    path: PathBuf,
    size_px: (u32, u32),
    encoder: Encoder,
}

enum Encoder {
    Gif(GifMovie),
    Y4m(Y4mMovie<WholeFile>),
    Mp4(Mp4Movie),
}

impl MovieFile {
    /// Begins a movie of pictures of this size in pixels, in the format of the file's name. Tests everything that could
    /// fail later: the folder, and whether ffmpeg writes such a movie.
    ///
    /// # Errors
    /// If the name has no known format, the format cannot hold such pictures, ffmpeg is needed and fails, or the file
    /// cannot be created.
    pub fn create(path: &Path, size_px: (u32, u32), rate: PictureRate) -> Result<Self, MovieError> {
        let format = MovieFormat::of(path)?;
        let unsuited = |problem: String| MovieError::Unsuited { path: path.into(), problem };
        if size_px.0 == 0 || size_px.1 == 0 {
            return Err(unsuited(format!("a picture of {}x{} pixels shows nothing", size_px.0, size_px.1)));
        }
        let failed = |source| MovieError::Write { path: path.into(), source };
        let create = || WholeFile::create(path).map_err(failed);
        let encoder = match format {
            MovieFormat::Gif => {
                GifMovie::check(size_px, rate).map_err(unsuited)?;
                Encoder::Gif(GifMovie::new(create()?, size_px, rate).map_err(failed)?)
            }
            MovieFormat::Y4m => Encoder::Y4m(Y4mMovie::new(create()?, size_px, rate).map_err(failed)?),
            MovieFormat::Mp4 => Encoder::Mp4(Mp4Movie::new(create()?, size_px, rate)?),
        };
        Ok(Self { path: path.into(), size_px, encoder })
    }

    /// The size of the movie's pictures if not the requested one: the next even one, for a format with even sizes only.
    /// The extra columns and rows repeat the last ones.
    pub fn padded_px(&self) -> Option<(u32, u32)> {
        match &self.encoder {
            Encoder::Mp4(_) => Some(mp4_movie::even(self.size_px)).filter(|even| *even != self.size_px),
            Encoder::Gif(_) | Encoder::Y4m(_) => None,
        }
    }

    /// Writes the next picture.
    ///
    /// # Errors
    /// If the picture does not have the movie's size, or the file cannot be written.
    pub fn push(&mut self, picture: &Picture) -> Result<(), MovieError> {
        if (picture.width, picture.height) != self.size_px {
            let ((width, height), Picture { width: found_width, height: found_height, .. }) = (self.size_px, picture);
            let problem = format!("a picture of {found_width}x{found_height} pixels in a movie of {width}x{height}");
            return Err(MovieError::Unsuited { path: self.path.clone(), problem });
        }
        let written = match &mut self.encoder {
            Encoder::Gif(movie) => movie.push(picture),
            Encoder::Y4m(movie) => movie.push(picture),
            Encoder::Mp4(movie) => return movie.push(picture),
        };
        written.map_err(|source| MovieError::Write { path: self.path.clone(), source })
    }

    /// Ends the movie and gives the file its name.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn finish(self) -> Result<(), MovieError> {
        let finished = match self.encoder {
            Encoder::Gif(movie) => movie.finish().and_then(WholeFile::finish),
            Encoder::Y4m(movie) => movie.finish().and_then(WholeFile::finish),
            Encoder::Mp4(movie) => return movie.finish(),
        };
        finished.map_err(|source| MovieError::Write { path: self.path, source })
    }
}

#[cfg(test)]
mod tests;
