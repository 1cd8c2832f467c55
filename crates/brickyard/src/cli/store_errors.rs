//! Errors of stores and packing, sorted into exit codes.

use super::failure::{ExitKind, Failure};
use brickyard::import::ImportError;
use brickyard::store::{ExportError, OpenError, PackError, ReadError, Store};
use std::path::Path;

/// Opens a finished store.
///
/// # Errors
/// Exit code 3 for what is not a store, 4 for an unfinished one.
pub(crate) fn open(path: &Path) -> Result<Store, Failure> {
    Store::open(path).map_err(|error| open_failure(&error))
}

/// The failure for a store that cannot be opened.
pub(crate) fn open_failure(error: &OpenError) -> Failure {
    let kind = if matches!(error, OpenError::Incomplete { .. }) { ExitKind::Incomplete } else { ExitKind::BadInput };
    Failure::new(kind, error)
}

/// The failure for a brick that cannot be read.
pub(crate) fn read_failure(error: &ReadError) -> Failure {
    Failure::bad_input(error)
}

/// The failure for an input that cannot be read.
pub(crate) fn import_failure(error: &ImportError) -> Failure {
    match error {
        ImportError::Options { .. } => Failure::usage(error),
        _ => Failure::bad_input(error),
    }
}

/// The failure for a pack that did not finish.
pub(crate) fn pack_failure(error: PackError) -> Failure {
    let kind = match &error {
        PackError::Incomplete { .. } => ExitKind::Incomplete,
        PackError::Source { .. } | PackError::Unfit { .. } => ExitKind::BadInput,
        PackError::Options(_)
        | PackError::Memory { .. }
        | PackError::Exists { .. }
        | PackError::NotOurs { .. }
        | PackError::Foreign { .. }
        | PackError::InTheWay { .. }
        | PackError::Mismatch { .. } => ExitKind::Usage,
        PackError::Busy { .. }
        | PackError::NoLock { .. }
        | PackError::ReadBack { .. }
        | PackError::Panic { .. }
        | PackError::Io { .. }
        | PackError::Threads(_) => ExitKind::Failed,
    };
    Failure::new(kind, error)
}

/// The failure for an export.
pub(crate) fn export_failure(error: ExportError) -> Failure {
    let kind = match &error {
        ExportError::Read(_) => ExitKind::BadInput,
        ExportError::Io { .. } => ExitKind::Failed,
        _ => ExitKind::Usage,
    };
    Failure::new(kind, error)
}
