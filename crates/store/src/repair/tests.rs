//! Damaged stores, repaired to the packed ones byte for byte; refusals; and repairs stopped at every change.

use super::*;
use crate::append::{AppendOptions, Appender};
use crate::layout::{JOURNAL_NAME, LOCK_NAME};
use crate::pack::tests::trial::Trial;
use crate::pack::tests::{Array, assert_same, files, mean_and_max, options, value};
use crate::pack::{PackOptions, pack};
use crate::verify::verify;
use brickyard_import::Access;
use brickyard_volume::{Voxel, VoxelType};
use proptest::prelude::*;
use std::collections::BTreeMap;
use std::sync::atomic::AtomicI64;

const EXTENT: [u32; 3] = [40, 33, 35];

type Files = BTreeMap<PathBuf, Vec<u8>>;

/// A kind of damage to a file.
#[derive(Clone, Copy, Debug)]
enum Harm {
    Flip(usize),
    Cut(usize),
    Lose,
    Zero,
}

fn harm(path: &Path, harm: Harm) {
    let mut bytes = std::fs::read(path).unwrap();
    let length = bytes.len();
    match harm {
        Harm::Flip(at) => bytes[at % length] ^= 1 << (at % 8),
        Harm::Cut(to) => bytes.truncate(to % length),
        Harm::Zero => bytes.fill(0),
        Harm::Lose => return std::fs::remove_file(path).unwrap(),
    }
    std::fs::write(path, bytes).unwrap();
}

fn source<T: Voxel>(times: u32, channels: u32) -> Array<T> {
    Array::series(EXTENT, times, channels, |i, p| T::from_f64_rounded(value(p) + f64::from(i)))
}

fn packed(dir: &Path, source: &dyn Source, options: &PackOptions) -> PathBuf {
    let path = dir.join("s.zarr");
    pack(source, &path, options, &()).unwrap();
    path
}

fn all(voxel_type: VoxelType) -> PackOptions {
    PackOptions { downsample: mean_and_max(), aprons: 1, ..options(voxel_type) }
}

fn repaired(path: &Path, source: &dyn Source) -> Result<RepairReport, RepairError> {
    repair(path, source, 1 << 30, 2, |_, _| ControlFlow::Continue(()))
}

fn restore(path: &Path, files: &Files) {
    for (name, bytes) in files {
        let file = path.join(name);
        std::fs::create_dir_all(file.parent().unwrap()).unwrap();
        std::fs::write(file, bytes).unwrap();
    }
}

/// Files that can be made again.
fn repairable(files: &Files) -> Vec<PathBuf> {
    files.keys().filter(|name| *name != Path::new("zarr.json")).cloned().collect()
}

fn is_as_packed(path: &Path, expected: &Files, what: &str) {
    assert_same(&files(path), expected, what);
    assert_eq!(verify(path, |_, _| {}).unwrap().problems, [], "{what}");
}

/// Each file of all arrays, alone.
#[test]
fn every_file_but_the_root_document_is_made_again() {
    let dir = tempfile::tempdir().unwrap();
    let source = source::<u8>(2, 1);
    let path = packed(dir.path(), &source, &all(VoxelType::U8));
    let sound = files(&path);
    let names = repairable(&sound);
    assert!(names.len() > 60, "{names:?}");
    for (i, name) in names.iter().enumerate() {
        let kinds = [Harm::Flip(i * 31), Harm::Cut(i * 13), Harm::Lose, Harm::Zero];
        let kind = kinds[i % 4];
        harm(&path.join(name), kind);
        let report = repaired(&path, &source).unwrap();
        // An empty object's flipped bit may change nothing.
        assert!(report.left.is_empty() && report.repaired.len() <= 1, "{name:?} {kind:?}: {report:?}");
        is_as_packed(&path, &sound, &format!("{name:?} {kind:?}"));
    }
    assert_eq!(repaired(&path, &source).unwrap(), RepairReport::default());
}

/// Anything at once: a whole level, all side data, half of the files.
#[test]
fn whatever_is_lost_together_is_made_again() {
    let dir = tempfile::tempdir().unwrap();
    let source = source::<u16>(1, 2);
    let path = packed(dir.path(), &source, &all(VoxelType::U16));
    let sound = files(&path);
    let is_in = |name: &Path, part: &str| name.to_string_lossy().contains(part);
    for part in ["0/c/", "1/c/", "ranges", "shards/", ".brickyard/", "zarr.json", "/max/", "aprons", "c/"] {
        let lost = repairable(&sound).into_iter().filter(|name| is_in(name, part));
        // Without a record and without a sound brick, nothing would tell a wrong source.
        let lost: Vec<PathBuf> = lost.filter(|name| !(part == "c/" && is_in(name, "hashes"))).collect();
        assert!(!lost.is_empty(), "{part}");
        lost.iter().for_each(|name| std::fs::remove_file(path.join(name)).unwrap());
        let report = repaired(&path, &source).unwrap();
        assert_eq!((report.left, report.repaired.len()), (vec![], lost.len()), "{part}");
        is_as_packed(&path, &sound, part);
    }
}

/// Sources that decode planes, floats without data, several steps in a shard, and labels.
#[test]
fn all_kinds_of_stores_are_repaired() {
    fn check<T: Voxel>(mut source: Array<T>, options: &PackOptions, access: Access) {
        source.access = access;
        let dir = tempfile::tempdir().unwrap();
        let path = packed(dir.path(), &source, options);
        let sound = files(&path);
        for (i, name) in repairable(&sound).iter().enumerate().filter(|(i, _)| i % 3 == 0) {
            harm(&path.join(name), [Harm::Flip(i * 7), Harm::Lose, Harm::Cut(i)][i % 2]);
        }
        let report = repaired(&path, &source).unwrap();
        assert_eq!(report.left, []);
        is_as_packed(&path, &sound, "all");
    }
    check(source::<u8>(1, 1), &options(VoxelType::U8), Access::Planes);
    check(source::<i32>(3, 2), &PackOptions { shard_times: 2, ..all(VoxelType::I32) }, Access::Planes);
    let mut floats = source::<f32>(1, 2);
    floats.info.nodata = Some(7.0);
    check(floats, &PackOptions { aprons: 2, ..all(VoxelType::F32) }, Access::Box);
    let mut shorts = source::<i16>(2, 1);
    shorts.info.nodata = Some(0.0);
    check(shorts, &all(VoxelType::I16), Access::Planes);
    let labels = PackOptions {
        kind: crate::metadata::Kind::Labels,
        downsample: crate::downsample::Downsample::Mode.into(),
        ..options(VoxelType::U32)
    };
    check(source::<u32>(1, 1), &labels, Access::Box);
}

/// A store grown step by step is repaired from all of its steps.
#[test]
fn a_store_with_appended_steps_is_repaired() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("s.zarr");
    let whole = source::<u8>(3, 1);
    let step = |time: u32| Array::<u8>::series(EXTENT, 1, 1, |_, p| (value(p) + f64::from(time)) as u8);
    let mut appender = Appender::create(&path, &step(0), None, &all(VoxelType::U8), &()).unwrap();
    appender.append(&step(1), None, &()).unwrap();
    appender.append(&step(2), None, &()).unwrap();
    assert!(matches!(repaired(&path, &whole), Err(RepairError::Pack(crate::pack::PackError::Busy { .. }))));
    drop(appender);
    let sound = files(&path);
    for (i, name) in repairable(&sound).iter().enumerate() {
        if i % 5 == 0 {
            harm(&path.join(name), Harm::Lose);
        }
    }
    for name in ["0/.brickyard/counts/3/0", "0/zarr.json"] {
        if path.join(name).exists() {
            harm(&path.join(name), Harm::Flip(100));
        }
    }
    repaired(&path, &whole).unwrap();
    is_as_packed(&path, &sound, "appended");
    Appender::open(&path, AppendOptions { memory_bytes: 1 << 30, threads: 2 })
        .unwrap()
        .append(&step(3), None, &())
        .unwrap();
}

/// A single other voxel in a damaged shard, in the sample beside one, or a description of another volume.
#[test]
fn another_source_is_refused_and_nothing_is_written() {
    let dir = tempfile::tempdir().unwrap();
    let right = source::<u8>(2, 1);
    let path = packed(dir.path(), &right, &all(VoxelType::U8));
    let refused = |other: &dyn Source, words: &str| {
        let before = files(&path);
        let error = repaired(&path, other).unwrap_err();
        assert!(matches!(error, RepairError::Unlike { .. }) && error.to_string().contains(words), "{error}");
        assert_same(&files(&path), &before, words);
    };
    harm(&path.join("0/c/1/0/0/1"), Harm::Flip(100));
    harm(&path.join("0/c/0/1/0/1"), Harm::Lose);
    // In the second of them, after the first was made.
    let at = |voxel: [u32; 3], step| {
        Array::<u8>::series(EXTENT, 2, 1, move |i, p| {
            let other = u8::from(p == voxel && i == step);
            (value(p) + f64::from(i)) as u8 ^ other
        })
    };
    refused(&at([35, 4, 3], 1), "other voxels in");
    refused(&at([36, 3, 32], 0), "other voxels in");
    refused(&source::<u16>(2, 1), "voxel type");
    refused(&source::<u8>(1, 1), "number of time steps");
    refused(&source::<u8>(2, 2), "number of channels");
    refused(&Array::<u8>::series([40, 33, 34], 2, 1, |_, _| 0), "shape");
    // A source bears witness to a coarse level's damage, too.
    repaired(&path, &right).unwrap();
    harm(&path.join("1/c/0/0/0/0"), Harm::Lose);
    refused(&Array::<u8>::series(EXTENT, 2, 1, |i, p| (value(p) + f64::from(i) + 1.0) as u8), "other voxels in");
    repaired(&path, &right).unwrap();
}

/// Without hashes, the bricks beside vouch; without these, too, nothing does.
#[test]
fn a_source_needs_a_witness() {
    let dir = tempfile::tempdir().unwrap();
    let right = source::<u8>(1, 1);
    let path = packed(dir.path(), &right, &options(VoxelType::U8));
    let sound = files(&path);
    let lose = |part: &str| {
        let lost = sound.keys().filter(|name| name.to_string_lossy().starts_with(part));
        lost.for_each(|name| std::fs::remove_file(path.join(name)).unwrap());
    };
    lose("0/.brickyard/hashes/c");
    lose("0/c/1/0/1");
    let other = Array::<u8>::series(EXTENT, 1, 1, |_, p| value(p) as u8 ^ u8::from(p[2] < 32));
    let before = files(&path);
    let error = repaired(&path, &other).unwrap_err();
    assert!(matches!(error, RepairError::Unlike { .. }), "{error}");
    assert_same(&files(&path), &before, "refused");
    repaired(&path, &right).unwrap();
    is_as_packed(&path, &sound, "vouched");
    lose("0/.brickyard/hashes/c");
    lose("0/c");
    let error = repaired(&path, &right).unwrap_err();
    assert!(matches!(error, RepairError::Unvouched { .. }), "{error}");
}

#[test]
fn a_source_that_fails_midway_leaves_the_store_as_it_was() {
    let dir = tempfile::tempdir().unwrap();
    let mut source = source::<u8>(1, 1);
    let path = packed(dir.path(), &source, &options(VoxelType::U8));
    let sound = files(&path);
    for name in ["0/c/0/0/1", "0/c/1/1/1", "1/c/0/0/0"] {
        harm(&path.join(name), Harm::Flip(9));
    }
    let before = files(&path);
    for reads in 0.. {
        source.fuse = AtomicI64::new(reads);
        match repaired(&path, &source) {
            Err(error) => {
                assert!(matches!(error, RepairError::Source(_)), "{error}");
                assert_same(&files(&path), &before, "failed");
            }
            Ok(_) => {
                assert!(reads > 4, "{reads}");
                break;
            }
        }
    }
    is_as_packed(&path, &sound, "in the end");
}

/// A full disk or a crash at any change: every file is the damaged or the packed one, and the next repair ends it.
#[test]
fn a_repair_stopped_anywhere_makes_nothing_worse() {
    let dir = tempfile::tempdir().unwrap();
    let source = source::<u8>(1, 1);
    let path = packed(dir.path(), &source, &all(VoxelType::U8));
    let sound = files(&path);
    let harmed = [
        "0/c/0/0/1",
        "0/c/1/0/0",
        "1/c/0/0/0",
        "1/.brickyard/max/c/0/0/0",
        "0/.brickyard/hashes/c/0/0/0/0/0/0",
        "1/.brickyard/ranges/c/0/0/0/0/0/0",
        "0/.brickyard/aprons/c/0/0/1/0",
        "1/zarr.json",
    ];
    for changes in 0.. {
        restore(&path, &sound);
        for (i, name) in harmed.iter().enumerate() {
            harm(&path.join(name), if i % 2 == 0 { Harm::Flip(40) } else { Harm::Lose });
        }
        let before = files(&path);
        let disk = Trial { syncs_each: true, fuse: Some(changes.into()), ..Trial::default() }.disk();
        let limits = Limits { memory_bytes: 1 << 30, threads: 2 };
        let stopped = repair_on(&disk, &path, &source, limits, &Watch::new(&|_, _| ControlFlow::Continue(())));
        for (name, bytes) in files(&path) {
            let is_either = before.get(&name) == Some(&bytes) || sound.get(&name) == Some(&bytes);
            let is_temporary = name.extension().is_some_and(|end| end == "tmp");
            assert!(is_either || is_temporary, "{changes}: {name:?}");
        }
        if let Err(error) = &stopped {
            assert!(matches!(error, RepairError::Incomplete { .. } | RepairError::Pack(_)), "{error}");
        }
        repaired(&path, &source).unwrap();
        is_as_packed(&path, &sound, &format!("{changes}"));
        if stopped.is_ok() {
            assert!(changes > 30, "{changes}");
            break;
        }
    }
}

#[test]
fn what_cannot_be_repaired_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    let source = source::<u8>(1, 1);
    let path = packed(dir.path(), &source, &options(VoxelType::U8));
    let sound = files(&path);
    for kind in [Harm::Lose, Harm::Zero, Harm::Cut(300)] {
        harm(&path.join("zarr.json"), kind);
        let before = files(&path);
        assert!(matches!(repaired(&path, &source), Err(RepairError::Open(_))), "{kind:?}");
        assert_same(&files(&path), &before, "root");
        restore(&path, &sound);
    }
    let little = repair(&path, &source, 1 << 20, 2, |_, _| ControlFlow::Continue(()));
    assert!(matches!(little, Err(RepairError::Memory { .. })));
    std::fs::write(path.join(JOURNAL_NAME), "{}\n").unwrap();
    assert!(matches!(repaired(&path, &source), Err(RepairError::Unfinished { .. })));
    std::fs::remove_file(path.join(JOURNAL_NAME)).unwrap();
    let missing = dir.path().join("missing");
    assert!(repaired(&missing, &source).is_err() && !missing.exists());
    // A shard recorded as compressed otherwise, as by another version of the program.
    let store = Store::open(&path).unwrap();
    let array = crate::side::SideArray::fingerprints(&path, store.layout(), Level(0));
    let page = array.page_at(Level(0), 0);
    crate::test_store::edit_page(&array, page, |bytes| bytes[0] ^= 1);
    let before = files(&path);
    let report = repaired(&path, &source).unwrap();
    assert!(report.repaired.is_empty() && report.left.len() == 1, "{report:?}");
    assert!(report.left[0].what.contains("another version"), "{report:?}");
    assert_same(&files(&path), &before, "left");
    assert!(!path.join(LOCK_NAME).exists());
}

/// A file of a shard of only fill, which other programs would read, goes.
#[test]
fn a_file_too_many_is_removed() {
    let dir = tempfile::tempdir().unwrap();
    let source = Array::<u8>::series(EXTENT, 1, 1, |_, [x, ..]| u8::from(x >= 32));
    let path = packed(dir.path(), &source, &options(VoxelType::U8));
    let sound = files(&path);
    let [empty, full] = ["0/c/0/0/0", "0/c/0/0/1"].map(|name| path.join(name));
    assert!(!empty.exists());
    std::fs::create_dir_all(empty.parent().unwrap()).unwrap();
    std::fs::copy(full, &empty).unwrap();
    assert_eq!(repaired(&path, &source).unwrap().repaired, [empty]);
    is_as_packed(&path, &sound, "removed");
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 24, ..ProptestConfig::default() })]

    /// Any damage to any files.
    #[test]
    fn damage_is_undone(
        harms in prop::collection::vec((any::<prop::sample::Index>(), any::<u32>(), 0..4u8), 1..6),
        by_planes: bool,
    ) {
        let dir = tempfile::tempdir().unwrap();
        let mut source = source::<u16>(1, 1);
        source.access = if by_planes { Access::Planes } else { Access::Box };
        let path = packed(dir.path(), &source, &all(VoxelType::U16));
        let sound = files(&path);
        let names = repairable(&sound);
        for (name, at, kind) in harms {
            let (name, at) = (name.get(&names), at as usize);
            let kind = [Harm::Flip(at), Harm::Cut(at), Harm::Lose, Harm::Zero][kind as usize];
            // It may be lost already, or empty.
            if std::fs::metadata(path.join(name)).is_ok_and(|file| file.len() > 0) {
                harm(&path.join(name), kind);
            }
        }
        prop_assert_eq!(repaired(&path, &source).unwrap().left, vec![]);
        is_as_packed(&path, &sound, "damage");
    }
}

/// Cancelled at any report, a repair leaves each file the damaged one or the sound one, and another goes on.
#[test]
fn a_cancelled_repair_leaves_every_file_damaged_or_sound() {
    let dir = tempfile::tempdir().unwrap();
    let source = source::<u16>(1, 1);
    let path = packed(dir.path(), &source, &all(VoxelType::U16));
    let sound = files(&path);
    let mut damaged = sound.clone();
    for name in repairable(&sound) {
        harm(&path.join(&name), Harm::Flip(77));
        damaged.insert(name.clone(), std::fs::read(path.join(&name)).unwrap());
    }
    let mut reports = 0;
    loop {
        restore(&path, &damaged);
        let left = AtomicI64::new(reports);
        let cancelling = |_, _| match left.fetch_sub(1, Ordering::Relaxed) {
            0 => ControlFlow::Break(()),
            _ => ControlFlow::Continue(()),
        };
        let Err(error) = repair(&path, &source, 1 << 30, 2, cancelling) else { break };
        assert!(matches!(error, RepairError::Cancelled { .. }), "{error}");
        let found = files(&path);
        assert!(found.keys().eq(damaged.keys()), "after {reports}: {:?}", found.keys());
        for (name, bytes) in &found {
            assert!(*bytes == damaged[name] || *bytes == sound[name], "{} after {reports}", name.display());
        }
        repaired(&path, &source).unwrap();
        is_as_packed(&path, &sound, &format!("cancelled after {reports} reports"));
        reports += 1 + reports / 4;
    }
    assert!(reports > 9, "{reports} reports");
}
