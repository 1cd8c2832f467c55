//! Reasons for which an object cannot be read, told apart by their remedies.

use std::io::{Error, ErrorKind};

/// Why an object at an address cannot be read.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum Fault {
    /// There is no such object.
    #[error("no such object")]
    Absent,
    /// The server refuses access.
    #[error("access is refused ({status}); give credentials in the environment, or check the address")]
    Forbidden {
        /// The server's status, or its words.
        status: String,
    },
    /// The server fails by itself.
    #[error("the server fails ({status}); try again later")]
    Broken {
        /// Its last status, or its words.
        status: String,
    },
    /// The answer is of other bytes than asked for.
    #[error("the server's answer is wrong: {problem}")]
    Lying {
        /// How they differ.
        problem: String,
    },
    /// No server answers at the address.
    #[error("the server cannot be reached ({problem}); check the address and the network")]
    Unreachable {
        /// The connection's words.
        problem: String,
    },
    /// The server or the link is too slow.
    #[error("no answer within {seconds} s; check the network, or try again later")]
    Slow {
        /// Seconds waited.
        seconds: u64,
    },
    /// Nobody waits for the object any more.
    #[error("no longer wanted")]
    Cancelled,
    /// The object changed after it was first read.
    #[error("changed while it was read; open it again")]
    Changed,
    /// The object is larger than expected.
    #[error("larger than its limit of {most_bytes} bytes")]
    Large {
        /// The limit.
        most_bytes: u64,
    },
    /// The address, or a request for it, is not supported.
    #[error("{0}")]
    Unsupported(String),
}

impl Fault {
    /// The fault behind an error of reading an object, if it is one.
    pub fn of(error: &Error) -> Option<&Self> {
        error.get_ref()?.downcast_ref()
    }

    /// Whether the same request may succeed at once or a little later.
    pub fn is_passing(&self) -> bool {
        matches!(self, Self::Broken { .. } | Self::Lying { .. } | Self::Unreachable { .. } | Self::Slow { .. })
    }

    /// Whether the server, the link or the rights are at fault, rather than the address or the object.
    pub fn is_of_server(&self) -> bool {
        self.is_passing() || matches!(self, Self::Forbidden { .. } | Self::Changed)
    }

    fn kind(&self) -> ErrorKind {
        match self {
            Self::Absent => ErrorKind::NotFound,
            Self::Forbidden { .. } => ErrorKind::PermissionDenied,
            Self::Broken { .. } => ErrorKind::ConnectionAborted,
            Self::Lying { .. } => ErrorKind::InvalidData,
            Self::Unreachable { .. } => ErrorKind::NotConnected,
            Self::Slow { .. } => ErrorKind::TimedOut,
            // Not `Interrupted`, after which callers try again.
            Self::Cancelled => ErrorKind::Other,
            Self::Changed => ErrorKind::StaleNetworkFileHandle,
            Self::Large { .. } => ErrorKind::FileTooLarge,
            Self::Unsupported(_) => ErrorKind::Unsupported,
        }
    }
}

impl From<Fault> for Error {
    fn from(fault: Fault) -> Self {
        Self::new(fault.kind(), fault)
    }
}
