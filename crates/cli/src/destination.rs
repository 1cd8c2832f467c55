//! The destination of a `render`'s pictures: numbered files, or a movie.

use super::output::{is_stdout, may_write_data, may_write_file, may_write_png};
use super::render_args::RenderArguments;
use super::say::say;
use super::{Failure, printed};
use brickyard::movie_file::{MovieError, MovieFile};
use brickyard::picture_file::{send_shown, write_shown};
use brickyard::stats::RenderStats;
use brickyard::volume::{Picture, Scene};
use std::ffi::OsStr;
use std::path::{Path, PathBuf};

fn place_of(path: &Path) -> (Option<PathBuf>, Option<&OsStr>) {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    (folder.canonicalize().ok(), path.file_name())
}

/// The files of a run's pictures.
pub(super) enum Destination {
    /// PNG files.
    Pictures { output: PathBuf, count: usize },
    /// A PNG file on standard output.
    Stdout,
    /// One file of all of them.
    Movie { movie: Box<MovieFile>, path: PathBuf, count: usize },
}

impl Destination {
    /// Creates the destination of `count` pictures. Checks that all files may be written, including the statistics;
    /// begins a movie.
    ///
    /// # Errors
    /// Exit code 2 if a file may not be written, or its format cannot hold the movie; 1 if a movie cannot be begun.
    pub(super) fn new(arguments: &RenderArguments, count: usize) -> Result<Self, Failure> {
        let is_not_stats = |path: &Path| {
            if arguments.stats.as_deref().is_some_and(|stats| place_of(stats) == place_of(path)) {
                let problem = format!("{}: cannot be a picture and hold the statistics", path.display());
                return Err(Failure::usage(problem));
            }
            Ok(())
        };
        if let Some(path) = &arguments.movie {
            may_write_file(path, arguments.overwrite)?;
            is_not_stats(path)?;
        }
        if let Some(output) = arguments.output.as_ref().filter(|output| !is_stdout(output)) {
            (0..count).try_for_each(|i| {
                let path = numbered(output, i, count);
                may_write_png(&path, arguments.overwrite)?;
                is_not_stats(&path)
            })?;
        }
        arguments.stats.iter().try_for_each(|path| may_write_data(path, arguments.overwrite))?;
        match (&arguments.movie, &arguments.output) {
            (Some(path), _) => Self::movie(arguments, path, count),
            (None, Some(output)) if is_stdout(output) => match (count, &arguments.stats) {
                (1, Some(stats)) if is_stdout(stats) => {
                    Err(Failure::usage("standard output takes a picture or the statistics: give one of them a name"))
                }
                (1, _) => Ok(Self::Stdout),
                _ => Err(Failure::usage(format!("standard output takes one picture, not {count}: give -o out.png"))),
            },
            (None, Some(output)) => Ok(Self::Pictures { output: output.clone(), count }),
            (None, None) => Err(Failure::usage("nowhere to write: give -o out.png, or --movie out.mp4")),
        }
    }

    fn movie(arguments: &RenderArguments, path: &Path, count: usize) -> Result<Self, Failure> {
        if count == 1 {
            return Err(Failure::usage(format!(
                "--movie {}: a movie of one picture; make several with --time all, --orbit 36 or --path path.json, or \
                 write a picture with -o out.png",
                path.display()
            )));
        }
        let movie = MovieFile::create(path, arguments.size, arguments.rate).map_err(movie_failure)?;
        if let Some((width, height)) = movie.padded_px() {
            say!(
                "note: {}: its pictures are {width}x{height}, as its format takes only even sizes: the last column or \
                 row is repeated",
                path.display()
            );
        }
        Ok(Self::Movie { movie: Box::new(movie), path: path.to_path_buf(), count })
    }

    /// Writes picture `i`, of this scene.
    ///
    /// # Errors
    /// If it cannot be written.
    pub(super) fn write(
        &mut self,
        i: usize,
        picture: &Picture,
        shown: &Scene,
        stats: &RenderStats,
    ) -> Result<(), Failure> {
        match self {
            Self::Pictures { output, count } => {
                write_shown(&numbered(output, i, *count), picture, shown, stats).map_err(Failure::failed)
            }
            Self::Stdout => printed(send_shown(&mut std::io::stdout().lock(), picture, shown, stats)),
            Self::Movie { movie, .. } => movie.push(picture).map_err(movie_failure),
        }
    }

    /// Ends the movie, which exists from now on, and prints the written files.
    ///
    /// # Errors
    /// If it cannot be written.
    pub(super) fn finish(self) -> Result<(), Failure> {
        match self {
            Self::Pictures { output, count: 1 } => say!("wrote {}", output.display()),
            Self::Pictures { output, count } => {
                let [first, last] = [0, count - 1].map(|i| numbered(&output, i, count));
                say!("wrote {count} pictures, {} to {}", first.display(), last.display());
            }
            Self::Stdout => {}
            Self::Movie { movie, path, count } => {
                movie.finish().map_err(movie_failure)?;
                say!("wrote {}, a movie of {count} pictures", path.display());
            }
        }
        Ok(())
    }
}

fn movie_failure(error: MovieError) -> Failure {
    match error {
        MovieError::Format(_) | MovieError::Unsuited { .. } => Failure::usage(error),
        MovieError::NoFfmpeg { .. } | MovieError::Ffmpeg { .. } | MovieError::Write { .. } => Failure::failed(error),
    }
}

/// Numbers a file with at least three digits, and as many as the last one needs, so names sort like pictures.
fn numbered(path: &Path, index: usize, count: usize) -> PathBuf {
    if count == 1 {
        return path.to_path_buf();
    }
    let digits = (count - 1).to_string().len().max(3);
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    let extension = path.extension().unwrap_or("png".as_ref()).to_string_lossy();
    path.with_file_name(format!("{stem}_{index:0digits$}.{extension}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn several_pictures_are_numbered() {
        assert_eq!(numbered(Path::new("a/b.png"), 0, 1), Path::new("a/b.png"));
        assert_eq!(numbered(Path::new("a/b.png"), 7, 20), Path::new("a/b_007.png"));
        assert_eq!(numbered(Path::new("b"), 1, 2), Path::new("b_001.png"));
        assert_eq!(numbered(Path::new("b.png"), 7, 1000), Path::new("b_007.png"));
        assert_eq!(numbered(Path::new("b.png"), 7, 1001), Path::new("b_0007.png"));
    }
}
