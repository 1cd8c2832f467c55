//! Why an input cannot be read.

use std::path::PathBuf;

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
    #[error("{path}: {feature} is not supported", path = path.display())]
    Unsupported {
        /// The file.
        path: PathBuf,
        /// What it uses.
        feature: String,
    },
}
