//! A cancelled pack stops soon, and can be resumed.

use super::*;
use std::sync::atomic::AtomicBool;

/// Cancels a pack after a number of voxels, or bytes of aprons.
struct Canceller {
    voxels: u64,
    apron_bytes: u64,
    is_cancelled: AtomicBool,
}

impl Canceller {
    fn after(voxels: u64, apron_bytes: u64) -> Self {
        Self { voxels, apron_bytes, is_cancelled: AtomicBool::new(voxels == 0) }
    }
}

impl Progress for Canceller {
    fn advanced(&self, done: u64, _: u64) {
        self.is_cancelled.fetch_or(done >= self.voxels, Ordering::Relaxed);
    }

    fn aprons(&self, done: u64, _: u64) {
        self.is_cancelled.fetch_or(done >= self.apron_bytes, Ordering::Relaxed);
    }

    fn is_cancelled(&self) -> bool {
        self.is_cancelled.load(Ordering::Relaxed)
    }
}

#[test]
fn a_cancelled_pack_has_no_final_name_and_is_resumed() {
    let array = |access| Array { access, ..Array::new([70, 40, 75], |p| value(p) as u8) };
    for access in [Access::Box, Access::Planes] {
        let fresh = PackOptions { aprons: 1, ..options(VoxelType::U8) };
        let expected = packed(&array(access), &fresh);
        for (voxels, apron_bytes) in [(0, u64::MAX), (70_000, u64::MAX), (140_000, u64::MAX), (u64::MAX, 1)] {
            let (source, folder) = (array(access), tempfile::tempdir().unwrap());
            let store = folder.path().join("s.zarr");
            let ended = pack(&source, &store, &fresh, &Canceller::after(voxels, apron_bytes));
            let Err(PackError::Cancelled { store: named, done, total }) = ended else {
                panic!("{access:?}: {ended:?}")
            };
            assert!(named == store && done < total, "{access:?} {voxels}: {done} of {total}");
            if voxels == 0 {
                assert!(source.reads.into_inner() <= fresh.threads as u32, "{access:?}: reads on");
            }
            assert!(Store::open(&store).is_err(), "{access:?} {voxels}: half of a store opens");
            assert_eq!(store.exists(), done > 0, "{access:?} {voxels}: {done} shards");
            let resume = PackOptions { exists: Exists::Resume, ..fresh.clone() };
            let report = pack(&array(access), &store, &resume, &()).unwrap();
            assert_eq!(report.shards_resumed, done, "{access:?} {voxels}");
            assert_same(&expected, &files(&store), &format!("{access:?} {voxels}"));
        }
    }
}

#[test]
fn a_cancelled_pack_leaves_the_store_that_it_was_to_replace() {
    let folder = tempfile::tempdir().unwrap();
    let store = folder.path().join("s.zarr");
    pack(&Array::new([30, 20, 20], |p| value(p) as u8), &store, &options(VoxelType::U8), &()).unwrap();
    let old = files(&store);
    let overwrite = PackOptions { exists: Exists::Overwrite, ..options(VoxelType::U8) };
    let ended = pack(&Array::new([70, 40, 75], |p| value(p) as u8), &store, &overwrite, &Canceller::after(70_000, 0));
    assert!(matches!(ended, Err(PackError::Cancelled { .. })), "{ended:?}");
    assert_same(&old, &files(&store), "replaced");
}
