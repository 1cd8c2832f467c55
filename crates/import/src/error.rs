//! Errors of reading an input.

use brickyard_objects::Fault;
use std::path::{Path, PathBuf};

/// Failure to read an input. Every message names the file, the expectation, the finding and a remedy.
#[derive(Debug, thiserror::Error)]
pub enum ImportError {
    /// The operating system could not open, read or write a file.
    #[error("{path}: {error}", path = path.display())]
    Io {
        /// Path of the file or folder.
        path: PathBuf,
        /// The operating system's error.
        #[source]
        error: std::io::Error,
    },
    /// The process, or the system, is out of a resource needed to open a file. The file itself may be sound.
    #[error("{path}: {error}: {limit}; nothing is wrong with the file", path = path.display())]
    Limit {
        /// Path of the file.
        path: PathBuf,
        /// The operating system's error.
        #[source]
        error: std::io::Error,
        /// The exhausted limit, and how to raise it.
        limit: &'static str,
    },
    /// Scratch space cannot be written.
    #[error("{directory}: no scratch file can be written there: {error}; choose another folder with `scratch_dir`", directory = directory.display())]
    Scratch {
        /// Folder of scratch files.
        directory: PathBuf,
        /// The operating system's error.
        #[source]
        error: std::io::Error,
    },
    /// The file is damaged, cut short or mislabelled.
    #[error("{path}: {problem}", path = path.display())]
    Invalid {
        /// Path of the file or folder.
        path: PathBuf,
        /// The expectation, the finding and a remedy.
        problem: String,
    },
    /// The file is valid but uses an unsupported feature.
    #[error("{path}: {feature} is not supported{advice}", path = path.display())]
    Unsupported {
        /// Path of the file or folder.
        path: PathBuf,
        /// The unsupported feature.
        feature: String,
        /// The alternative, starting with a semicolon; empty if there is none.
        advice: String,
    },
    /// The file lacks necessary information, or options contradict it or each other: the caller must choose.
    #[error("{path}: {problem}", path = path.display())]
    Options {
        /// Path of the file or folder.
        path: PathBuf,
        /// The missing or contradictory information, and the option to settle it.
        problem: String,
    },
    /// A source of another crate, such as a store, cannot be read.
    #[error(transparent)]
    Other(Box<dyn std::error::Error + Send + Sync>),
}

/// Result of reading an input.
pub(crate) type Result<T, E = ImportError> = std::result::Result<T, E>;

impl ImportError {
    /// Wraps an I/O error with its file, for `map_err`.
    pub(crate) fn io(path: &Path) -> impl FnOnce(std::io::Error) -> Self + '_ {
        move |error| match limit_behind(&error) {
            Some(limit) => Self::Limit { path: path.to_owned(), error, limit },
            None => Self::Io { path: path.to_owned(), error },
        }
    }

    /// Wraps an I/O error with the folder of scratch files, for `map_err`.
    pub(crate) fn scratch(directory: &Path) -> impl FnOnce(std::io::Error) -> Self + '_ {
        move |error| match limit_behind(&error) {
            Some(limit) => Self::Limit { path: directory.to_owned(), error, limit },
            None => Self::Scratch { directory: directory.to_owned(), error },
        }
    }

    pub(crate) fn invalid(path: &Path, problem: impl Into<String>) -> Self {
        Self::Invalid { path: path.to_owned(), problem: problem.into() }
    }

    pub(crate) fn unsupported(path: &Path, feature: impl Into<String>) -> Self {
        Self::Unsupported { path: path.to_owned(), feature: feature.into(), advice: String::new() }
    }

    pub(crate) fn unsupported_but(path: &Path, feature: impl Into<String>, advice: &str) -> Self {
        Self::Unsupported { path: path.to_owned(), feature: feature.into(), advice: format!("; {advice}") }
    }

    pub(crate) fn options(path: &Path, problem: impl Into<String>) -> Self {
        Self::Options { path: path.to_owned(), problem: problem.into() }
    }
}

/// Whether an error is about the process's permissions, limits or network rather than the file.
pub fn is_of_process(error: &std::io::Error) -> bool {
    error.kind() == std::io::ErrorKind::PermissionDenied
        || limit_behind(error).is_some()
        || Fault::of(error).is_some_and(Fault::is_of_server)
}

/// Returns the limit of the process or system behind an error, with the way to raise it; `None` for other errors.
pub fn limit_behind(error: &std::io::Error) -> Option<&'static str> {
    use rustix::io::Errno;
    match Errno::from_io_error(error)? {
        Errno::MFILE => Some("the process has reached its limit of open files, raise it with `ulimit -n`"),
        Errno::NFILE => Some("the system has reached its limit of open files, its setting fs.file-max"),
        Errno::NOMEM => Some(
            "the process has reached its limit of memory (`ulimit -v`) or of mapped files (the system's setting \
             vm.max_map_count)",
        ),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn limits_of_the_process_are_not_the_file_s_fault() {
        let message = |code| ImportError::io(Path::new("a.tif"))(std::io::Error::from_raw_os_error(code)).to_string();
        for (errno, word) in [
            (rustix::io::Errno::MFILE, "`ulimit -n`"),
            (rustix::io::Errno::NFILE, "fs.file-max"),
            (rustix::io::Errno::NOMEM, "vm.max_map_count"),
        ] {
            let message = message(errno.raw_os_error());
            assert!(message.starts_with("a.tif: ") && message.contains(word), "{message}");
            assert!(message.contains("nothing is wrong with the file"), "{message}");
        }
        assert!(!message(rustix::io::Errno::NOENT.raw_os_error()).contains("nothing is wrong"));
    }
}
