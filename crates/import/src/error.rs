//! Why an input cannot be read.

use std::path::{Path, PathBuf};

/// Why an input cannot be read. Every message names the file and says what was expected, what was found and what to do.
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
    /// The file is damaged, cut short or not what it says.
    #[error("{path}: {problem}", path = path.display())]
    Invalid {
        /// Path of the file or folder.
        path: PathBuf,
        /// What was expected, what was found, and what to do.
        problem: String,
    },
    /// The file is valid but uses a feature that is not supported.
    #[error("{path}: {feature} is not supported{advice}", path = path.display())]
    Unsupported {
        /// Path of the file or folder.
        path: PathBuf,
        /// The feature that is not supported.
        feature: String,
        /// What to do instead, starting with a semicolon; empty if nothing helps.
        advice: String,
    },
    /// The file does not say what is needed, or options contradict it or each other: the caller must choose.
    #[error("{path}: {problem}", path = path.display())]
    Options {
        /// Path of the file or folder.
        path: PathBuf,
        /// What is missing or contradictory, and which option settles it.
        problem: String,
    },
}

impl ImportError {
    /// Wraps an I/O error with its file, for `map_err`.
    pub(crate) fn io(path: &Path) -> impl FnOnce(std::io::Error) -> Self + '_ {
        move |error| Self::Io { path: path.to_owned(), error }
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
