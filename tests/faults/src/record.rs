//! The record of calls: `CALL RESULT NUMBER LENGTH PATH [PATH]`, tab-separated, a newline, then `LENGTH` bytes, those that were
//! written. `NUMBER` is the offset of a write, the flags of an open, or the length of a truncation. Calls that failed, or did
//! nothing and said that they did, have a `RESULT` below zero. A write that did nothing is not recorded.
//!
//! While there is a record, calls on files below the folder are made one at a time (but for closing), so that the record has them in
//! their order.

use crate::kernel;
use crate::rules::{Call, Settings};
use std::sync::{Mutex, MutexGuard, OnceLock, PoisonError};

/// A call, as it is recorded.
pub(crate) struct Entry<'a> {
    pub(crate) call: Call,
    pub(crate) result: i64,
    pub(crate) number: i64,
    pub(crate) path: &'a str,
    pub(crate) bytes: &'a [u8],
}

static TURN: Mutex<()> = Mutex::new(());

/// Waits for other calls that are recorded, and keeps them out until the guard is dropped. `None` if nothing is
/// recorded.
pub(crate) fn turn(settings: &Settings) -> Option<MutexGuard<'static, ()>> {
    settings.log.as_ref().map(|_| TURN.lock().unwrap_or_else(PoisonError::into_inner))
}

/// Appends a call to the record, in one write, if there is a record.
pub(crate) fn add(settings: &Settings, entry: &Entry<'_>) {
    static FILE: OnceLock<i32> = OnceLock::new();
    let Some(log) = &settings.log else { return };
    let file = *FILE.get_or_init(|| kernel::open_to_append(log));
    let Entry { call, result, number, path, bytes } = entry;
    let head = format!("{}\t{result}\t{number}\t{}\t{path}\n", call.name(), bytes.len());
    kernel::write_all(file, &[head.as_bytes(), bytes].concat());
}
