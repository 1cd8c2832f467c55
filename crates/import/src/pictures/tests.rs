//! Pictures made byte by byte, from the formats' specifications, with known voxels.

mod bmp;
mod damage;
mod jpeg;
mod png;
mod stacks;

use crate::open::open;
use crate::options::OpenOptions;
use crate::source::Source;
use crate::testing::temp_file;
use std::path::{Path, PathBuf};

/// Opens files in a folder of their own.
fn opened_as(files: &[(&str, Vec<u8>)], options: &OpenOptions) -> Result<(tempfile::TempDir, Box<dyn Source>), String> {
    let folder = tempfile::tempdir().unwrap();
    let paths: Vec<PathBuf> = files.iter().map(|(name, _)| folder.path().join(name)).collect();
    for (path, (_, bytes)) in paths.iter().zip(files) {
        std::fs::write(path, bytes).unwrap();
    }
    let source = open(&paths, options).map_err(|error| error.to_string())?;
    Ok((folder, source))
}

fn opened(name: &str, bytes: Vec<u8>) -> (tempfile::TempDir, Box<dyn Source>) {
    opened_as(&[(name, bytes)], &OpenOptions::default()).unwrap()
}

/// Why a file is refused, on opening or reading.
fn refusal(name: &str, bytes: &[u8]) -> String {
    refusal_with(name, bytes, &OpenOptions::default())
}

fn refusal_with(name: &str, bytes: &[u8], options: &OpenOptions) -> String {
    let (_folder, path) = temp_file(name, bytes);
    read_all(&path, options).unwrap_err()
}

/// Opens a file and reads all of it, channel by channel.
fn read_all(path: &Path, options: &OpenOptions) -> Result<Vec<u8>, String> {
    let source = open(&[path.to_owned()], options).map_err(|error| error.to_string())?;
    let mut all = Vec::new();
    for channel in 0..source.info().channels {
        all.extend(channel_of(&*source, channel).map_err(|error| error.to_string())?);
    }
    Ok(all)
}

fn channel_of(source: &dyn Source, channel: u32) -> Result<Vec<u8>, crate::error::ImportError> {
    let full = source.info().extent.full_box();
    let mut out = vec![0xa5; full.extent().volume() as usize * source.info().voxel_type.bytes()];
    source.read_box(0, channel, full, &mut out).map(|()| out)
}

/// Bytes of a picture's first channel.
fn first_channel(source: &dyn Source) -> Vec<u8> {
    channel_of(source, 0).unwrap()
}
