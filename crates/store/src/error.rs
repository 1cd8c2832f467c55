//! What can go wrong with a store, by what the caller can do about it.

use crate::downsample::{Downsample, Reductions};
use brickyard_volume::BrickId;
use std::path::{Path, PathBuf};

/// Something was to be written inside of a store, by somebody who is not at work on it.
#[derive(Debug, thiserror::Error)]
#[error("{path}: lies inside of the store {store}, which is left alone; choose a place outside of it", path = path.display(), store = store.display())]
pub struct InsideStore {
    /// The path that was to be written.
    pub path: PathBuf,
    /// The store.
    pub store: PathBuf,
}

/// Why a store cannot be opened.
#[derive(Debug, thiserror::Error)]
pub enum OpenError {
    /// The path holds nothing that could be a store.
    #[error(
        "{path}: not a brick store (no zarr.json in it); 'brickyard pack INPUT STORE' makes one",
        path = path.display()
    )]
    NotAStore {
        /// The path that was to be opened.
        path: PathBuf,
    },
    /// The path is a part of a store, or would be one, and not the store itself.
    #[error("{path}: {what} of {store}: give {store}", path = path.display(), store = store.display())]
    Inside {
        /// The path that was to be opened.
        path: PathBuf,
        /// What the path is, in words, such as `this is level 0`.
        what: String,
        /// The store that the path is inside of.
        store: PathBuf,
    },
    /// A pack was interrupted, or is still at work: the journal is there, the completion marker is not.
    #[error(
        "{path}: incomplete store, {percent} % packed; pack it again from its source with `resume` to finish it, or with `overwrite` \
         to start over",
        path = path.display()
    )]
    Incomplete {
        /// The store.
        path: PathBuf,
        /// How much of the store is packed, in percent, 0 to 99.
        percent: u8,
    },
    /// The store is sound, but uses something that is not supported.
    #[error("{path}: {feature} is not supported; {advice}", path = path.display())]
    Unsupported {
        /// The file or directory that uses it.
        path: PathBuf,
        /// What the file uses.
        feature: String,
        /// What to do.
        advice: &'static str,
    },
    /// The store was written by an earlier version of this program, in a format that is not read any more.
    #[error(
        "{store}: is a store of format {version}, and this program reads format {now}; pack it anew from its source ({source_name}), \
         with `overwrite`",
        store = store.display(), now = crate::version::FORMAT_VERSION
    )]
    OldFormat {
        /// The store.
        store: PathBuf,
        /// The version of the store's format.
        version: u64,
        /// What the store was packed from, as it says itself.
        source_name: String,
    },
    /// None of the store's pyramids is made by the method asked for.
    #[error(
        "{path}: no level is made by {asked}, only by {found}; pack it with `downsample` {main},{asked}",
        path = path.display(), asked = asked.name(), main = found.main().name()
    )]
    NoReduction {
        /// The store.
        path: PathBuf,
        /// The method that was asked for.
        asked: Downsample,
        /// The methods of the store's pyramids.
        found: Reductions,
    },
    /// A field of the metadata contradicts the format or another field.
    #[error("{path}: {field}: expected {expected}, found {found}", path = path.display())]
    Invalid {
        /// The metadata file.
        path: PathBuf,
        /// The field inside the file.
        field: String,
        /// What the field should hold.
        expected: String,
        /// What the field holds.
        found: String,
    },
    /// The open store is not there any more: it was deleted, or another one has its path.
    #[error("{store}: was replaced, moved or deleted while it was open; open it again", store = store.display())]
    Replaced {
        /// The path by which the store was opened.
        store: PathBuf,
    },
    /// The operating system could not open or read a file of the store.
    #[error("{path}: {error}", path = path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// The operating system's error.
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
    /// A shard's file is missing, though the store was packed with it.
    #[error("{path}: missing shard (the store was packed with it); pack again or restore the file", path = path.display())]
    MissingShard {
        /// The path of the missing shard.
        path: PathBuf,
    },
    /// A shard's file is not the one that was packed.
    #[error(
        "{path}: {what}: expected {expected}, found {found} (rewritten or truncated by another tool); pack again or restore \
         the file",
        path = path.display()
    )]
    Rewritten {
        /// The shard's file.
        path: PathBuf,
        /// What differs: the length or the index checksum.
        what: &'static str,
        /// The length or checksum that was packed.
        expected: u64,
        /// The length or checksum that was found.
        found: u64,
    },
    /// A shard's index is damaged, so none of its bricks can be found.
    #[error("{path}: damaged shard index: {error}", path = path.display())]
    CorruptIndex {
        /// The shard's file.
        path: PathBuf,
        /// What is wrong with the index.
        #[source]
        error: ShardError,
    },
    /// One brick is damaged.
    #[error("{path}: {id}: {error}", path = path.display())]
    CorruptBrick {
        /// The shard's file.
        path: PathBuf,
        /// The damaged brick.
        id: BrickId,
        /// What is wrong with the brick's bytes.
        #[source]
        error: CodecError,
    },
    /// A page of side data is damaged, so what it says of bricks or shards is not known.
    #[error("{path}: damaged side data: {what}", path = path.display())]
    CorruptPage {
        /// The page's file.
        path: PathBuf,
        /// What is wrong with the page.
        what: String,
    },
    /// The open store is not there any more: it was deleted, or another one has its path.
    #[error("{store}: was replaced, moved or deleted while it was open; open it again", store = store.display())]
    Replaced {
        /// The path by which the store was opened.
        store: PathBuf,
    },
    /// The operating system could not open or read a file of the store.
    #[error("{path}: {error}", path = path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// The operating system's error.
        #[source]
        error: std::io::Error,
    },
}

impl ReadError {
    /// The file that the error is about.
    pub fn path(&self) -> &Path {
        match self {
            Self::MissingShard { path }
            | Self::Rewritten { path, .. }
            | Self::CorruptIndex { path, .. }
            | Self::CorruptBrick { path, .. }
            | Self::CorruptPage { path, .. }
            | Self::Replaced { store: path }
            | Self::Io { path, .. } => path,
        }
    }

    /// Whether the same read may succeed later without any repair: memory or descriptors ran out, or a network file
    /// system or a disk did not answer. A file that is missing, shorter, damaged or not permitted stays so.
    pub fn is_passing(&self) -> bool {
        use std::io::ErrorKind::{InvalidData, InvalidInput, NotFound, PermissionDenied, UnexpectedEof};
        let Self::Io { error, .. } = self else { return false };
        !matches!(error.kind(), NotFound | PermissionDenied | UnexpectedEof | InvalidData | InvalidInput)
    }
}

/// Why a shard's index cannot be trusted.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ShardError {
    /// The file is too short for its index.
    #[error("the file has {found} bytes, its index alone needs {expected}")]
    TooShort {
        /// Bytes that the index needs.
        expected: u64,
        /// Bytes of the whole file.
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
    /// An entry of the index points outside the data, or is longer than an encoded brick can be.
    #[error(
        "index entry {slot}: {length} bytes at {offset} do not fit {data} bytes of data in bricks of at most {cap}"
    )]
    Range {
        /// The number of the entry in the index.
        slot: usize,
        /// The offset of the brick, as stored, in bytes.
        offset: u64,
        /// The length of the brick, as stored, in bytes.
        length: u64,
        /// Bytes of the file before the index.
        data: u64,
        /// The greatest length that an encoded brick may have, in bytes.
        cap: u64,
    },
}

/// Why a brick's bytes cannot be decoded.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum CodecError {
    /// The brick's bytes do not match their checksum.
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
        /// Bytes that a decoded core has.
        expected: u64,
        /// Bytes that were decoded, or that a header announces.
        found: u64,
    },
    /// The brick's bytes match their checksum, but are not what the codec writes.
    #[error("damaged brick: {0}")]
    Malformed(String),
    /// The brick's Blosc container is sound, but uses something that is not supported.
    #[error("{0} is not supported")]
    Unsupported(String),
}

/// Why an export failed. A failed export leaves no new file under the output's name.
#[derive(Debug, thiserror::Error)]
pub enum ExportError {
    /// The output exists already, and may not be replaced.
    #[error("{path}: exists already; choose another name or pass `overwrite`", path = path.display())]
    Exists {
        /// The output's path.
        path: PathBuf,
    },
    /// The output would become a part of a store.
    #[error(transparent)]
    Inside(#[from] InsideStore),
    /// The output's extension names no format that is written.
    #[error("{path}: cannot export to this extension; supported: .raw, .npy", path = path.display())]
    Extension {
        /// The output's path.
        path: PathBuf,
    },
    /// The store has no such level, time step, channel or box.
    #[error("{what} {found} is outside the store: expected {expected}")]
    Outside {
        /// Which part of the request: the level, time step, channel or box.
        what: &'static str,
        /// What was asked for.
        found: String,
        /// What the store has.
        expected: String,
    },
    /// The export was told to stop, by what takes its progress.
    #[error("{path}: cancelled; nothing was written there", path = path.display())]
    Cancelled {
        /// The output's path.
        path: PathBuf,
    },
    /// The memory allowed is less than the least that one thread needs.
    #[error(
        "`memory` {given} MiB is too little: exporting from this store needs at least {needed} MiB",
        given = given_bytes >> 20, needed = needed_bytes.div_ceil(1 << 20)
    )]
    Memory {
        /// The least memory that exporting from this store needs, in bytes.
        needed_bytes: u64,
        /// The memory that was allowed, in bytes.
        given_bytes: u64,
    },
    /// The worker threads could not be started.
    #[error("cannot start worker threads: {0}")]
    Threads(String),
    /// A brick could not be read.
    #[error(transparent)]
    Read(#[from] ReadError),
    /// The operating system could not write the output.
    #[error("{path}: {error}", path = path.display())]
    Io {
        /// The output's path.
        path: PathBuf,
        /// The operating system's error.
        #[source]
        error: std::io::Error,
    },
}
