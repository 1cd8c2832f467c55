//! Why an input cannot be read.

use std::path::{Path, PathBuf};

/// Why an input cannot be read. Every message says which file, what was expected, what was found and what to do.
#[derive(Debug, thiserror::Error)]
pub enum ImportError {
    /// The operating system refused.
    #[error("{path}: {error}", path = path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What it said.
        #[source]
        error: std::io::Error,
    },
    /// The file is damaged, cut short or not what it says.
    #[error("{path}: {problem}", path = path.display())]
    Invalid {
        /// The file.
        path: PathBuf,
        /// Expected, found, and what to do.
        problem: String,
    },
    /// A sound file with something this reader does not do.
    #[error("{path}: {feature} is not supported{advice}", path = path.display())]
    Unsupported {
        /// The file.
        path: PathBuf,
        /// What it uses.
        feature: String,
        /// What to do, after a semicolon; empty where nothing helps.
        advice: String,
    },
    /// The file does not say what is needed, or options contradict it or each other: the caller must choose.
    #[error("{path}: {problem}", path = path.display())]
    Options {
        /// The file.
        path: PathBuf,
        /// What is missing or contradictory, and the flag that settles it.
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
