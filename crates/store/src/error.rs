//! What can go wrong with a store, by what the caller can do about it.

use crate::downsample::{Downsample, Reductions};
use brickyard_volume::BrickId;
use std::path::{Path, PathBuf};

/// Why a store cannot be opened.
#[derive(Debug, thiserror::Error)]
pub enum OpenError {
    /// There is nothing here that could be a store.
    #[error("{path}: not a brick store (no zarr.json in it); 'brickyard pack INPUT {path}' makes one", path = path.display())]
    NotAStore {
        /// The directory asked for.
        path: PathBuf,
    },
    /// A pack was interrupted: the journal is there, the completion marker is not.
    #[error(
        "{path}: incomplete store, {percent} % packed; pack it again from its source with `resume` to finish it, or with `overwrite` \
         to start over",
        path = path.display()
    )]
    Incomplete {
        /// The store.
        path: PathBuf,
        /// How much of it is there, 0 to 99.
        percent: u8,
    },
    /// Sound, but with something that is not read yet.
    #[error("{path}: {feature} is not supported", path = path.display())]
    Unsupported {
        /// The file that says so.
        path: PathBuf,
        /// What it uses, and what to do.
        feature: String,
    },
    /// Written by an earlier version of this program, in a format that is not read any more.
    #[error(
        "{store}: is a store of format {version}, and this program reads format {now}; pack it anew from its source ({source_name}), \
         with `overwrite`",
        store = store.display(), now = crate::version::FORMAT_VERSION
    )]
    OldFormat {
        /// The store.
        store: PathBuf,
        /// Its format.
        version: u64,
        /// What it says that it was packed from.
        source_name: String,
    },
    /// The store's levels are made in other ways.
    #[error(
        "{path}: no level is made by {asked}, only by {found}; pack it with `downsample` {main},{asked}",
        path = path.display(), asked = asked.name(), main = found.main().name()
    )]
    NoReduction {
        /// The store.
        path: PathBuf,
        /// What was asked for.
        asked: Downsample,
        /// What is there.
        found: Reductions,
    },
    /// A field contradicts the format or another field.
    #[error("{path}: {field}: expected {expected}, found {found}", path = path.display())]
    Invalid {
        /// The file.
        path: PathBuf,
        /// The field inside it.
        field: String,
        /// What should be there.
        expected: String,
        /// What is there.
        found: String,
    },
    /// The operating system refused.
    #[error("{path}: {error}", path = path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What it said.
        #[source]
        error: std::io::Error,
    },
}

impl OpenError {
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
    /// The store says that this file exists.
    #[error("{path}: missing shard (the store was packed with it); pack again or restore the file", path = path.display())]
    MissingShard {
        /// The shard.
        path: PathBuf,
    },
    /// The file is not the one that was packed.
    #[error(
        "{path}: {what}: expected {expected}, found {found} (rewritten or truncated by another tool); pack again or restore \
         the file",
        path = path.display()
    )]
    Rewritten {
        /// The shard.
        path: PathBuf,
        /// What differs: the length or the index checksum.
        what: &'static str,
        /// The value as packed.
        expected: u64,
        /// The value as found.
        found: u64,
    },
    /// The shard's index is damaged, so none of its bricks can be found.
    #[error("{path}: damaged shard index: {error}", path = path.display())]
    CorruptIndex {
        /// The shard.
        path: PathBuf,
        /// How.
        #[source]
        error: ShardError,
    },
    /// One brick is damaged.
    #[error("{path}: {id}: {error}", path = path.display())]
    CorruptBrick {
        /// The shard.
        path: PathBuf,
        /// The brick.
        id: BrickId,
        /// How.
        #[source]
        error: CodecError,
    },
    /// A page of side data is damaged: what it says of bricks or shards is not known.
    #[error("{path}: damaged side data: {what}", path = path.display())]
    CorruptPage {
        /// The page's file.
        path: PathBuf,
        /// How.
        what: String,
    },
    /// The operating system refused.
    #[error("{path}: {error}", path = path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What it said.
        #[source]
        error: std::io::Error,
    },
}

impl ReadError {
    /// The file.
    pub fn path(&self) -> &Path {
        match self {
            Self::MissingShard { path }
            | Self::Rewritten { path, .. }
            | Self::CorruptIndex { path, .. }
            | Self::CorruptBrick { path, .. }
            | Self::CorruptPage { path, .. }
            | Self::Io { path, .. } => path,
        }
    }

    /// Whether the same read may go well later, with nothing mended: memory or descriptors that ran out, a network file system
    /// or a disk that does not answer. What is missing, shorter, damaged or not permitted stays so.
    pub fn is_passing(&self) -> bool {
        use std::io::ErrorKind::{InvalidData, InvalidInput, NotFound, PermissionDenied, UnexpectedEof};
        let Self::Io { error, .. } = self else { return false };
        !matches!(error.kind(), NotFound | PermissionDenied | UnexpectedEof | InvalidData | InvalidInput)
    }
}

/// Why a shard's index cannot be trusted.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ShardError {
    /// Not even room for the index.
    #[error("the file has {found} bytes, its index alone needs {expected}")]
    TooShort {
        /// Bytes of the index.
        expected: u64,
        /// Bytes of the file.
        found: u64,
    },
    /// The index does not match its checksum.
    #[error("index checksum: stored {stored:08x}, computed {computed:08x}")]
    Checksum {
        /// The checksum in the file.
        stored: u32,
        /// The checksum of the bytes in the file.
        computed: u32,
    },
    /// An entry points outside the data, or is larger than an encoded brick can be.
    #[error(
        "index entry {slot}: {length} bytes at {offset} do not fit {data} bytes of data in bricks of at most {cap}"
    )]
    Range {
        /// Which entry.
        slot: usize,
        /// The offset as stored.
        offset: u64,
        /// The length as stored.
        length: u64,
        /// Bytes before the index.
        data: u64,
        /// The greatest length that an encoded brick may have.
        cap: u64,
    },
}

/// Why a brick's bytes cannot be decoded.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum CodecError {
    /// The bytes do not match their checksum.
    #[error("damaged brick: checksum stored {stored:08x}, computed {computed:08x}")]
    Checksum {
        /// The checksum in the file.
        stored: u32,
        /// The checksum of the bytes in the file.
        computed: u32,
    },
    /// The decoded brick has the wrong size.
    #[error("damaged brick: {found} bytes decoded, expected {expected}")]
    Length {
        /// Bytes of a core.
        expected: u64,
        /// Bytes decoded, or announced.
        found: u64,
    },
    /// The bytes pass their checksum but are not what the codec writes.
    #[error("damaged brick: {0}")]
    Malformed(String),
    /// A sound container with something that is not read.
    #[error("{0} is not supported")]
    Unsupported(String),
}

/// Why an export failed. Nothing is left under the output's name then.
#[derive(Debug, thiserror::Error)]
pub enum ExportError {
    /// The output is there already.
    #[error("{path}: exists already; choose another name or pass `overwrite`", path = path.display())]
    Exists {
        /// The output.
        path: PathBuf,
    },
    /// The output's extension names no format that is written.
    #[error("{path}: cannot export to this extension; supported: .raw, .npy", path = path.display())]
    Extension {
        /// The output.
        path: PathBuf,
    },
    /// The store has no such level, time step, channel or box.
    #[error("{what} {found} is outside the store: expected {expected}")]
    Outside {
        /// Which request.
        what: &'static str,
        /// What was asked for.
        found: String,
        /// What there is.
        expected: String,
    },
    /// A brick could not be read.
    #[error(transparent)]
    Read(#[from] ReadError),
    /// The operating system refused.
    #[error("{path}: {error}", path = path.display())]
    Io {
        /// The output.
        path: PathBuf,
        /// What it said.
        #[source]
        error: std::io::Error,
    },
}
