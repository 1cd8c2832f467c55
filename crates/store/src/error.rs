//! Errors of stores, grouped by the caller's remedy.

use crate::downsample::{Downsample, Reductions};
use brickyard_import::ImportError;
use brickyard_objects::Fault;
use brickyard_volume::BrickId;
use std::path::{Path, PathBuf};

/// Why nothing may be written at a path.
#[derive(Debug, thiserror::Error)]
pub enum UnfitOutput {
    /// An outsider would write inside a store.
    #[error("{path}: lies inside the store {store}, which is left alone; choose a place outside of it")]
    InsideStore {
        /// The refused output path.
        path: PathBuf,
        /// The store.
        store: PathBuf,
    },
    /// Addresses are read, and never written.
    #[error("{path}: stores at addresses are read, never written; choose a path on disk")]
    Address {
        /// The refused address.
        path: PathBuf,
    },
}

/// Why a store cannot be opened.
#[derive(Debug, thiserror::Error)]
pub enum OpenError {
    /// Nothing at the path resembles a store.
    #[error("{path}: not a brick store (no zarr.json in it); 'brickyard pack INPUT STORE' makes one")]
    NotAStore {
        /// The path to open.
        path: PathBuf,
    },
    /// The path is, or would be, part of a store.
    #[error("{path}: {what} of {store}: pass {store}")]
    Inside {
        /// The path to open.
        path: PathBuf,
        /// A description of the path, such as `is level 0`.
        what: String,
        /// The store around the path.
        store: PathBuf,
    },
    /// An interrupted or running pack: a journal without a completion marker.
    #[error(
        "{path}: incomplete store, {percent} % packed; pack it again from its source with `resume` to finish it, or with `overwrite` \
         to start over"
    )]
    Incomplete {
        /// The store.
        path: PathBuf,
        /// Packed share in percent, 0 to 99.
        percent: u8,
    },
    /// A sound store with an unsupported feature.
    #[error("{path}: {feature} is not supported; {advice}")]
    Unsupported {
        /// The file or directory with the feature.
        path: PathBuf,
        /// The feature.
        feature: String,
        /// The remedy.
        advice: &'static str,
    },
    /// A store in an older, no longer readable format.
    #[error(
        "{store}: has store format {version}, and this program reads format {now}; pack it anew from its source \
         ({source_name}), with `overwrite`",
        now = crate::version::FORMAT_VERSION
    )]
    OldFormat {
        /// The store.
        store: PathBuf,
        /// The store's format version.
        version: u64,
        /// The source recorded in the store.
        source_name: String,
    },
    /// No pyramid of the store uses the requested method.
    #[error(
        "{path}: no level is made by {asked}, only by {found}; pack it anew with `downsample` {main},{asked}",
        asked = asked.name(), main = found.main().name()
    )]
    NoReduction {
        /// The store.
        path: PathBuf,
        /// The requested method.
        asked: Downsample,
        /// The methods of the store's pyramids.
        found: Reductions,
    },
    /// A metadata field contradicts the format or another field.
    #[error("{path}: {field}: expected {expected}, found {found}")]
    Invalid {
        /// The metadata file.
        path: PathBuf,
        /// The field's name inside the file.
        field: String,
        /// The expected content.
        expected: String,
        /// The content found.
        found: String,
    },
    /// The open store was deleted, or another store took its path.
    #[error("{store}: was replaced, moved or deleted while it was open; open it again")]
    Replaced {
        /// The path given on opening.
        store: PathBuf,
    },
    /// Another program's Zarr has no image that can be read, or several without a choice.
    #[error(transparent)]
    Source(#[from] ImportError),
    /// No store can describe another program's image.
    #[error("{path}: {what}")]
    Unfit {
        /// The image.
        path: PathBuf,
        /// The difference, with the remedy.
        what: String,
    },
    /// A file of the store could not be opened or read.
    #[error("{path}: {error}")]
    Io {
        /// The file.
        path: PathBuf,
        /// The operating system's error.
        #[source]
        error: std::io::Error,
    },
}

impl OpenError {
    /// Whether a document is no JSON.
    pub(crate) fn is_of_json(&self) -> bool {
        matches!(self, Self::Invalid { field, expected, .. } if field == "document" && expected == "JSON")
    }

    pub(crate) fn invalid(
        path: &Path,
        field: impl Into<String>,
        expected: impl std::fmt::Display,
        found: impl std::fmt::Display,
    ) -> Self {
        Self::Invalid {
            path: path.into(),
            field: field.into(),
            expected: expected.to_string(),
            found: found.to_string(),
        }
    }
}

/// Why a brick cannot be read from an open store.
#[derive(Debug, thiserror::Error)]
pub enum ReadError {
    /// A shard file of the packed store is missing.
    #[error("{path}: missing shard; restore the file, or make it again by a repair from the input")]
    MissingShard {
        /// The path of the missing shard.
        path: PathBuf,
    },
    /// The shard file differs from the packed one.
    #[error(
        "{path}: {what}: expected {expected}, found {found} (rewritten or truncated by another program); restore the \
         file, make it again by a repair from the input, or index the store (`brickyard index`) if the new voxels are meant"
    )]
    Rewritten {
        /// The shard's file.
        path: PathBuf,
        /// The difference: the length or the index checksum.
        what: &'static str,
        /// The packed length or checksum.
        expected: u64,
        /// The length or checksum found.
        found: u64,
    },
    /// A damaged shard index; none of its bricks can be located.
    #[error("{path}: damaged shard index: {error}")]
    CorruptIndex {
        /// The shard's file.
        path: PathBuf,
        /// The index's fault.
        #[source]
        error: ShardError,
    },
    /// A single damaged brick.
    #[error("{path}: {id}: {error}")]
    CorruptBrick {
        /// The shard's file.
        path: PathBuf,
        /// The damaged brick.
        id: BrickId,
        /// The fault in the brick's bytes.
        #[source]
        error: CodecError,
    },
    /// A damaged page of side data, with lost records of bricks or shards.
    #[error("{path}: damaged side data: {what}")]
    CorruptPage {
        /// The page's file.
        path: PathBuf,
        /// The page's fault.
        what: String,
    },
    /// The open store was deleted, or another store took its path.
    #[error("{store}: was replaced, moved or deleted while it was open; open it again")]
    Replaced {
        /// The path given on opening.
        store: PathBuf,
    },
    /// A chunk of another program's image cannot be read.
    #[error("{error}")]
    Source {
        /// The image.
        path: PathBuf,
        /// The reader's error, which names the chunk.
        #[source]
        error: ImportError,
    },
    /// A file of the store could not be opened or read.
    #[error("{path}: {error}")]
    Io {
        /// The file.
        path: PathBuf,
        /// The operating system's error.
        #[source]
        error: std::io::Error,
    },
}

impl ReadError {
    /// The file at fault.
    pub fn path(&self) -> &Path {
        match self {
            Self::MissingShard { path }
            | Self::Rewritten { path, .. }
            | Self::CorruptIndex { path, .. }
            | Self::CorruptBrick { path, .. }
            | Self::CorruptPage { path, .. }
            | Self::Replaced { store: path }
            | Self::Source { path, .. }
            | Self::Io { path, .. } => path,
        }
    }

    /// Whether a retry may succeed without repair: memory or descriptors ran out, or a disk or network file system did
    /// not respond. Missing, short, damaged or forbidden files stay so.
    pub fn is_passing(&self) -> bool {
        use std::io::ErrorKind::{InvalidData, InvalidInput, NotFound, PermissionDenied, UnexpectedEof};
        let (Self::Io { error, .. } | Self::Source { error: ImportError::Io { error, .. }, .. }) = self else {
            return false;
        };
        if let Some(fault) = Fault::of(error) {
            return fault.is_passing();
        }
        !matches!(error.kind(), NotFound | PermissionDenied | UnexpectedEof | InvalidData | InvalidInput)
    }
}

/// Why a shard's index cannot be trusted.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ShardError {
    /// The file is too short for its index.
    #[error("the file has {found} bytes, its index alone needs {expected}")]
    TooShort {
        /// Bytes needed by the index.
        expected: u64,
        /// Bytes in the whole file.
        found: u64,
    },
    /// The index does not match its checksum.
    #[error("index checksum: stored {stored:08x}, computed {computed:08x}")]
    Checksum {
        /// The stored checksum.
        stored: u32,
        /// The checksum computed from the stored bytes.
        computed: u32,
    },
    /// An index entry points outside the data, or exceeds the length limit of encoded bricks.
    #[error(
        "index entry {slot}: {length} bytes at {offset} do not fit {data} bytes of data in bricks of at most {cap}"
    )]
    Range {
        /// The entry's number in the index.
        slot: usize,
        /// The stored offset of the brick, in bytes.
        offset: u64,
        /// The stored length of the brick, in bytes.
        length: u64,
        /// Bytes of the file before the index.
        data: u64,
        /// The length limit of an encoded brick, in bytes.
        cap: u64,
    },
}

/// Why a brick's bytes cannot be decoded.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum CodecError {
    /// The brick's bytes do not match their checksum.
    #[error("damaged brick: checksum stored {stored:08x}, computed {computed:08x}")]
    Checksum {
        /// The stored checksum.
        stored: u32,
        /// The checksum computed from the stored bytes.
        computed: u32,
    },
    /// The decoded brick has the wrong size.
    #[error("damaged brick: {found} bytes decoded, expected {expected}")]
    Length {
        /// Bytes in a decoded core.
        expected: u64,
        /// Bytes decoded, or announced by a header.
        found: u64,
    },
    /// Valid checksum, but not from our codec.
    #[error("damaged brick: {0}")]
    Malformed(String),
    /// A sound Blosc container with an unsupported feature.
    #[error("{0} is not supported")]
    Unsupported(String),
}
