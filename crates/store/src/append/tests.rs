//! Appended steps against the same steps packed at once; appends stopped at every change, and the view of readers.

use super::*;
use crate::downsample::Downsample;
use crate::layout::JOURNAL_NAME;
use crate::pack::lock::DirLock;
use crate::pack::tests::trial::Trial;
use crate::pack::tests::{Array, assert_same, files, level_voxels, mean_and_max, options, value};
use crate::pack::{PackPlan, pack};
use crate::verify::{documents as written, verify};
use brickyard_import::{Access, ImportError, SourceInfo, StepTime, TimeSpan};
use brickyard_volume::{BrickId, BrickIndex, ChannelLook, Level, Orientation, Voxel, VoxelBox, VoxelType};
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicI64, Ordering};

const EXTENT: [u32; 3] = [40, 33, 35];

/// Each step has different empty parts.
fn voxel(step: u32, channel: u32, [x, y, z]: [u32; 3]) -> f64 {
    let is_empty = (x / 16 + y / 16 + z / 16 + step).is_multiple_of(3);
    if is_empty { 0.0 } else { value([x + 20, y + 7 * channel, z + 3 * step]) + f64::from(10 * step + channel) }
}

fn step_of<T: Voxel>(step: u32, channels: u32) -> Array<T> {
    let mut array = Array::series(EXTENT, 1, channels, |channel, p| T::from_f64_rounded(voxel(step, channel, p)));
    array.info.identity = format!("step {step}");
    array
}

fn byte_step(step: u32) -> Array<u8> {
    step_of(step, 1)
}

fn few() -> AppendOptions {
    AppendOptions { memory_bytes: 1 << 30, threads: 2 }
}

fn byte_options() -> PackOptions {
    PackOptions { aprons: 1, downsample: mean_and_max(), ..options(VoxelType::U8) }
}

/// A store of these steps, appended one by one.
fn store_of(dir: &Path, steps: std::ops::Range<u32>) -> PathBuf {
    let path = dir.join("s.zarr");
    let first = byte_step(steps.start);
    let mut appender = Appender::create(&path, &first, None, &byte_options(), &()).unwrap();
    for step in steps.skip(1) {
        appender.append(&byte_step(step), None, &()).unwrap();
    }
    path
}

fn append(path: &Path, step: u32) -> Result<AppendReport, AppendError> {
    Appender::open(path, few())?.append(&byte_step(step), None, &())
}

fn root_of(path: &Path) -> Value {
    serde_json::from_slice(&std::fs::read(path.join("zarr.json")).unwrap()).unwrap()
}

fn edit(path: &Path, change: impl FnOnce(&mut Value)) {
    let mut document: Value = serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap();
    change(&mut document);
    std::fs::write(path, document_bytes(&document)).unwrap();
}

fn assert_sound(path: &Path, what: &str) {
    assert_eq!(verify(path, |_, _| {}).unwrap().problems, [], "{what}");
}

/// Checks all voxels of level 0 of the first steps, and one of the coarsest level.
fn assert_steps(store: &Store, steps: u32, what: &str) {
    assert_eq!(store.times(), steps, "{what}");
    for step in 0..steps {
        let expected: Vec<f64> = crate::test_store::voxels(VoxelBox::new([0; 3], EXTENT))
            .map(|p| u8::from_f64_rounded(voxel(step, 0, p)).to_f64())
            .collect();
        assert!(level_voxels(store, step, 0, Level(0)) == expected, "{what}: step {step}");
        level_voxels(store, step, 0, store.pyramid().coarsest());
    }
}

/// Everything except the history of the steps.
fn essence(path: &Path) -> (BTreeMap<PathBuf, Vec<u8>>, Value) {
    let mut found = files(path);
    found.retain(|path, _| path != Path::new("zarr.json") && !path.to_string_lossy().contains("/counts/"));
    let mut root = root_of(path);
    let ours = root["attributes"]["brickyard"].as_object_mut().unwrap();
    for key in ["times", "source", "settings_fingerprint", "checksum"] {
        ours.remove(key);
    }
    (found, root)
}

/// Steps appended one by one against the same steps packed at once.
fn check_series<T: Voxel>(
    channels: u32,
    access: Access,
    options: &PackOptions,
    value: impl Fn(u32, u32, [u32; 3]) -> T,
) {
    let dir = tempfile::tempdir().unwrap();
    let [appended, packed] = ["appended", "packed"].map(|name| dir.path().join(name));
    let prepared = |mut array: Array<T>| {
        array.access = access;
        array.info.nodata = (T::TYPE == VoxelType::I16).then_some(7.0);
        array
    };
    let step = |step| prepared(Array::series(EXTENT, 1, channels, |channel, p| value(step, channel, p)));
    let mut all = prepared(Array::series(EXTENT, 3, channels, |i, p| value(i / channels, i % channels, p)));
    all.info.time = Some(TimeAxis::default());
    pack(&all, &packed, options, &()).unwrap();
    let mut appender = Appender::create(&appended, &step(0), None, options, &()).unwrap();
    for i in 1..3 {
        assert_eq!((appender.times(), appender.append(&step(i), None, &()).unwrap().step), (i, i));
    }
    drop(appender);
    let what = format!("{} {channels} {access:?}", T::TYPE);
    let ((files, root), (expected_files, mut expected)) = (essence(&appended), essence(&packed));
    assert_same(&files, &expected_files, &what);
    for (i, channel) in expected["attributes"]["brickyard"]["channels"].as_array_mut().unwrap().iter_mut().enumerate() {
        // The mean of floats depends in its last digits on the order of addition.
        let mean = &root["attributes"]["brickyard"]["channels"][i]["mean"];
        assert!((mean.as_f64().unwrap() - channel["mean"].as_f64().unwrap()).abs() < 1e-9, "{what}");
        channel["mean"] = mean.clone();
    }
    assert_eq!(root, expected, "{what}");
    assert_sound(&appended, &what);
}

#[test]
fn steps_appended_one_by_one_are_a_series_packed_at_once() {
    let plain = |t| PackOptions { aprons: 0, downsample: Downsample::Mean.into(), ..options(t) };
    let rich = |t| PackOptions { aprons: 2, downsample: mean_and_max(), ..options(t) };
    for access in [Access::Box, Access::Planes] {
        check_series(1, access, &plain(VoxelType::U8), |t, c, p| voxel(t, c, p) as u8);
        check_series(2, access, &rich(VoxelType::I16), |t, c, p| voxel(t, c, p) as i16);
    }
    check_series(3, Access::Box, &plain(VoxelType::U16), |t, c, p| (voxel(t, c, p) * 200.0) as u16);
    check_series(1, Access::Box, &plain(VoxelType::I32), |t, c, p| (voxel(t, c, p) * 1e6) as i32 - 7);
    let holes = |t, c, p: [u32; 3]| if p[0].is_multiple_of(7) { f32::NAN } else { (voxel(t, c, p) as f32).sin() };
    check_series(2, Access::Box, &rich(VoxelType::F32), holes);
}

/// Killed at any change to the file system, at first with other data: the store has whole steps, and the next append
/// arrives at the same bytes.
#[test]
fn an_append_that_stops_anywhere_leaves_whole_steps_and_is_made_again() {
    let dir = tempfile::tempdir().unwrap();
    for steps in [1u32, 2] {
        let made = dir.path().join(format!("of {steps}"));
        std::fs::create_dir(&made).unwrap();
        let path = store_of(&made, 0..steps);
        let before = files(&path);
        let all = changes_of_append(&path, steps);
        let expected = files(&path);
        // Changes before the commit are much alike, and so are those long before the end.
        let moments =
            (0..all).filter(|n| n % 45 == i64::from(steps) || *n > all - 20 || (*n > all - 100 && n % 3 == 0));
        let mut committed = 0;
        for moment in moments {
            write_files(&path, &before);
            let disk = Trial::disk_of(moment);
            let stopped = Appender::open_on(disk, &path, few()).and_then(|mut appender| {
                // Other voxels than the later ones: where the latter have nothing, no files may remain.
                let other = byte_step(steps + 1 + moment as u32 % 3);
                let step = if moment % 2 == 0 { other } else { byte_step(steps) };
                appender.append(&step, None, &())
            });
            let what = format!("{steps} steps, stopped after {moment} of {all} changes");
            let store = Store::open(&path).unwrap_or_else(|error| panic!("{what}: {error}"));
            let message = stopped.as_ref().err().map_or(String::new(), ToString::to_string);
            let is_said = matches!(stopped, Ok(_) | Err(AppendError::Appended { .. }));
            assert_eq!(is_said, store.times() == steps + 1, "{what}: {message}");
            if store.times() == steps {
                assert!(message.contains("s.zarr"), "{what}: {message}");
                assert_steps(&store, steps, &what);
                let report = append(&path, steps).unwrap_or_else(|error| panic!("{what}: {error}"));
                assert_eq!(report.step, steps, "{what}");
                assert_same(&files(&path), &expected, &what);
                continue;
            }
            committed += 1;
            drop(Appender::open(&path, few()).unwrap());
            assert_sound(&path, &what);
            if moment % 2 == 1 {
                assert_same(&files(&path), &expected, &what);
            }
        }
        assert!((1..50).contains(&committed), "{committed} stopped after the commit");
    }
}

/// Appends a step, and returns its number of changes to the file system.
fn changes_of_append(path: &Path, step: u32) -> i64 {
    let mut appender = Appender::open(path, few()).unwrap();
    appender.append(&byte_step(step), None, &()).unwrap();
    let changes = appender.disk.trial.log.lock().unwrap().len();
    changes as i64
}

fn write_files(path: &Path, files: &BTreeMap<PathBuf, Vec<u8>>) {
    std::fs::remove_dir_all(path).unwrap();
    for (name, bytes) in files {
        let file = path.join(name);
        std::fs::create_dir_all(file.parent().unwrap()).unwrap();
        std::fs::write(file, bytes).unwrap();
    }
}

#[test]
fn a_failed_append_takes_back_what_it_wrote() {
    struct Cancelled;
    impl Progress for Cancelled {
        fn advanced(&self, _: u64, _: u64) {
            CALLS.fetch_add(1, Ordering::Relaxed);
        }
        fn is_cancelled(&self) -> bool {
            CALLS.load(Ordering::Relaxed) > 5
        }
    }
    static CALLS: AtomicI64 = AtomicI64::new(0);
    struct Panicking(Array<u8>);
    impl Source for Panicking {
        fn info(&self) -> &SourceInfo {
            self.0.info()
        }
        fn read_box(&self, _: u32, _: u32, region: VoxelBox, _: &mut [u8]) -> Result<(), ImportError> {
            assert!(region.min.z < 16, "a fault of the reader, say");
            Ok(())
        }
    }
    let dir = tempfile::tempdir().unwrap();
    let path = store_of(dir.path(), 0..2);
    let before = files(&path);
    let mut appender = Appender::open(&path, few()).unwrap();
    let failing = byte_step(2);
    failing.fuse.store(9, Ordering::Relaxed);
    let check = |error: AppendError, says: &str| {
        let message = error.to_string();
        assert!(message.contains(says) && message.contains("has 2 time steps"), "{message}");
        let mut now = files(&path);
        now.remove(Path::new(".brickyard-lock"));
        assert_same(&now, &before, says);
    };
    check(appender.append(&failing, None, &()).unwrap_err(), "array");
    check(appender.append(&byte_step(2), None, &Cancelled).unwrap_err(), "cancelled");
    check(appender.append(&Panicking(byte_step(2)), None, &()).unwrap_err(), "a fault of the reader, say");
    appender.append(&byte_step(2), None, &()).unwrap();
    drop(appender);
    let other = tempfile::tempdir().unwrap();
    assert_same(&files(&path), &files(&store_of(other.path(), 0..3)), "after failures");
}

#[test]
fn readers_see_whole_steps_and_follow() {
    let dir = tempfile::tempdir().unwrap();
    let path = store_of(dir.path(), 0..1);
    let mut store = Store::open_with(&path, IoMode::Mmap).unwrap();
    assert_steps(&store, 1, "whose maps are held");
    assert!(store.newer().unwrap().is_none());
    let done = std::sync::atomic::AtomicBool::new(false);
    std::thread::scope(|scope| {
        let reader = scope.spawn(|| {
            let (mut seen, mut store) = (1, Store::open(&path).unwrap());
            while !done.load(Ordering::Relaxed) || store.times() < 6 {
                if let Some(newer) = store.newer().unwrap() {
                    assert!(newer.times() > seen && newer.times() <= 6);
                    seen = newer.times();
                    assert_steps(&newer, seen, "followed");
                    store = newer;
                }
                assert!(Store::open(&path).unwrap().times() >= seen);
            }
        });
        let mut appender = Appender::open(&path, few()).unwrap();
        for step in 1..6 {
            appender.append(&byte_step(step), None, &()).unwrap();
        }
        done.store(true, Ordering::Relaxed);
        reader.join().unwrap();
    });
    assert_steps(&store, 1, "opened before");
    store = Store::open_reduced(&path, Downsample::Max, IoMode::Pread).unwrap();
    append(&path, 6).unwrap();
    let newer = store.newer().unwrap().unwrap();
    assert_eq!((newer.downsample(), newer.times()), (Downsample::Max, 7));
    // An edit is no step, and another store is not this one.
    edit(&path.join("zarr.json"), |root| root["theirs"] = json!(1));
    assert!(newer.newer().unwrap().is_none());
    pack(&byte_step(3), &path, &PackOptions { exists: Exists::Overwrite, ..byte_options() }, &()).unwrap();
    let message = newer.newer().err().unwrap().to_string();
    assert!(message.contains("was replaced"), "{message}");
    assert!(!path.join("0/.brickyard/counts").exists());
}

#[test]
fn one_at_a_time_appends_or_packs() {
    let dir = tempfile::tempdir().unwrap();
    let path = store_of(dir.path(), 0..1);
    let overwrite = PackOptions { exists: Exists::Overwrite, ..byte_options() };
    let is_busy = |error: &PackError| matches!(error, PackError::Busy { holder: Some(holder), .. } if holder.pid == std::process::id());
    let appender = Appender::open(&path, few()).unwrap();
    let second = Appender::open(&path, few()).err().unwrap();
    assert!(matches!(&second, AppendError::Pack(error) if is_busy(error)), "{second}");
    assert!(is_busy(&pack(&byte_step(5), &path, &overwrite, &()).unwrap_err()));
    drop(appender);
    assert!(!path.join(".brickyard-lock").exists() && !dir.path().join("s.zarr.packing").exists());

    /// Appends during a pack.
    struct Meanwhile<'a>(&'a Path, std::sync::Mutex<Vec<AppendError>>);
    impl Progress for Meanwhile<'_> {
        fn planned(&self, _: &PackPlan) {
            self.1.lock().unwrap().extend(append(self.0, 1).err());
        }
    }
    let meanwhile = Meanwhile(&path, Default::default());
    pack(&byte_step(5), &path, &overwrite, &meanwhile).unwrap();
    let refused = meanwhile.1.into_inner().unwrap();
    assert!(matches!(&refused[..], [AppendError::Pack(error)] if is_busy(error)), "{refused:?}");
    assert!(!dir.path().join("s.zarr.packing").exists());
    // One from before the journal existed waits for the store's lock.
    let path = store_of(
        &{
            let d = dir.path().join("b");
            std::fs::create_dir(&d).unwrap();
            d
        },
        0..1,
    );
    let lock = DirLock::take(&Disk::default(), &path).unwrap();
    lock.declare(&Disk::default()).unwrap();
    assert!(matches!(append(&path, 1), Err(AppendError::Pack(error)) if is_busy(&error)));
    drop(lock);
    append(&path, 1).unwrap();
}

#[test]
fn what_other_programs_wrote_survives() {
    let dir = tempfile::tempdir().unwrap();
    let path = store_of(dir.path(), 0..2);
    let dirs = array_dirs(&Store::open(&path).unwrap());
    assert_eq!(dirs.last(), Some(&path.join("0")));
    for dir in &dirs {
        edit(&dir.join("zarr.json"), |document| document["attributes"]["theirs"] = json!({ "a": [1] }));
    }
    edit(&path.join("zarr.json"), |root| {
        root["consolidated_metadata"] = json!(null);
        root["attributes"]["other"] = json!("x");
        let ome = &mut root["attributes"]["ome"];
        ome["name"] = json!("flow");
        ome["omero"]["channels"][0]["window"]["end"] = json!(33.0);
        ome["omero"]["channels"][0]["color"] = json!("00FF00");
        ome["omero"]["rdefs"] = json!({ "model": "color" });
    });
    append(&path, 2).unwrap();
    let store = Store::open(&path).unwrap();
    assert_steps(&store, 3, "edited");
    assert_eq!((store.default_window(0).1, store.channel_displays()[0].color), (33.0, [0, 255, 0]));
    let root = root_of(&path);
    assert!(root.as_object().unwrap().contains_key("consolidated_metadata"));
    assert_eq!([&root["attributes"]["other"], &root["attributes"]["ome"]["name"]], [&json!("x"), &json!("flow")]);
    assert_eq!(root["attributes"]["ome"]["omero"]["rdefs"]["model"], "color");
    // Unedited values follow the voxels.
    let window = &root["attributes"]["ome"]["omero"]["channels"][0]["window"];
    assert_eq!(window["max"], json!(store.channel_range(0).1));
    for dir in &dirs {
        let document = crate::test_store::read_json(&dir.join("zarr.json")).unwrap();
        assert_eq!(
            (&document["attributes"]["theirs"]["a"], &document["shape"][0]),
            (&json!([1]), &json!(3)),
            "{dir:?}"
        );
    }
    let report = verify(&path, |_, _| {}).unwrap();
    assert_eq!((report.problems, report.edits.len()), (vec![], 2));
}

#[test]
fn steps_that_do_not_fit_are_named_with_both_values() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("s.zarr");
    let mut first = step_of::<i16>(0, 1);
    first.info.geometry.spacing = glam::DVec3::new(0.5, 0.5, 2.0);
    first.info.geometry.origin = glam::DVec3::new(1.0, 2.0, 3.0);
    first.info.geometry.unit = Some("millimeter".into());
    first.info.calibrated = true;
    first.info.nodata = Some(-9.0);
    first.info.time = Some(TimeAxis { step: 0.5, unit: Some("second".into()), ..TimeAxis::default() });
    let info = first.info.clone();
    Appender::create(&path, &first, None, &options(VoxelType::I16), &()).unwrap();
    let before = files(&path);
    let refused = |source: &dyn Source, stamp, words: &[&str]| {
        let error = Appender::open(&path, few()).unwrap().append(source, stamp, &()).unwrap_err();
        let message = error.to_string();
        assert!(words.iter().all(|word| message.contains(word)), "{words:?}: {message}");
        assert_same(&files(&path), &before, &message);
    };
    let mut small = Array::series([40, 33, 34], 1, 1, |_, _| 1i16);
    small.info.calibrated = false;
    refused(&small, None, &["step 1", "shape", "40,33,34", "step 0 of", "s.zarr", "40,33,35"]);
    refused(&step_of::<u16>(1, 1), None, &["voxel type is u16", "is i16"]);
    refused(&step_of::<i16>(1, 2), None, &["channels is 2", "is 1"]);
    refused(&Array::series(EXTENT, 2, 1, |_, _| 1i16), None, &["2 time steps"]);
    let with = |change: &dyn Fn(&mut SourceInfo)| {
        let mut step = step_of::<i16>(1, 1);
        step.info = info.clone();
        change(&mut step.info);
        step
    };
    refused(&with(&|i| i.geometry.spacing.x = 0.6), None, &["spacing", "[0.6, 0.5, 2.0]", "[0.5, 0.5, 2.0]"]);
    refused(&with(&|i| i.geometry.origin.z = 4.0), None, &["origin", "[1.0, 2.0, 4.0]", "[1.0, 2.0, 3.0]"]);
    refused(&with(&|i| i.geometry.unit = Some("meter".into())), None, &["unit", "meter", "millimeter"]);
    let rows = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]];
    refused(&with(&|i| i.orientation = Orientation::new(rows).ok()), None, &["orientation", "not known"]);
    refused(&with(&|i| i.nodata = Some(5.0)), None, &["no data is 5", "-9"]);
    refused(&with(&|i| i.time.as_mut().unwrap().step = 0.25), None, &["0.5 s apart", "0.25 s"]);
    refused(&with(&|i| i.time.as_mut().unwrap().unit = Some("day".into())), None, &["second", "day"]);
    refused(&with(&|_| {}), Some(0.0), &["time", "after 0 of step 0", "found 0"]);
    refused(&with(&|_| {}), Some(f64::NAN), &["after 0", "NaN"]);
    // A source with less information fits; and integers without data take the store's value.
    let mut plain = step_of::<i16>(1, 1);
    plain.info.nodata = None;
    Appender::open(&path, few()).unwrap().append(&plain, None, &()).unwrap();
    Appender::open(&path, few()).unwrap().append(&with(&|_| {}), None, &()).unwrap();
    assert_sound(&path, "fits");
    let axis = Store::open(&path).unwrap().time_axis().cloned();
    assert_eq!(axis, info.time);
}

#[test]
fn what_cannot_be_appended_to_is_refused_and_left_alone() {
    let dir = tempfile::tempdir().unwrap();
    let refusal = |path: &Path| Appender::open(path, few()).err().unwrap().to_string();
    assert!(refusal(&dir.path().join("nowhere")).contains("nowhere"));
    let empty = dir.path().join("empty");
    std::fs::create_dir(&empty).unwrap();
    assert!(refusal(&empty).contains("not a brick store") && files(&empty).is_empty());
    std::fs::write(empty.join("zarr.json"), r#"{"zarr_format":3,"node_type":"group","attributes":{"ome":{}}}"#)
        .unwrap();
    assert!(refusal(&empty).contains("without brickyard's side data"));
    let still = dir.path().join("still.zarr");
    pack(&byte_step(0), &still, &byte_options(), &()).unwrap();
    let before = files(&still);
    assert!(refusal(&still).contains("no time axis"));
    assert_same(&files(&still), &before, "without time");
    let grouped = dir.path().join("grouped.zarr");
    let series = Array::series(EXTENT, 3, 1, |step, p| u8::from_f64_rounded(voxel(step, 0, p)));
    pack(&series, &grouped, &PackOptions { shard_times: 2, ..byte_options() }, &()).unwrap();
    assert!(refusal(&grouped).contains("2 time steps in a shard"));
    let unfinished = dir.path().join("u.zarr");
    let create = |source: &Array<u8>| Appender::create(&unfinished, source, None, &byte_options(), &());
    // Two layers of nine bricks are whole shards.
    let failing = byte_step(0);
    failing.fuse.store(20, Ordering::Relaxed);
    create(&failing).err().unwrap();
    assert!(refusal(&unfinished).contains("unfinished pack"));
    // The first step continues, another one does not; and a store is not created twice.
    let message = create(&byte_step(1)).err().unwrap().to_string();
    assert!(message.contains("was begun differently") && !message.contains("overwrite"), "{message}");
    create(&byte_step(0)).unwrap();
    assert!(create(&byte_step(0)).err().unwrap().to_string().contains("exists already"));
    append(&unfinished, 1).unwrap();
    let other = tempfile::tempdir().unwrap();
    assert_same(&files(&unfinished), &files(&store_of(other.path(), 0..2)), "created twice");
    let limits = AppendOptions { memory_bytes: 1 << 20, threads: 2 };
    let error = Appender::open(&unfinished, limits).unwrap().append(&byte_step(2), None, &()).unwrap_err();
    assert!(error.to_string().contains("`memory` 1 MiB is too little"), "{error}");
}

#[test]
fn times_go_on_evenly_or_are_kept_one_by_one() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("s.zarr");
    let options = options(VoxelType::U8);
    let mut appender = Appender::create(&path, &byte_step(0), Some(2.0), &options, &()).unwrap();
    let axis = || Store::open(&path).unwrap().time_axis().cloned().unwrap();
    assert_eq!((axis().start, axis().step), (2.0, 1.0));
    appender.append(&byte_step(1), Some(2.5), &()).unwrap();
    appender.append(&byte_step(2), None, &()).unwrap();
    assert_eq!((axis().start, axis().step, axis().stamps), (2.0, 0.5, vec![]));
    // The source's own time, since it differs from the first step's.
    let mut late = byte_step(3);
    late.info.time = Some(TimeAxis { start: 7.0, ..TimeAxis::default() });
    appender.append(&late, None, &()).unwrap();
    assert_eq!(axis().stamps, [2.0, 2.5, 3.0, 7.0]);
    let message = appender.append(&byte_step(4), None, &()).unwrap_err().to_string();
    assert!(message.contains("not evenly spaced"), "{message}");
    let message = appender.append(&late, None, &()).unwrap_err().to_string();
    assert!(message.contains("after 7 of step 3, found 7"), "{message}");
    appender.append(&byte_step(4), Some(7.25), &()).unwrap();
    assert_steps(&Store::open(&path).unwrap(), 5, "irregular");
    assert_sound(&path, "irregular");
    // A series with unknown times stays one.
    let series = dir.path().join("series.zarr");
    pack(&Array::series(EXTENT, 2, 1, |t, p| voxel(t, 0, p) as u8), &series, &options, &()).unwrap();
    let mut appender = Appender::open(&series, few()).unwrap();
    let message = appender.append(&byte_step(2), Some(2.0), &()).unwrap_err().to_string();
    assert!(message.contains("has no times"), "{message}");
    appender.append(&byte_step(2), None, &()).unwrap();
    let store = Store::open(&series).unwrap();
    assert_eq!(store.time_axis(), None);
    assert_steps(&store, 3, "unknown times");
    assert_sound(&series, "unknown times");
}

#[test]
fn counts_that_are_missing_are_made_anew_and_damaged_ones_are_named() {
    let dir = tempfile::tempdir().unwrap();
    let path = store_of(dir.path(), 0..3);
    let expected = files(&path);
    append(&path, 3).unwrap();
    let whole = files(&path);
    write_files(&path, &expected);
    let counts = path.join("0/.brickyard/counts");
    std::fs::remove_dir_all(&counts).unwrap();
    let problems = verify(&path, |_, _| {}).unwrap().problems;
    assert!(problems.len() == 1 && problems[0].path.ends_with("counts/3"), "{problems:?}");
    append(&path, 3).unwrap();
    assert_same(&files(&path), &whole, "counted anew");
    write_files(&path, &expected);
    let file = counts.join("3/0");
    let sound = std::fs::read(&file).unwrap();
    for i in 0..sound.len() {
        let mut bad = sound.clone();
        bad[i] ^= 4;
        std::fs::write(&file, &bad).unwrap();
        if i % 40 == 0 {
            assert!(!verify(&path, |_, _| {}).unwrap().problems.is_empty(), "byte {i}");
        }
        let message = append(&path, 3).unwrap_err().to_string();
        assert!(message.contains("counts/3/0") && message.contains("damaged"), "byte {i}: {message}");
    }
    // From another store.
    let other = tempfile::tempdir().unwrap();
    let theirs = store_of(other.path(), 1..4);
    std::fs::copy(theirs.join("0/.brickyard/counts/3/0"), &file).unwrap();
    let message = append(&path, 3).unwrap_err().to_string();
    assert!(message.contains("counts/3") && message.contains("as in the root document"), "{message}");
    assert!(verify(&path, |_, _| {}).unwrap().problems[0].what.contains("counts differ"));
}

#[test]
fn arrays_may_be_one_step_ahead_and_never_behind() {
    let dir = tempfile::tempdir().unwrap();
    let path = store_of(dir.path(), 0..2);
    for dir in array_dirs(&Store::open(&path).unwrap()) {
        let document = dir.join("zarr.json");
        edit(&document, |document| document["shape"][0] = json!(3));
        // The finest level is the last one lengthened by a commit.
        if dir == path.join("0") {
            let problems = verify(&path, |_, _| {}).unwrap().problems;
            assert!(problems.len() == 1 && problems[0].what.contains("another program"), "{problems:?}");
        } else {
            assert_sound(&path, "one ahead");
        }
        edit(&document, |document| document["shape"][0] = json!(4));
        assert_eq!(Store::open(&path).unwrap().times(), 2);
        let problems = verify(&path, |_, _| {}).unwrap().problems;
        assert!(!problems.is_empty() && problems.iter().all(|problem| problem.path == document), "{problems:?}");
        edit(&document, |document| document["shape"][0] = json!(1));
        let opened = [Store::open(&path), Store::open_reduced(&path, Downsample::Max, IoMode::Mmap)];
        let messages: Vec<_> = opened.into_iter().filter_map(|opened| Some(opened.err()?.to_string())).collect();
        let is_named = |message: &String| message.contains(document.to_str().unwrap()) && message.contains("shape");
        assert!(!messages.is_empty() && messages.iter().all(is_named), "{document:?}: {messages:?}");
        edit(&document, |document| document["shape"][0] = json!(2));
    }
    for times in [json!(0), json!("2"), json!(-1), json!(4_294_967_296u64)] {
        edit(&path.join("zarr.json"), |root| root["attributes"]["brickyard"]["times"] = times);
        let message = Store::open(&path).err().unwrap().to_string();
        assert!(message.contains("attributes.brickyard"), "{message}");
    }
}

#[test]
fn steps_of_other_programs_are_named_and_never_deleted() {
    let dir = tempfile::tempdir().unwrap();
    // A store of several levels, and one of a single level.
    for (name, extent) in [("large", EXTENT), ("small", [16, 16, 16])] {
        let path = dir.path().join(name);
        let step = |step| Array::series(extent, 1, 1, |_, p| p[0] as u8 + step);
        let options = PackOptions { edge: 16, ..options(VoxelType::U8) };
        let mut appender = Appender::create(&path, &step(0), None, &options, &()).unwrap();
        appender.append(&step(1), None, &()).unwrap();
        drop(appender);
        edit(&path.join("0/zarr.json"), |document| document["shape"][0] = json!(3));
        let theirs = path.join("0/c/2/0/0/0");
        std::fs::create_dir_all(theirs.parent().unwrap()).unwrap();
        std::fs::copy(path.join("0/c/1/0/0/0"), &theirs).unwrap();
        let before = files(&path);
        let problems = verify(&path, |_, _| {}).unwrap().problems;
        assert!(problems.iter().any(|problem| problem.what.contains("another program")), "{name}: {problems:?}");
        let message = Appender::open(&path, few()).err().unwrap().to_string();
        assert!(message.contains("another program") && message.contains("0/zarr.json"), "{message}");
        assert_same(&files(&path), &before, name);
    }
}

#[test]
fn a_store_that_takes_the_path_meanwhile_is_left_alone() {
    struct Swap<'a>(&'a Path);
    impl Progress for Swap<'_> {
        fn planned(&self, _: &PackPlan) {
            std::fs::rename(self.0.join("s.zarr"), self.0.join("moved")).unwrap();
            std::fs::rename(self.0.join("other/s.zarr"), self.0.join("s.zarr")).unwrap();
        }
    }
    let dir = tempfile::tempdir().unwrap();
    std::fs::create_dir(dir.path().join("other")).unwrap();
    let (path, other) = (store_of(dir.path(), 0..2), store_of(&dir.path().join("other"), 3..8));
    let (own, theirs) = (files(&path), files(&other));
    let mut appender = Appender::open(&path, few()).unwrap();
    let error = appender.append(&byte_step(2), None, &Swap(dir.path())).unwrap_err();
    assert!(error.to_string().contains("replaced"), "{error}");
    let again = appender.append(&byte_step(2), None, &()).unwrap_err();
    assert!(again.to_string().contains("replaced"), "{again}");
    drop(appender);
    assert_same(&files(&path), &theirs, "the other store");
    // The next append rolls back the remains of the step.
    let moved = dir.path().join("moved");
    append(&moved, 2).unwrap();
    assert_steps(&Store::open(&moved).unwrap(), 3, "moved");
    assert_sound(&moved, "moved");
    assert!(own.keys().all(|name| name.to_string_lossy().contains("/counts/") || moved.join(name).exists()));
}

#[test]
fn a_first_step_whose_pack_was_cut_off_at_its_end_is_followed() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("s.zarr");
    let create = |fuse| {
        let _ = std::fs::remove_dir_all(&path);
        let disk = Trial::disk_of(fuse);
        Appender::create_on(disk, &path, &byte_step(0), None, &byte_options(), &()).err()
    };
    let is_whole = || path.join("zarr.json").exists() && path.join(JOURNAL_NAME).exists();
    let moments: Vec<i64> = (0..10_000).take_while(|&moment| create(moment).is_some()).collect();
    let mut found = 0;
    for &moment in moments.iter().rev().take(40) {
        create(moment);
        if is_whole() {
            found += 1;
            let appender = Appender::create(&path, &byte_step(1), None, &byte_options(), &()).unwrap();
            assert_eq!(appender.times(), 2);
            drop(appender);
            assert_steps(&Store::open(&path).unwrap(), 2, "followed");
            assert_sound(&path, "followed");
        }
    }
    assert!(found > 0);
}

/// Notes first, then warnings, in packing and appending alike.
#[test]
fn what_a_source_says_is_told_by_its_weight() {
    #[derive(Default)]
    struct Heard(std::sync::Mutex<Vec<String>>);
    impl Progress for Heard {
        fn note(&self, message: &str) {
            self.0.lock().unwrap().push(format!("note: {message}"));
        }
        fn warn(&self, message: &str) {
            self.0.lock().unwrap().push(format!("warning: {message}"));
        }
    }
    let said = |behind: usize| {
        let dir = tempfile::tempdir().unwrap();
        let file = dir.path().join("a.nii.gz");
        let mut header = vec![0u8; 352];
        header[..4].copy_from_slice(&348i32.to_le_bytes());
        for (at, number) in [(40, 3u16), (42, 4), (44, 4), (46, 4), (70, 2), (72, 8)] {
            header[at..at + 2].copy_from_slice(&number.to_le_bytes());
        }
        [76, 80, 84, 88].iter().for_each(|at| header[*at..at + 4].copy_from_slice(&1f32.to_le_bytes()));
        header[108..112].copy_from_slice(&352f32.to_le_bytes());
        header[344..348].copy_from_slice(b"n+1\0");
        let voxels = [header, vec![7; 64], vec![1; behind]].concat();
        let mut gzip = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
        std::io::Write::write_all(&mut gzip, &voxels).unwrap();
        std::fs::write(&file, gzip.finish().unwrap()).unwrap();
        let source = brickyard_import::open(&[file], &brickyard_import::OpenOptions::default()).unwrap();
        let (packed, appended) = (Heard::default(), Heard::default());
        let store = dir.path().join("s.zarr");
        let mut appender = Appender::create(&store, &*source, None, &byte_options(), &packed).unwrap();
        appender.append(&*source, None, &appended).unwrap();
        [packed, appended].map(|heard| heard.0.into_inner().unwrap())
    };
    for told in said(3) {
        let [note, warning] = &told[..] else { panic!("{told:?}") };
        assert!(
            note.starts_with("note: The voxels are compressed") && warning.starts_with("warning: 3 bytes"),
            "{told:?}"
        );
    }
}

#[test]
fn groups_that_gathered_the_metadata_are_named() {
    #[derive(Default)]
    struct Heard(std::sync::Mutex<Vec<String>>);
    impl Progress for Heard {
        fn warn(&self, message: &str) {
            self.0.lock().unwrap().push(message.into());
        }
    }
    let dir = tempfile::tempdir().unwrap();
    let path = store_of(dir.path(), 0..2);
    let group = dir.path().join("zarr.json");
    for (name, warnings) in [("other.zarr", 0), ("s.zarr", 1)] {
        let gathered = json!({ "zarr_format": 3, "consolidated_metadata": { "metadata": { name: {} } } });
        std::fs::write(&group, document_bytes(&gathered)).unwrap();
        let heard = Heard::default();
        let mut appender = Appender::open(&path, few()).unwrap();
        appender.append(&byte_step(appender.times()), None, &heard).unwrap();
        let heard = heard.0.into_inner().unwrap();
        assert_eq!(heard.len(), warnings, "{heard:?}");
        assert!(heard.iter().all(|warning| warning.contains("consolidate it anew")), "{heard:?}");
    }
}

#[test]
fn a_pipe_in_the_place_of_a_journal_is_refused_at_once() {
    use rustix::fs::{CWD, Mode, mkfifoat};
    let dir = tempfile::tempdir().unwrap();
    let path = store_of(dir.path(), 0..1);
    mkfifoat(CWD, path.join(JOURNAL_NAME), Mode::from_raw_mode(0o600)).unwrap();
    assert!(Appender::open(&path, few()).is_err());
    for exists in [Exists::Overwrite, Exists::Resume] {
        let options = PackOptions { exists, ..byte_options() };
        let message = pack(&byte_step(0), &path, &options, &()).unwrap_err().to_string();
        assert!(message.contains(JOURNAL_NAME), "{message}");
    }
}

#[test]
fn a_store_is_sound_while_it_grows() {
    let dir = tempfile::tempdir().unwrap();
    let path = store_of(dir.path(), 0..2);
    let before = Store::open(&path).unwrap();
    append(&path, 2).unwrap();
    let levels = || (0..before.pyramid().levels().len()).map(|level| (&before, Level(level as u8)));
    assert_eq!(written::check(&before, levels()).unwrap().problems, []);
    // Faults are still found.
    edit(&path.join("zarr.json"), |root| root["attributes"]["brickyard"]["edge"] = json!(8));
    assert!(!written::check(&before, levels()).unwrap().problems.is_empty());
}

/// The tenth step writes as many files as the third, and touches none of another step.
#[test]
fn an_append_costs_the_same_however_many_steps_there_are() {
    let dir = tempfile::tempdir().unwrap();
    let path = store_of(dir.path(), 0..2);
    let mut changes = Vec::new();
    for step in 2..12 {
        let mut appender = Appender::open(&path, few()).unwrap();
        appender.disk.trial.log.lock().unwrap().clear();
        // The same voxels each time.
        let report = appender.append(&byte_step(0), None, &()).unwrap();
        assert_eq!(report.step, step);
        let log = appender.disk.trial.log.lock().unwrap();
        changes.push(log.len());
        let of_other = |path: &PathBuf| {
            (0..step - 1).any(|other| {
                path.to_string_lossy().contains(&format!("/c/{other}/"))
                    && !path.to_string_lossy().contains(&format!("/c/{step}/"))
            })
        };
        assert!(!log.iter().any(|(_, path)| of_other(path)), "step {step}");
    }
    assert!(changes.windows(2).all(|pair| pair[0] == pair[1]), "{changes:?}");
    let id = BrickId { time: 11, channel: 0, level: Level(0), index: BrickIndex::new(1, 1, 0) };
    Store::open(&path).unwrap().occupancy(id).unwrap();
}

#[test]
fn channels_in_another_order_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    let step = |number, names: &[&str]| {
        let mut step = step_of::<u8>(number, 2);
        let name = |name: &&str| Some((*name).to_owned()).filter(|name| !name.is_empty());
        step.info.channel_looks =
            names.iter().map(|n| ChannelLook { name: name(n), ..ChannelLook::default() }).collect();
        step
    };
    let path = dir.path().join("s.zarr");
    let mut appender = Appender::create(&path, &step(0, &["DAPI", "GFP"]), None, &byte_options(), &()).unwrap();
    let message = appender.append(&step(1, &["GFP", "DAPI"]), None, &()).unwrap_err().to_string();
    assert!(message.contains("list of channels is GFP, DAPI, but in step 0"), "{message}");
    assert!(message.contains("is DAPI, GFP (write the step with these channels"), "{message}");
    // A source with less information fits.
    for (number, names) in (1..).zip([&["DAPI", "GFP"][..], &["", "GFP"], &[]]) {
        appender.append(&step(number, names), None, &()).unwrap();
    }
    // Nor may a single channel change.
    let step = |title: &str| {
        let mut step = byte_step(0);
        step.info.channel_looks = vec![ChannelLook { name: Some(title.into()), ..ChannelLook::default() }];
        step
    };
    let mut appender = Appender::create(&dir.path().join("t.zarr"), &step("GFP"), None, &byte_options(), &()).unwrap();
    let message = appender.append(&step("DAPI"), None, &()).unwrap_err().to_string();
    assert!(message.contains("list of channels is DAPI"), "{message}");
    appender.append(&step("GFP"), None, &()).unwrap();
}

/// Values in another unit are other values; without units, as in stores of former versions, nothing is known.
#[test]
fn values_and_axes_in_other_units_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    let step = |number, unit: Option<&str>, axes: [&str; 3]| {
        let mut step = step_of::<u8>(number, 1);
        step.info.channel_looks = vec![ChannelLook { unit: unit.map(str::to_owned), ..ChannelLook::default() }];
        step.info.geometry.take_units(axes);
        step
    };
    let map = ["degree", "degree", "hPa"];
    let path = dir.path().join("s.zarr");
    let mut appender = Appender::create(&path, &step(0, Some("K"), map), None, &byte_options(), &()).unwrap();
    let message = appender.append(&step(1, Some("m/s"), map), None, &()).unwrap_err().to_string();
    assert!(message.contains("unit of values is m/s") && message.contains("K"), "{message}");
    let message = appender.append(&step(1, Some("K"), ["degree", "degree", "km"]), None, &()).unwrap_err().to_string();
    assert!(message.contains("unit of length is degree, degree, kilometer"), "{message}");
    appender.append(&step(1, Some("K"), map), None, &()).unwrap();
    appender.append(&step(2, None, [""; 3]), None, &()).unwrap();
    drop(appender);
    let store = Store::open(&path).unwrap();
    assert_eq!((store.channel_displays()[0].unit.as_deref(), store.geometry().axis_unit(2)), (Some("K"), Some("hPa")));
    assert_sound(&path, "units");
    let path = dir.path().join("old.zarr");
    let mut appender = Appender::create(&path, &step(0, None, [""; 3]), None, &byte_options(), &()).unwrap();
    appender.append(&step(1, Some("K"), map), None, &()).unwrap();
    drop(appender);
    assert_eq!(Store::open(&path).unwrap().channel_displays()[0].unit, None);
}

/// The no-data value may be valid data in a step whose source declares its own: integers are refused then, floats keep
/// it as data.
#[test]
fn data_of_a_later_step_are_never_taken_for_none() {
    fn check<T: Voxel>(value: f64, is_refused: bool) {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("s.zarr");
        let step = |nodata: Option<f64>, knows_nodata, has_it: bool| {
            let mut step = Array::series(EXTENT, 1, 1, move |_, [x, y, z]: [u32; 3]| {
                T::from_f64_rounded(if has_it && x == 3 { value } else { f64::from(x + y + z) + 20.0 })
            });
            (step.info.nodata, step.info.knows_nodata) = (nodata, knows_nodata);
            step
        };
        let options = PackOptions { downsample: Downsample::Mean.into(), ..options(T::TYPE) };
        let mut appender = Appender::create(&path, &step(Some(value), false, true), None, &options, &()).unwrap();
        let appended = appender.append(&step(None, true, true), None, &());
        if is_refused {
            let message = appended.unwrap_err().to_string();
            assert!(message.contains(&format!("of {value}, which is data there")), "{message}");
            assert_eq!(appender.times(), 1);
        } else {
            appended.unwrap();
            let store = Store::open(&path).unwrap();
            let at = |time| level_voxels(&store, time, 0, Level(0))[3];
            assert!(at(0).is_nan() && at(1) == value, "{} {}", at(0), at(1));
        }
        // For floats, another value that is already left out is no conflict.
        let other = appender.append(&step(Some(value + 2.0), true, false), None, &());
        assert_eq!(other.is_err(), is_refused, "{other:?}");
        // A step without the value is accepted, and so is one whose source does not specify: its voxels with the value
        // have no data, as before.
        appender.append(&step(None, true, false), None, &()).unwrap();
        let report = appender.append(&step(None, false, true), None, &()).unwrap();
        assert_eq!(report.nodata + report.non_finite, u64::from(EXTENT[1] * EXTENT[2]));
        drop(appender);
        assert_sound(&path, T::TYPE.name());
    }
    check::<i16>(-1001.0, true);
    check::<f32>(7.5, false);
}

#[test]
fn steps_whose_voxels_may_come_in_another_order_are_refused() {
    let none = [false; 3];
    let along_y = [false, true, false];
    let step = |number, turned, flip, calibrated| {
        let mut step = byte_step(number);
        (step.info.turned, step.info.flip, step.info.calibrated) = (turned, flip, calibrated);
        step
    };
    let stored = |turned, flip, calibrated| {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("s.zarr");
        let first = step(0, turned, flip, calibrated);
        let appender = Appender::create(&path, &first, None, &byte_options(), &()).unwrap();
        (dir, appender)
    };
    // A flip is said again, or the file's order is told to be that of the store.
    let (_dir, mut flipped) = stored(none, Some(along_y), true);
    let message = flipped.append(&step(1, none, None, true), None, &()).unwrap_err().to_string();
    assert!(message.contains("its order of voxels is its file's") && message.contains("`flip` none"), "{message}");
    assert!(message.contains("pass `flip` y for a file in the order of the first one"), "{message}");
    flipped.append(&step(1, none, Some(along_y), true), None, &()).unwrap();
    flipped.append(&step(2, none, Some(none), true), None, &()).unwrap();
    assert_eq!(Store::open(flipped.path()).unwrap().info().flipped, along_y);
    assert_sound(flipped.path(), "flipped");
    // Coordinates tell each file's places; without them the order is that of the store, or unknown.
    let (_dir, mut turned) = stored(along_y, None, true);
    turned.append(&step(1, none, None, true), None, &()).unwrap();
    turned.append(&step(2, along_y, None, false), None, &()).unwrap();
    let message = turned.append(&step(3, none, None, false), None, &()).unwrap_err().to_string();
    assert!(message.contains("that of the file, but") && message.contains("turned round along y"), "{message}");
    let (_dir, mut plain) = stored(none, None, false);
    let message = plain.append(&step(1, along_y, None, true), None, &()).unwrap_err().to_string();
    assert!(message.contains("turned round along y"), "{message}");
    plain.append(&step(1, none, Some(along_y), false), None, &()).unwrap();
}

/// A source of one step with the time in its file.
struct Timed(Array<u8>, f64, Option<&'static str>);

impl Source for Timed {
    fn info(&self) -> &SourceInfo {
        self.0.info()
    }

    fn step_time(&self) -> StepTime {
        let Self(_, number, since) = *self;
        let stamp = TimeSpan { number, unit: Some("hour"), since: since.map(str::to_owned) };
        StepTime { stamp: Some(stamp), increment: None }
    }

    fn read_box(&self, time: u32, channel: u32, region: VoxelBox, out: &mut [u8]) -> Result<(), ImportError> {
        self.0.read_box(time, channel, region, out)
    }
}

#[test]
fn a_file_s_own_time_counts_where_it_counts_as_the_store_s() {
    #[derive(Default)]
    struct Heard(std::sync::Mutex<Vec<String>>);
    impl Progress for Heard {
        fn note(&self, message: &str) {
            self.0.lock().unwrap().push(message.into());
        }
    }
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("s.zarr");
    let since = Some("1900-01-01");
    let first = Timed(byte_step(0), 100.0, since);
    let mut appender = Appender::create(&path, &first, None, &byte_options(), &()).unwrap();
    let mut add = |number: f64, since, stamp| {
        let heard = Heard::default();
        let step = Timed(byte_step(appender.times()), number, since);
        appender.append(&step, stamp, &heard).map(|_| heard.0.into_inner().unwrap().join(" "))
    };
    assert_eq!(add(106.0, since, None).unwrap(), "The step's time is the file's, 106 hour since 1900-01-01.");
    // Evenly, as the store goes on: the file's time cannot be compared.
    for (number, since, words) in [
        (500.0, Some("2000-01-01"), "the store's times are in hour and count from 1900-01-01"),
        (500.0, None, "count from"),
        (501.0, None, "count from"),
    ] {
        let note = add(number, since, None).unwrap();
        assert!(note.contains("is left out") && note.contains(words) && note.contains("`stamp`"), "{note}");
    }
    // A file appended before.
    for number in [106.0, 124.0] {
        let message = add(number, since, None).unwrap_err().to_string();
        assert!(message.contains("step 5: time: expected") && message.contains("found"), "{message}");
    }
    assert_eq!(add(3.0, since, Some(131.0)).unwrap(), "");
    assert!(add(200.0, Some("2000-01-01"), None).unwrap_err().to_string().contains("`stamp` gives it"));
    assert!(add(200.0, since, None).is_ok());
    let store = Store::open(&path).unwrap();
    let axis = store.time_axis().unwrap();
    assert_eq!(axis.stamps, [100.0, 106.0, 112.0, 118.0, 124.0, 131.0, 200.0]);
    assert_eq!((axis.unit.as_deref(), axis.since.as_deref()), (Some("hour"), since));
    assert_sound(&path, "with times of files");
    // An axis of several steps, one of which is appended, counts from its own moment.
    let mut step = byte_step(7);
    step.info.time = Some(TimeAxis {
        start: 900.0,
        unit: Some("hour".into()),
        since: Some("2000-01-01".into()),
        ..TimeAxis::default()
    });
    let message = appender.append(&step, None, &()).unwrap_err().to_string();
    assert!(message.contains("one since 1900-01-01") && message.contains("found one since 2000-01-01"), "{message}");
}
