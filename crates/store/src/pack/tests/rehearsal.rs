//! Rehearsed packs: the plan, and the refusals of a pack, without a trace on the disk; and stores compared with their sources.

use super::*;
use crate::append::{AppendOptions, Appender};
use crate::verify::{VerifyError, compare_within, verify};
use std::sync::Mutex;

/// Keeps the plan and the remarks.
#[derive(Default)]
pub(super) struct Told {
    plans: Mutex<Vec<PackPlan>>,
    pub(super) notes: Mutex<Vec<String>>,
}

impl Progress for Told {
    fn planned(&self, plan: &PackPlan) {
        self.plans.lock().unwrap().push(plan.clone());
    }
    fn note(&self, message: &str) {
        self.notes.lock().unwrap().push(message.into());
    }
    fn warn(&self, message: &str) {
        self.notes.lock().unwrap().push(message.into());
    }
}

/// All names below a folder, and the contents of files.
pub(super) fn tree(dir: &Path) -> Vec<(PathBuf, Option<Vec<u8>>)> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(dir).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            found.extend(tree(&path));
        }
        found.push((path.clone(), std::fs::read(&path).ok()));
    }
    found.sort();
    found
}

fn some_bytes(_: u32, [x, y, z]: [u32; 3]) -> u8 {
    (1 + (x * 7 + y * 31 + z * 3) % 250) as u8
}

#[test]
fn a_rehearsal_refuses_what_a_pack_refuses_and_leaves_no_trace() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name);
    let source = Array::<u8>::series([40, 20, 20], 1, 1, some_bytes);
    let plain = options(VoxelType::U8);
    pack(&source, &at("done.zarr"), &plain, &()).unwrap();
    let stopped = pack_on(&Trial::disk_of(12), &source, &at("half.zarr"), &plain, &());
    assert!(matches!(stopped, Err(PackError::Incomplete { .. })), "{stopped:?}");
    assert!(at("half.zarr").join(JOURNAL_NAME).exists());
    std::fs::create_dir_all(at("other.zarr/things")).unwrap();
    std::fs::create_dir_all(at("edited.zarr")).unwrap();
    pack(&source, &at("edited.zarr"), &plain, &()).unwrap();
    std::fs::write(at("edited.zarr/mine.txt"), "precious").unwrap();
    std::fs::write(at("file.zarr"), "x").unwrap();
    std::fs::create_dir_all(at("taken.zarr.packing/things")).unwrap();
    pack(&source, &at("taken.zarr"), &plain, &()).unwrap();
    let before = tree(dir.path());
    let other = Array::<u8> {
        info: SourceInfo { identity: "another".into(), ..source.info.clone() },
        ..Array::series([40, 20, 20], 1, 1, some_bytes)
    };
    let with = |exists| PackOptions { exists, ..plain.clone() };
    for (name, source, options) in [
        ("done.zarr", &source, with(Exists::Refuse)),
        ("half.zarr", &source, with(Exists::Refuse)),
        ("other.zarr", &source, with(Exists::Overwrite)),
        ("other.zarr", &source, with(Exists::Refuse)),
        ("file.zarr", &source, with(Exists::Refuse)),
        ("edited.zarr", &source, with(Exists::Overwrite)),
        ("taken.zarr", &source, with(Exists::Overwrite)),
        ("done.zarr", &other, with(Exists::Resume)),
        ("half.zarr", &other, with(Exists::Resume)),
        ("done.zarr/0/new.zarr", &source, with(Exists::Refuse)),
        ("new.zarr", &source, PackOptions { edge: 17, ..plain.clone() }),
        ("new.zarr", &source, PackOptions { memory_bytes: 1 << 20, ..plain.clone() }),
        ("new.zarr", &source, PackOptions { name: Some("a\nb".into()), ..plain.clone() }),
        ("new.zarr", &source, PackOptions { name: Some(" ".into()), ..plain.clone() }),
    ] {
        let rehearsed = rehearse(source, &at(name), &options, &()).err().map(|error| error.to_string());
        assert!(tree(dir.path()) == before, "{name}: changed by a rehearsal");
        let packed = pack(source, &at(name), &options, &()).err().map(|error| error.to_string());
        assert!(tree(dir.path()) == before, "{name}: changed by a pack");
        assert!(packed.is_some(), "{name} {options:?}");
        assert_eq!(rehearsed, packed, "{name}");
    }
    // A plan is made once, without a folder; a finished store has none.
    let told = Told::default();
    for (name, exists) in [
        ("new.zarr", Exists::Refuse),
        ("deep/er/new.zarr", Exists::Refuse),
        ("done.zarr", Exists::Overwrite),
        ("half.zarr", Exists::Resume),
        ("half.zarr", Exists::Overwrite),
    ] {
        let planned = rehearse(&source, &at(name), &with(exists), &told).unwrap();
        assert_eq!(told.plans.lock().unwrap().drain(..).collect::<Vec<_>>(), planned.into_iter().collect::<Vec<_>>());
    }
    assert_eq!(rehearse(&source, &at("done.zarr"), &with(Exists::Resume), &told).unwrap(), None);
    assert!(told.plans.lock().unwrap().is_empty() && tree(dir.path()) == before);
    // A running pack holds the lock.
    let running = crate::pack::lock::DirLock::take(&Disk::default(), &at("half.zarr")).unwrap();
    running.declare(&Disk::default()).unwrap();
    let found = rehearse(&source, &at("half.zarr"), &with(Exists::Resume), &());
    assert!(matches!(found, Err(PackError::Busy { holder: Some(_), .. })), "{found:?}");
}

#[test]
fn a_disk_without_room_for_scratch_is_refused_by_both() {
    // Windows of planes do not fit into memory, and are rings on the disk.
    let mut source = Array::<u8>::series([40, 20, 20], 1, 1, some_bytes);
    source.info.extent = Extent::new(1 << 20, 1 << 20, 100);
    source.access = Access::Planes;
    let plain =
        PackOptions { memory_bytes: 1 << 43, threads: 1, shard_edge: 1 << 10, edge: 256, ..options(VoxelType::U8) };
    let dir = tempfile::tempdir().unwrap();
    let plan = plan(&source, &plain).unwrap();
    assert!(plan.scratch_bytes > 1 << 46, "{}", plan.scratch_bytes);
    let store = dir.path().join("s.zarr");
    for found in [rehearse(&source, &store, &plain, &()).err(), pack(&source, &store, &plain, &()).err()] {
        assert!(matches!(found, Some(PackError::NoRoom { .. })), "{found:?}");
    }
    assert!(!store.exists());
}

#[test]
fn as_many_files_as_planned_are_written() {
    for (aprons, shard_times, second) in [(0, 1, false), (1, 1, true), (0, 2, true), (2, 3, false)] {
        let source = Array::<u8>::series([70, 40, 20], 5, 2, some_bytes);
        let downsample = if second { "mean,max" } else { "mean" }.parse().unwrap();
        let options = PackOptions { aprons, shard_times, downsample, ..options(VoxelType::U8) };
        let planned = plan(&source, &options).unwrap().files_at_most;
        assert_eq!(planned, packed(&source, &options).len() as u64, "{aprons} {shard_times} {second}");
    }
}

#[test]
fn a_name_is_kept_and_part_of_the_settings() {
    let dir = tempfile::tempdir().unwrap();
    let source = Array::<u8>::series([20, 20, 20], 1, 1, some_bytes);
    let mut timed = Array::<u8>::series([20, 20, 20], 1, 1, some_bytes);
    timed.info.time = Some(TimeAxis::default());
    let named = PackOptions {
        name: Some("Hübsch \"1\"".into()),
        downsample: "mean,max".parse().unwrap(),
        ..options(VoxelType::U8)
    };
    let store = dir.path().join("s.zarr");
    pack(&timed, &store, &named, &()).unwrap();
    Appender::open(&store, AppendOptions::default()).unwrap().append(&source, None, &()).unwrap();
    let root: Value = serde_json::from_slice(&std::fs::read(store.join("zarr.json")).unwrap()).unwrap();
    assert_eq!(root["attributes"]["ome"]["multiscales"][0]["name"], json!("Hübsch \"1\""));
    assert_eq!(Store::open(&store).unwrap().info().name, named.name);
    assert_eq!(verify(&store, |_, _| {}).unwrap().problems, []);
    let unnamed = PackOptions { name: None, ..named.clone() };
    assert_ne!(settings_fingerprint(&source, &named), settings_fingerprint(&source, &unnamed));
    assert!(!settings(&source, &unnamed).to_string().contains("name\""), "old fingerprints stay");
}

#[test]
fn the_first_voxel_that_differs_from_the_source_is_named() {
    for access in [Access::Box, Access::Planes] {
        let make = |odd: [u32; 3], volume: u32| {
            let value = move |v: u32, p: [u32; 3]| {
                let value = f32::from(some_bytes(v, p)) + v as f32;
                if (p, v) == (odd, volume) {
                    1234.5
                } else if p[0] == 3 {
                    f32::NAN
                } else if value == 9.0 {
                    8.0
                } else {
                    value
                }
            };
            let mut source = Array::<f32>::series([50, 20, 37], 2, 2, value);
            source.access = access;
            source
        };
        let dir = tempfile::tempdir().unwrap();
        let store = dir.path().join("s.zarr");
        let nowhere = [u32::MAX; 3];
        let mut source = make(nowhere, 0);
        // Voxels of 8 become NaN in the store, which is no difference.
        source.info.nodata = Some(8.0);
        pack(&source, &store, &options(VoxelType::F32), &()).unwrap();
        for memory_bytes in [1 << 30, 28 << 20] {
            let done = std::sync::atomic::AtomicU64::new(0);
            let compare = |source: &dyn Source| {
                compare_within(&store, source, memory_bytes, 2, |bytes, total| {
                    done.fetch_max(bytes, Ordering::Relaxed);
                    assert!(bytes <= total);
                })
            };
            assert_eq!(compare(&source).unwrap(), None);
            assert_eq!(done.into_inner(), 50 * 20 * 37 * 4 * 4);
        }
        for (odd, volume) in [([0, 0, 0], 0), ([49, 19, 36], 3), ([17, 5, 16], 2)] {
            let mut other = make(odd, volume);
            other.info.nodata = Some(8.0);
            let found = compare_within(&store, &other, 1 << 30, 2, |_, _| {}).unwrap().unwrap();
            let [x, y, z] = odd;
            let place = format!("voxel {x},{y},{z}, channel {}, time step {}: ", volume % 2, volume / 2);
            assert!(found.what.contains(&place) && found.what.ends_with(" 1234.5 there"), "{}", found.what);
        }
        let unmarked = make(nowhere, 0);
        assert!(compare_within(&store, &unmarked, 1 << 30, 2, |_, _| {}).unwrap().is_some(), "8 is data there");
        let less = compare_within(&store, &source, 1 << 20, 2, |_, _| {});
        assert!(matches!(less, Err(VerifyError::Memory { needed_bytes, .. }) if needed_bytes > 24 << 20));
        source.fuse.store(2, Ordering::Relaxed);
        assert!(matches!(compare_within(&store, &source, 1 << 30, 2, |_, _| {}), Err(VerifyError::Source(_))));
        let smaller = Array::<f32>::series([50, 20, 36], 2, 2, |_, _| 0.0);
        assert!(compare_within(&store, &smaller, 1 << 30, 2, |_, _| {}).unwrap().is_some());
    }
}

/// An estimate is of the input's own work: none for small inputs, and none of unreadable ones.
#[test]
fn only_long_packs_are_estimated() {
    for access in [Access::Box, Access::Planes] {
        let mut source = Large { info: Array::<u8>::series([2, 2, 2], 1, 1, some_bytes).info, access, fails: false };
        source.info.extent = Extent::new(700, 500, 700);
        let of = |source: &Large| {
            let options = PackOptions { threads: 1, ..PackOptions::new(VoxelType::U8) };
            estimate(source, &options, &plan(source, &options).unwrap())
        };
        let time = of(&source).unwrap().as_secs_f64();
        assert!(time > 0.0 && time.is_finite());
        source.fails = true;
        assert_eq!(of(&source), None);
        source.info.extent = Extent::new(100, 100, 100);
        source.fails = false;
        assert_eq!(of(&source), None);
    }
}

/// A volume of a formula, larger than memory ought to hold in a test.
struct Large {
    info: SourceInfo,
    access: Access,
    fails: bool,
}

impl Source for Large {
    fn info(&self) -> &SourceInfo {
        &self.info
    }
    fn access(&self) -> Access {
        self.access
    }
    fn read_box(&self, _: u32, _: u32, region: VoxelBox, out: &mut [u8]) -> Result<(), ImportError> {
        assert_eq!(out.len() as u64, region.extent().volume());
        if self.fails {
            let error = std::io::ErrorKind::UnexpectedEof.into();
            return Err(ImportError::Io { path: "large".into(), error });
        }
        out.iter_mut().enumerate().for_each(|(i, byte)| *byte = (i * 7 % 251) as u8);
        Ok(())
    }
}
