//! The record of calls: `CALL RESULT NUMBER LENGTH PATH [PATH]`, tab-separated, a newline, then the `LENGTH` written bytes. `NUMBER`
//! is the offset of a write, the flags of an open, or the length of a truncation. Calls that failed, or falsely reported success,
//! have a `RESULT` below zero. Writes without effect are not recorded.
//!
//! While there is a record, calls on files below the folder (except for closing) are made one at a time, so that they are recorded
//! in order.

use crate::kernel;
use crate::rules::{Call, Settings};
use std::sync::{Mutex, MutexGuard, OnceLock, PoisonError};

/// A call, as recorded.
pub(crate) struct Entry<'a> {
    pub(crate) call: Call,
    pub(crate) result: i64,
    pub(crate) number: i64,
    pub(crate) path: &'a str,
    pub(crate) bytes: &'a [u8],
}

static TURN: Mutex<()> = Mutex::new(());

/// Waits for other recorded calls, and keeps them out until the guard is dropped. `None` without a record.
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
