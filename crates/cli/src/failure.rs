//! Failures of the command: a message and an exit code.

use super::advice::with_flags;

/// The documented exit codes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub(crate) enum ExitKind {
    /// The work could not be done.
    Failed = 1,
    /// The command line must change: it is not understood, refers to something missing or unfit, or names an existing
    /// output.
    Usage = 2,
    /// The input is invalid.
    BadInput = 3,
    /// The output is incomplete; running again with `--resume` continues.
    Incomplete = 4,
    /// A store does not match its checksums or statistics.
    VerificationFailed = 5,
    /// The user stopped the work by Ctrl-C: in shells, 128 and the signal's number.
    Interrupted = 130,
}

/// A message for the user, with its exit code.
#[derive(Debug)]
pub(crate) struct Failure {
    /// The process's exit code.
    pub kind: ExitKind,
    /// What, where, why, and the remedy.
    pub message: String,
}

impl Failure {
    pub(crate) fn new(kind: ExitKind, message: impl std::fmt::Display) -> Self {
        Self { kind, message: with_flags(&message.to_string()) }
    }

    /// The work could not be done.
    pub(crate) fn failed(message: impl std::fmt::Display) -> Self {
        Self::new(ExitKind::Failed, message)
    }

    /// The flags contradict each other or the data.
    pub(crate) fn usage(message: impl std::fmt::Display) -> Self {
        Self::new(ExitKind::Usage, message)
    }

    /// The input is invalid.
    pub(crate) fn bad_input(message: impl std::fmt::Display) -> Self {
        Self::new(ExitKind::BadInput, message)
    }
}
