//! Raw voxels from standard input or a named pipe, copied into an unnamed scratch file of their size, which is then read as a raw file. Costs one pass
//! over the stream, and scratch space as large as its voxels.

#[cfg(test)]
mod tests;

use crate::body::check_space;
use crate::error::{ImportError, Result};
use crate::mapped::MappedFile;
use crate::options::{ArrayPlace, ChannelArray, OpenOptions};
use crate::raw::{RawLayout, RawSource};
use crate::temporary::unnamed_in;
use brickyard_volume::counted;
use std::fs::File;
use std::io::{ErrorKind, IsTerminal, Read, Write};
use std::path::{Path, PathBuf};
use std::time::SystemTime;

/// The name of standard input.
const STANDARD_INPUT: &str = "-";

/// Whether an input is standard input (`-`), or a named pipe. Such an input is read once, and so cannot be packed with `--resume`.
pub(crate) fn is_pipe(input: &Path) -> bool {
    is_standard_input(input) || std::fs::metadata(input).is_ok_and(|data| is_fifo(&data))
}

/// The first stream among inputs and files of channels.
pub fn stream_among<'a>(inputs: &'a [PathBuf], arrays: &'a [ChannelArray]) -> Option<&'a Path> {
    let files = arrays.iter().filter_map(|array| match &array.place {
        ArrayPlace::File(file) => Some(file),
        ArrayPlace::Input(_) => None,
    });
    inputs.iter().chain(files).map(PathBuf::as_path).find(|path| is_pipe(path))
}

fn is_standard_input(input: &Path) -> bool {
    input.as_os_str() == STANDARD_INPUT
}

#[cfg(unix)]
fn is_fifo(data: &std::fs::Metadata) -> bool {
    std::os::unix::fs::FileTypeExt::is_fifo(&data.file_type())
}

#[cfg(not(unix))]
fn is_fifo(_data: &std::fs::Metadata) -> bool {
    false
}

/// Reads a stream of voxels with this layout to its end.
///
/// # Errors
/// If the stream is a terminal or of another length, or scratch space is short.
pub(crate) fn open(input: &Path, layout: &RawLayout, options: &OpenOptions) -> Result<RawSource> {
    if options.is_step {
        let problem = "a stream is one input by itself: append its steps one by one";
        return Err(ImportError::options(input, problem));
    }
    if !is_standard_input(input) {
        layout.end_bytes(input)?;
        return spooled(File::open(input).map_err(ImportError::io(input))?, input, layout, options);
    }
    let (path, stdin) = (PathBuf::from("standard input"), std::io::stdin());
    if stdin.is_terminal() {
        return Err(ImportError::options(&path, "is a terminal: send the voxels into it, or name a file"));
    }
    spooled(stdin.lock(), &path, layout, options)
}

/// Copies a stream into a scratch file and opens it. `path` is the stream's, for messages.
fn spooled(mut stream: impl Read, path: &Path, layout: &RawLayout, options: &OpenOptions) -> Result<RawSource> {
    let expected = layout.end_bytes(path)?;
    let folder = options.scratch_dir.clone().unwrap_or_else(std::env::temp_dir);
    check_space(&folder, expected)?;
    let mut scratch = unnamed_in(&folder).map_err(ImportError::scratch(&folder))?;
    let mut buffer = vec![0; 1 << 18];
    let mut copied = 0;
    while copied < expected {
        let most = buffer.len().min(usize::try_from(expected - copied).unwrap_or(usize::MAX));
        match read_some(&mut stream, &mut buffer[..most], path)? {
            0 => {
                let problem = format!(
                    "ended after {}, expected {expected} for {} {}: check what is sent, `shape` and `voxel_type`",
                    counted(copied, "byte"),
                    layout.extent,
                    layout.element
                );
                return Err(ImportError::invalid(path, problem));
            }
            n => {
                scratch.write_all(&buffer[..n]).map_err(ImportError::scratch(&folder))?;
                copied += n as u64;
            }
        }
    }
    if read_some(&mut stream, &mut buffer[..1], path)? > 0 {
        let problem = format!(
            "goes on after the {} of {} {}: check `shape` and `voxel_type`, or send no more",
            counted(expected, "byte"),
            layout.extent,
            layout.element
        );
        return Err(ImportError::invalid(path, problem));
    }
    // No other stream has this identity, so no unfinished store goes on with other voxels.
    let now = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).map_or(0, |time| time.as_nanos());
    let identity = format!("stream {layout:?} of process {} at {now} ns", std::process::id());
    RawSource::of_stream(MappedFile::of_scratch(path, &scratch)?, layout, identity)
}

/// Reads up to a buffer's length; 0 at the end.
fn read_some(stream: &mut impl Read, buffer: &mut [u8], path: &Path) -> Result<usize> {
    loop {
        match stream.read(buffer) {
            Err(error) if error.kind() == ErrorKind::Interrupted => {}
            read => return read.map_err(ImportError::io(path)),
        }
    }
}
