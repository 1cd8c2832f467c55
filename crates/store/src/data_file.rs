//! Data files open for reading: no pipes, devices or sockets, which may block forever.

use rustix::fs::{CWD, Mode, OFlags, openat};
use std::fs::File;
use std::io::{Error, Read};
use std::os::fd::AsFd;
use std::path::Path;

pub(crate) fn open_file(path: &Path) -> std::io::Result<File> {
    open_at(CWD, path)
}

/// Opens a file for reading by its path relative to a folder.
pub(crate) fn open_at(dir: impl AsFd, path: &Path) -> std::io::Result<File> {
    // Otherwise opening a pipe would block until it has a writer.
    let flags = OFlags::RDONLY | OFlags::CLOEXEC | OFlags::NONBLOCK;
    let file = File::from(rustix::io::retry_on_intr(|| openat(&dir, path, flags, Mode::empty()))?);
    let kind = file.metadata()?.file_type();
    if kind.is_file() || kind.is_dir() { Ok(file) } else { Err(Error::other("is not a regular file")) }
}

/// Reads a file of at most `most` bytes; fails if it is longer.
pub(crate) fn read_at_most(file: std::io::Result<File>, most: u64) -> std::io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    file?.take(most + 1).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > most {
        return Err(std::io::Error::other(format!("larger than its limit of {most} bytes")));
    }
    Ok(bytes)
}
