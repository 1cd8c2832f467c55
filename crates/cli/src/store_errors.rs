//! Errors of stores and packing, sorted into exit codes.

use super::failure::{ExitKind, Failure};
use super::making;
use super::say::say;
use brickyard::export::ExportError;
use brickyard::extract::MeshError;
use brickyard::import::{ImportError, is_of_process, limit_behind};
use brickyard::session::VolumeSource;
use brickyard::store::{
    AppendError, EditError, ImageIndexError, IndexError, OpenError, PackError, ReadError, RemakeError, RepairError,
    Store, UpgradeError, VerifyError,
};
use std::fmt::Display;
use std::path::Path;
use std::sync::Arc;

/// Opens a finished store, or another program's image where it lies, with its reader's notes.
///
/// # Errors
/// Exit code 3 if it is not a store, 4 if it is unfinished; 2 if a flag or a part of the path is missing.
pub(crate) fn open(path: &Path) -> Result<Store, Failure> {
    let store = Store::open(path).map_err(|error| open_failure(&error))?;
    store.notes().iter().for_each(|note| say!("{}: {}", if note.is_warning() { "warning" } else { "note" }, &**note));
    Ok(store)
}

/// Opens finished stores, or other programs' images, as volumes; says how far levels are that they lack.
///
/// # Errors
/// The errors of [`open`].
pub(crate) fn open_volumes<P: AsRef<Path>>(paths: &[P]) -> Result<Vec<VolumeSource>, Failure> {
    let stores = paths.iter().map(|path| open(path.as_ref()).map(Arc::new)).collect::<Result<Vec<_>, _>>()?;
    making::tell(&stores);
    Ok(stores.iter().map(VolumeSource::of_store).collect())
}

pub(crate) fn open_failure(error: &OpenError) -> Failure {
    match error {
        OpenError::Incomplete { .. } => Failure::new(ExitKind::Incomplete, error),
        OpenError::Io { error: io, .. } => io_failure(io, error),
        OpenError::Source(error @ ImportError::Options { .. }) => {
            Failure::usage(format!("{error} (flags are `pack`'s; FOLDER::PATH names one of several for every command)"))
        }
        OpenError::Source(error) => import_failure(error),
        _ => Failure::bad_input(error),
    }
}

/// The failure of a file that the system does not open or read.
pub(crate) fn io_failure(error: &std::io::Error, message: impl Display) -> Failure {
    match limit_behind(error) {
        Some(limit) => Failure::failed(format!("{message}: {limit}; nothing is wrong with the file")),
        None if is_of_process(error) => Failure::failed(message),
        None => Failure::bad_input(message),
    }
}

pub(crate) fn verify_failure(error: VerifyError, store: &Path) -> Failure {
    match error {
        // Contradictions and missing files inside a store are what verification looks for.
        VerifyError::Open(error @ OpenError::Invalid { .. }) => Failure::new(ExitKind::VerificationFailed, error),
        VerifyError::Open(OpenError::Io { path, error })
            if !is_of_process(&error) && path != store && path.starts_with(store) =>
        {
            Failure::new(ExitKind::VerificationFailed, OpenError::Io { path, error })
        }
        VerifyError::Open(error) => open_failure(&error),
        VerifyError::Barred(error) => read_failure(&error),
        VerifyError::Source(error) => import_failure(&error),
        // Such bricks are what verification looks for.
        VerifyError::Read(error @ ReadError::Io { .. }) => read_failure(&error),
        VerifyError::Read(error) => Failure::new(ExitKind::VerificationFailed, error),
        VerifyError::Memory { .. } => Failure::usage(error),
        VerifyError::Threads(_) => Failure::failed(error),
    }
}

pub(crate) fn read_failure(error: &ReadError) -> Failure {
    match error {
        ReadError::Io { error: io, .. } => io_failure(io, error),
        ReadError::Source { error, .. } => import_failure(error),
        _ => Failure::bad_input(error),
    }
}

pub(crate) fn import_failure(error: &ImportError) -> Failure {
    match error {
        ImportError::Options { .. } => Failure::usage(error),
        ImportError::Limit { .. } | ImportError::Scratch { .. } => Failure::failed(error),
        ImportError::Io { error: io, .. } => io_failure(io, error),
        _ => Failure::bad_input(error),
    }
}

pub(crate) fn pack_failure(error: PackError) -> Failure {
    Failure::new(pack_kind(&error), error)
}

fn pack_kind(error: &PackError) -> ExitKind {
    match error {
        PackError::Incomplete { .. } | PackError::Cancelled { .. } => ExitKind::Incomplete,
        PackError::Source { error, .. } => import_failure(error).kind,
        PackError::Unfit { .. } => ExitKind::BadInput,
        PackError::Options(_)
        | PackError::Memory { .. }
        | PackError::Exists { .. }
        | PackError::Inside(_)
        | PackError::Labels { .. }
        | PackError::NotOurs { .. }
        | PackError::Foreign { .. }
        | PackError::InTheWay { .. }
        | PackError::Mismatch { .. } => ExitKind::Usage,
        PackError::Busy { .. }
        | PackError::ReadOnly { .. }
        | PackError::NoLock { .. }
        | PackError::NoRoom { .. }
        | PackError::ReadBack { .. }
        | PackError::Panic { .. }
        | PackError::Io { .. }
        | PackError::Threads(_) => ExitKind::Failed,
    }
}

pub(crate) fn append_failure(error: AppendError) -> Failure {
    let kind = match &error {
        AppendError::Open(error) => return open_failure(error),
        AppendError::Read(error) => return read_failure(error),
        AppendError::Pack(error) => pack_kind(error),
        AppendError::Time { .. } | AppendError::Begun { .. } => ExitKind::Usage,
        AppendError::Source { error, .. } => import_failure(error).kind,
        AppendError::Mismatch { .. }
        | AppendError::Several { .. }
        | AppendError::NoTime { .. }
        | AppendError::Grouped { .. } => ExitKind::BadInput,
        AppendError::Unfinished { .. } | AppendError::Cancelled { .. } | AppendError::Incomplete { .. } => {
            ExitKind::Incomplete
        }
        AppendError::Panic { .. } | AppendError::Appended { .. } => ExitKind::Failed,
    };
    Failure::new(kind, error)
}

pub(crate) fn edit_failure(error: EditError) -> Failure {
    let kind = match &error {
        EditError::Open(error) => return open_failure(error),
        EditError::Unfit(error) => return import_failure(error),
        // Its values come from the command line.
        EditError::Pack(PackError::Unfit { .. }) | EditError::Nothing { .. } => ExitKind::Usage,
        EditError::Pack(error) => pack_kind(error),
        EditError::Unfinished { .. } => ExitKind::Incomplete,
        EditError::Altered { .. } => ExitKind::VerificationFailed,
        EditError::Levels(error) => return remake_failure(error),
        EditError::Unchanged { .. } | EditError::Unsynced { .. } | EditError::Unlisted { .. } => ExitKind::Failed,
    };
    Failure::new(kind, error)
}

fn remake_failure(error: &RemakeError) -> Failure {
    let kind = match error {
        RemakeError::Open(error) => return open_failure(error),
        RemakeError::Pack(error) => pack_kind(error),
        RemakeError::Unfinished { .. } => ExitKind::Incomplete,
        RemakeError::Altered { .. } | RemakeError::Levels { .. } => ExitKind::VerificationFailed,
        RemakeError::Fraction { .. } => ExitKind::BadInput,
        // Only Ctrl-C cancels.
        RemakeError::Cancelled { .. } => ExitKind::Interrupted,
        RemakeError::Written { .. } | RemakeError::Unchanged { .. } | RemakeError::Unsynced { .. } => ExitKind::Failed,
    };
    Failure::new(kind, error)
}

pub(crate) fn index_failure(error: IndexError) -> Failure {
    let error = match error {
        IndexError::Store(error) => return remake_failure(&error),
        IndexError::Image(error) => error,
    };
    let kind = match &error {
        ImageIndexError::Open(error) => return open_failure(error),
        ImageIndexError::Read(error) => return read_failure(error),
        ImageIndexError::TooLarge { .. } | ImageIndexError::NotKept { .. } => ExitKind::Failed,
        // Only Ctrl-C cancels.
        ImageIndexError::Cancelled { .. } => ExitKind::Interrupted,
    };
    Failure::new(kind, error)
}

pub(crate) fn upgrade_failure(error: UpgradeError) -> Failure {
    let kind = match &error {
        UpgradeError::Open(error) => return open_failure(error),
        UpgradeError::Pack(error) => pack_kind(error),
        UpgradeError::Label { .. } => ExitKind::BadInput,
        UpgradeError::Unfinished { .. } | UpgradeError::Partly { .. } => ExitKind::Incomplete,
        UpgradeError::Altered { .. } => ExitKind::VerificationFailed,
        UpgradeError::Unchanged { .. } | UpgradeError::Unsynced { .. } => ExitKind::Failed,
    };
    Failure::new(kind, error)
}

pub(crate) fn repair_failure(error: RepairError, store: &Path) -> Failure {
    let error = match error {
        RepairError::Open(error) => return verify_failure(VerifyError::Open(error), store),
        error => error,
    };
    let kind = match &error {
        RepairError::Open(error) => return open_failure(error),
        RepairError::Source(source) => import_failure(source).kind,
        RepairError::Barred(error) => return read_failure(error),
        RepairError::Pack(error) => pack_kind(error),
        RepairError::Unlike { .. } => ExitKind::BadInput,
        RepairError::Unvouched { .. } => ExitKind::VerificationFailed,
        RepairError::Memory { .. } => ExitKind::Usage,
        RepairError::Unfinished { .. } | RepairError::Incomplete { .. } => ExitKind::Incomplete,
        RepairError::Threads(_) => ExitKind::Failed,
        // Only Ctrl-C cancels.
        RepairError::Cancelled { .. } => ExitKind::Interrupted,
    };
    Failure::new(kind, error)
}

pub(crate) fn export_failure(error: ExportError) -> Failure {
    let kind = match &error {
        ExportError::Pack(error) => pack_kind(error),
        ExportError::Read(_) | ExportError::Source(_) => ExitKind::BadInput,
        ExportError::Io { .. } | ExportError::Threads(_) => ExitKind::Failed,
        // Only Ctrl-C cancels.
        ExportError::Cancelled { .. } => ExitKind::Interrupted,
        _ => ExitKind::Usage,
    };
    Failure::new(kind, error)
}

pub(crate) fn mesh_failure(error: MeshError) -> Failure {
    let kind = match &error {
        MeshError::Read(error) => return read_failure(error),
        MeshError::Contradiction => ExitKind::BadInput,
        MeshError::Io { .. } | MeshError::Threads(_) => ExitKind::Failed,
        // Only Ctrl-C cancels.
        MeshError::Cancelled { .. } => ExitKind::Interrupted,
        _ => ExitKind::Usage,
    };
    Failure::new(kind, error)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Error;

    #[test]
    fn every_error_of_a_pack_has_its_exit_code() {
        let path = || std::path::PathBuf::from("a.zarr");
        let io = || Error::other("told to");
        for (error, kind) in [
            (PackError::Options("bad".into()), ExitKind::Usage),
            (PackError::Memory { needed_bytes: 2, given_bytes: 1, advice: String::new() }, ExitKind::Usage),
            (PackError::Exists { path: path(), unfinished: false }, ExitKind::Usage),
            (PackError::NotOurs { path: path() }, ExitKind::Usage),
            (PackError::Mismatch { store: path(), difference: "brick".into() }, ExitKind::Usage),
            // The command line may stay as it is.
            (PackError::Busy { store: path(), holder: None }, ExitKind::Failed),
            (PackError::Io { path: path(), error: io() }, ExitKind::Failed),
            (PackError::Threads("none".into()), ExitKind::Failed),
            (
                PackError::Incomplete { path: path(), error: io(), store: path(), done: 1, total: 2, needed_bytes: 3 },
                ExitKind::Incomplete,
            ),
        ] {
            let message = error.to_string();
            assert_eq!(pack_failure(error).kind, kind, "{message}");
        }
    }

    /// Permissions and limits belong to the process, wherever they are met: the input may be sound.
    #[test]
    fn what_the_process_may_not_do_is_no_fault_of_a_file() {
        let path = || std::path::PathBuf::from("a.raw");
        let errors = || [13, 24, 12].map(Error::from_raw_os_error);
        let input = |error| ImportError::Io { path: path(), error };
        for error in errors() {
            assert_eq!(import_failure(&input(error)).kind, ExitKind::Failed);
        }
        for error in errors() {
            let error = PackError::Source { error: input(error), store: path(), done: 1, total: 2 };
            assert_eq!(pack_failure(error).kind, ExitKind::Failed);
        }
        for error in errors() {
            let error = AppendError::Source { error: input(error), store: path(), times: 1 };
            assert_eq!(append_failure(error).kind, ExitKind::Failed);
        }
        let scratch = || ImportError::Scratch { directory: path(), error: Error::other("full") };
        assert_eq!(import_failure(&scratch()).kind, ExitKind::Failed);
        let appended = AppendError::Source { error: scratch(), store: path(), times: 1 };
        assert_eq!(append_failure(appended).kind, ExitKind::Failed);
        let failure = io_failure(&Error::from_raw_os_error(24), "a.zarr/0");
        assert!(failure.kind == ExitKind::Failed && failure.message.contains("`ulimit -n`"), "{}", failure.message);
        assert_eq!(io_failure(&Error::other("told to"), "a.zarr/0").kind, ExitKind::BadInput);
        let begun = AppendError::Begun { store: path(), difference: "brick".into() };
        assert_eq!(append_failure(begun).kind, ExitKind::Usage);
    }

    #[test]
    fn what_verify_cannot_open_is_told_apart() {
        let path = || std::path::PathBuf::from("a.zarr/zarr.json");
        let kind = |error| verify_failure(VerifyError::Open(error), Path::new("a.zarr")).kind;
        let invalid = OpenError::Invalid { path: path(), field: "a".into(), expected: "b".into(), found: "c".into() };
        assert_eq!(kind(invalid), ExitKind::VerificationFailed);
        assert_eq!(kind(OpenError::NotAStore { path: path() }), ExitKind::BadInput);
        let io = |code| kind(OpenError::Io { path: path(), error: Error::from_raw_os_error(code) });
        // No directory, and no permission.
        assert_eq!([20, 13].map(io), [ExitKind::VerificationFailed, ExitKind::Failed]);
        assert_eq!(kind(OpenError::Incomplete { path: path(), percent: 4 }), ExitKind::Incomplete);
        let (feature, advice) = ("something new".into(), "wait");
        assert_eq!(kind(OpenError::Unsupported { path: path(), feature, advice }), ExitKind::BadInput);
        assert_eq!(
            verify_failure(VerifyError::Memory { needed_bytes: 2, given_bytes: 1 }, Path::new("a.zarr")).kind,
            ExitKind::Usage
        );
    }
}
