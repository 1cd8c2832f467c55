//! A test's view of a [`Disk`]: it records changes, makes them fail, and lets other packs act in between.

use crate::pack::disk::Disk;
use std::fs::File;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicI64, Ordering};

pub(crate) type Meanwhile = Box<dyn FnOnce() + Send>;

#[derive(Default)]
pub(crate) struct Trial {
    /// Whether to sync files one by one.
    pub(crate) syncs_each: bool,
    /// Number of changes before all further ones fail, as on a full disk or after a crash.
    pub(crate) fuse: Option<AtomicI64>,
    /// Whether an exhausted fuse panics instead of failing.
    pub(crate) panics: bool,
    /// The changes made, in order, each with its path.
    pub(crate) log: Mutex<Vec<(&'static str, PathBuf)>>,
    /// Actions of other packs, each with its moment.
    pub(crate) waiting: Mutex<Vec<(&'static str, Meanwhile)>>,
    /// Whether names cannot be exchanged, as on NFS.
    pub(crate) cannot_exchange: bool,
}

impl Trial {
    pub(crate) fn disk(self) -> Disk {
        Disk { trial: self, ..Disk::default() }
    }

    /// A disk with room for `changes` changes.
    pub(crate) fn disk_of(changes: i64) -> Disk {
        Self { fuse: Some(AtomicI64::new(changes)), ..Self::default() }.disk()
    }

    pub(crate) fn meanwhile(&self, moment: &'static str) {
        let mut waiting = self.waiting.lock().unwrap();
        let now = waiting.iter().position(|(at, _)| *at == moment).map(|i| waiting.remove(i));
        drop(waiting);
        now.into_iter().for_each(|(_, others)| others());
    }

    pub(crate) fn step(&self, what: &'static str, path: &Path) -> io::Result<()> {
        if let Some(fuse) = &self.fuse
            && fuse.fetch_sub(1, Ordering::SeqCst) <= 0
        {
            assert!(!self.panics, "a thread that changes files");
            return Err(io::ErrorKind::StorageFull.into());
        }
        self.log.lock().unwrap().push((what, path.into()));
        Ok(())
    }

    /// The write that hits the end of the disk is torn.
    pub(crate) fn tear(&self, file: &mut File, bytes: &[u8]) {
        if self.fuse.as_ref().is_some_and(|fuse| fuse.load(Ordering::SeqCst) == 0) {
            let _ = file.write_all(&bytes[..bytes.len() / 2]);
        }
    }
}
