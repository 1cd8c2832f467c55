//! Limits of connections.

use std::time::Duration;

/// Requests of a host under way at a time.
pub(super) const MOST_AT_ONCE: usize = 32;

/// Longest wait for a connection.
pub(super) const CONNECT_WAIT: Duration = Duration::from_secs(10);

/// Longest wait for an answer, and for its next bytes.
pub(super) const ANSWER_WAIT: Duration = Duration::from_secs(20);
