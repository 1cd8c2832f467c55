//! A file of a store read by ranges: on disk at offsets, at an address by requests. Opening reads its end, where indexes are.

use crate::folder::Folder;
use brickyard_objects::{Fault, Place, Version};
use std::fs::File;
use std::io;
use std::ops::Range;
use std::os::unix::fs::FileExt;
use std::path::Path;

/// A file open for ranges of it.
pub(crate) struct RangedFile {
    body: Body,
    bytes: u64,
}

enum Body {
    Disk(File),
    Remote(Place, Version),
}

impl RangedFile {
    /// Opens a file, and reads its last bytes: so many, or all if there are fewer, or if a file at an address was looked at ahead.
    pub(crate) fn open(folder: &Folder, path: &Path, end_bytes: u64) -> io::Result<(Self, Box<[u8]>)> {
        if let Some(place) = folder.place(path)? {
            let object = place.tail(end_bytes)?.ok_or(Fault::Absent)?;
            let bytes = object.version.bytes;
            return Ok((Self { body: Body::Remote(place, object.version), bytes }, object.bytes.into()));
        }
        let file = folder.file(path)?;
        let bytes = file.metadata()?.len();
        let mut end = vec![0; end_bytes.min(bytes) as usize].into_boxed_slice();
        let first = bytes - end.len() as u64;
        file.read_exact_at(&mut end, first)?;
        Ok((Self { body: Body::Disk(file), bytes }, end))
    }

    /// Bytes of the file.
    pub(crate) fn bytes(&self) -> u64 {
        self.bytes
    }

    /// Reads ranges of a file at an address, neighbouring ones at once.
    pub(crate) fn read_ranges(&self, ranges: impl Iterator<Item = Range<u64>>) -> io::Result<Vec<Vec<u8>>> {
        match &self.body {
            Body::Disk(_) => Err(io::ErrorKind::Unsupported.into()),
            Body::Remote(place, version) => {
                place.objects.ranges(&place.name, &ranges.collect::<Vec<_>>(), Some(version))
            }
        }
    }

    /// Fills a buffer from a place in the file.
    pub(crate) fn read_exact_at(&self, out: &mut [u8], offset: u64) -> io::Result<()> {
        match &self.body {
            Body::Disk(file) => file.read_exact_at(out, offset),
            Body::Remote(place, version) => {
                let read = place.range(offset..offset + out.len() as u64, Some(version))?;
                out.copy_from_slice(&read);
                Ok(())
            }
        }
    }
}
