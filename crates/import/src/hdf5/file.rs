//! An HDF5 file opened by the parser, and its errors in this crate's words.

use super::bytes::Bytes;
use crate::error::{ImportError, Result};
use crate::mapped::MappedFile;
use hdf5_reader::error::Error;
use hdf5_reader::{Hdf5File, OpenOptions};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Most bytes of a value that the parser itself reads: coordinates and heaps, never voxels.
const MOST_READ_BYTES: usize = 128 << 20;
pub(super) const MOST_HEADER_BYTES: usize = 16 << 20;

const MAGIC: &[u8] = b"\x89HDF\r\n\x1a\n";

/// Whether a file starts like HDF5, possibly after a user block of 512, 1024, 2048, ... bytes.
pub(crate) fn is_hdf5(path: &Path) -> Result<bool> {
    use std::io::{Read, Seek, SeekFrom};
    let mut file = std::fs::File::open(path).map_err(ImportError::io(path))?;
    let length = file.metadata().map_err(ImportError::io(path))?.len();
    let starts = std::iter::once(0).chain((9..).map(|power| 1u64 << power));
    for start in starts.take_while(|start| start + MAGIC.len() as u64 <= length) {
        let mut bytes = [0; 8];
        file.seek(SeekFrom::Start(start)).and_then(|_| file.read_exact(&mut bytes)).map_err(ImportError::io(path))?;
        if bytes == MAGIC {
            return Ok(true);
        }
    }
    Ok(false)
}

pub(super) struct File {
    pub(super) path: PathBuf,
    pub(super) map: Arc<MappedFile>,
    /// The map as the parser reads it.
    pub(super) bytes: Arc<Bytes>,
    pub(super) hdf: Hdf5File,
}

impl File {
    pub(super) fn open(path: &Path) -> Result<Self> {
        let map = Arc::new(MappedFile::open(path)?);
        // Chunks are decoded and kept by the source.
        let options = OpenOptions::default()
            .with_chunk_cache_bytes(0)
            .with_max_chunk_bytes(MOST_READ_BYTES)
            .with_max_read_bytes(MOST_READ_BYTES)
            .with_max_object_header_bytes(MOST_HEADER_BYTES);
        let bytes = Arc::new(Bytes::new(map.clone()));
        let hdf = Hdf5File::from_storage_with_options(bytes.clone(), options);
        let hdf = hdf.map_err(|error| refusal(path, "the file", &error))?;
        Ok(Self { path: path.to_owned(), map, bytes, hdf })
    }

    /// Bytes before the place that all addresses count from.
    pub(super) fn base(&self) -> u64 {
        self.hdf.superblock().base_address
    }

    pub(super) fn damaged(&self, what: &str, problem: &str) -> ImportError {
        ImportError::invalid(&self.path, format!("{what} is damaged: {problem}; fetch or write the file again"))
    }

    pub(super) fn refusal(&self, what: &str, error: &Error) -> ImportError {
        refusal(&self.path, what, error)
    }
}

/// The cause of an error, without the places around it.
pub(super) fn cause_of(error: &Error) -> &Error {
    match error {
        Error::Context { source, .. } => cause_of(source),
        cause => cause,
    }
}

/// The parser's error about a part of the file.
fn refusal(path: &Path, what: &str, error: &Error) -> ImportError {
    let advice = "write it anew with h5py, as plain arrays";
    let (mut cause, mut what) = (error, what.to_owned());
    while let Error::Context { source, path } = cause {
        // The parser calls an object `child 'name' at 0x...`.
        let name = path.split('\'').nth(1).unwrap_or(path);
        (cause, what) = (source, if name.is_empty() { what } else { name.to_owned() });
    }
    match cause {
        Error::UnsupportedLayoutClass(3) => {
            let advice = "copy it, as h5py does by file['new'] = file['it'][...]";
            ImportError::unsupported_but(path, format!("{what}, a virtual dataset,"), advice)
        }
        Error::UnsupportedDatatypeClass(class) => {
            ImportError::unsupported_but(path, format!("{what} of the datatype class {class}"), advice)
        }
        Error::UnexpectedEof { .. } | Error::OffsetOutOfBounds(_) => {
            let problem = format!("cut short or damaged: {what} cannot be read: {cause}; fetch the file again");
            ImportError::invalid(path, problem)
        }
        cause if cause.to_string().starts_with("unsupported") => {
            let text = cause.to_string();
            let feature = text.trim_start_matches("unsupported ").trim_end_matches(" is not supported");
            ImportError::unsupported_but(path, format!("{what} with {feature}"), advice)
        }
        cause => {
            let problem = format!("{what} is damaged: {cause}; fetch or write the file again");
            ImportError::invalid(path, problem)
        }
    }
}
