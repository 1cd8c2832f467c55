//! Counts of requests and bytes, of all addresses of a process.

use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

/// Requests made and bytes read from all addresses in this process.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Traffic {
    /// Requests, repeated ones too.
    pub requests: u64,
    /// Bytes of answers.
    pub bytes: u64,
    /// Failed requests, made again or given up.
    pub failures: u64,
    /// Requests ended before their answer was whole, for nobody waited for it any more.
    pub cancelled: u64,
    /// Objects taken from disk while their server could not be reached.
    pub unconfirmed: u64,
    /// Time of a request, from its turn to its last byte: the newest eight weigh most.
    pub request_time: Duration,
}

pub(crate) static REQUESTS: AtomicU64 = AtomicU64::new(0);
pub(crate) static BYTES: AtomicU64 = AtomicU64::new(0);
pub(crate) static FAILURES: AtomicU64 = AtomicU64::new(0);
pub(crate) static CANCELLED: AtomicU64 = AtomicU64::new(0);
pub(crate) static UNCONFIRMED: AtomicU64 = AtomicU64::new(0);
static REQUEST_MICROS: AtomicU64 = AtomicU64::new(0);

/// Takes the time of an answered request into account.
#[cfg(feature = "remote")]
pub(crate) fn note_time(took: Duration) {
    let new = took.as_micros() as u64;
    let mix = |old: u64| Some(if old == 0 { new } else { (old * 7 + new) / 8 });
    // The closure always gives a value.
    let _ = REQUEST_MICROS.fetch_update(Ordering::Relaxed, Ordering::Relaxed, mix);
}

/// Requests and bytes so far.
pub fn traffic() -> Traffic {
    let now = |number: &AtomicU64| number.load(Ordering::Relaxed);
    Traffic {
        requests: now(&REQUESTS),
        bytes: now(&BYTES),
        failures: now(&FAILURES),
        cancelled: now(&CANCELLED),
        unconfirmed: now(&UNCONFIRMED),
        request_time: Duration::from_micros(now(&REQUEST_MICROS)),
    }
}
