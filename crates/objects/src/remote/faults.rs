//! Faults behind the errors of `object_store`.

use super::limits::ANSWER_WAIT;
use crate::fault::Fault;
use object_store::client::{HttpError, HttpErrorKind};
use std::error::Error;

/// The reason behind an error.
pub(super) fn fault_of(error: &object_store::Error) -> Fault {
    match error {
        object_store::Error::NotFound { .. } => return Fault::Absent,
        object_store::Error::Precondition { .. } => return Fault::Changed,
        object_store::Error::PermissionDenied { .. } => return Fault::Forbidden { status: "403".into() },
        object_store::Error::Unauthenticated { .. } => return Fault::Forbidden { status: "401".into() },
        object_store::Error::InvalidPath { source } => return Fault::Unsupported(source.to_string()),
        _ => {}
    }
    let mut cause: &(dyn Error + 'static) = error;
    let mut kind = None;
    while let Some(deeper) = cause.source() {
        cause = deeper;
        kind = kind.or_else(|| cause.downcast_ref().map(HttpError::kind));
    }
    let problem = cause.to_string();
    match kind {
        Some(HttpErrorKind::Connect) => return Fault::Unreachable { problem },
        Some(HttpErrorKind::Timeout) => return Fault::Slow { seconds: ANSWER_WAIT.as_secs() },
        Some(HttpErrorKind::Request | HttpErrorKind::Interrupted | HttpErrorKind::Decode) => {
            return Fault::Lying { problem: format!("the connection ended early: {problem}") };
        }
        _ => {}
    }
    let text = error.to_string();
    let status = text.split_once("status code: ").and_then(|(_, rest)| rest.split(['\n', ':']).next());
    let status = status.map(|status| status.trim().to_owned());
    match &status {
        Some(code) if code.starts_with('5') || code.starts_with("429") || code.starts_with("408") => {
            Fault::Broken { status: code.clone() }
        }
        Some(code) if code.starts_with("416") => Fault::Changed,
        Some(code) => Fault::Unsupported(format!("the server answers {code}")),
        None if text.contains("non-partial") || text.contains("Range request not supported") => {
            Fault::Unsupported("the server gives whole files alone, no ranges of bytes; use another server".into())
        }
        None if text.contains("Requested") || text.contains("Content-Range") => Fault::Lying { problem },
        None if text.to_lowercase().contains("credential") => Fault::Forbidden { status: problem },
        None => Fault::Lying { problem },
    }
}
