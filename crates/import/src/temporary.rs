//! Temporary files. Their random names mean nothing to users, so errors leave them out.

use std::ffi::OsStr;
use std::fs::File;
use std::io;
use std::path::Path;
use tempfile::{Builder, NamedTempFile};

/// Letters and digits of a name's random part.
pub(crate) const RANDOM_BYTES: usize = 6;

/// Creates a file in `folder`, removed unless it is given a name; its permissions are those of any new file.
///
/// # Errors
/// If the system refuses the file.
pub fn named_in(folder: &Path, prefix: impl AsRef<OsStr>, suffix: &str) -> io::Result<NamedTempFile> {
    let mut builder = Builder::new();
    builder.prefix(&prefix).suffix(suffix).rand_bytes(RANDOM_BYTES);
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        builder.permissions(std::fs::Permissions::from_mode(0o666));
    }
    builder.tempfile_in(folder).map_err(without_path)
}

/// Creates a file without a name in `folder`.
///
/// # Errors
/// If the system refuses the file.
pub fn unnamed_in(folder: &Path) -> io::Result<File> {
    tempfile::tempfile_in(folder).map_err(without_path)
}

/// Returns the system's own error, without the file's name: `tempfile` keeps only its words.
pub(crate) fn without_path(error: io::Error) -> io::Error {
    let told = error.get_ref().map(ToString::to_string).unwrap_or_default();
    let code = told.split_once("(os error ").and_then(|(_, rest)| rest.split_once(')')?.0.parse().ok());
    code.map_or(error, io::Error::from_raw_os_error)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::ImportError;

    #[test]
    fn temporary_files_are_not_named() {
        let missing = Path::new("no such folder");
        let error = Builder::new().prefix("scratch-").tempfile_in(missing).unwrap_err();
        assert!(error.to_string().contains("scratch-"), "{error}");
        for error in
            [named_in(missing, "scratch-", "").unwrap_err(), unnamed_in(missing).unwrap_err(), without_path(error)]
        {
            assert_eq!(error.raw_os_error(), Some(rustix::io::Errno::NOENT.raw_os_error()));
            let message = ImportError::scratch(missing)(error).to_string();
            assert!(message.contains("no such folder") && !message.contains("scratch-"), "{message}");
        }
    }
}
