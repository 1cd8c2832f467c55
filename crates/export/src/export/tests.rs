//! Rules of every format: existing files, left-overs, memory, and refusals; and the voxels of the plain ones.

use super::*;
use crate::testing::{TestStore, bytes_of, info, pack_at, value};
use brickyard_import::SourceInfo;
use brickyard_store::ReadError;
use brickyard_volume::{Level, VoxelType};
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};

/// A name of each format.
const NAMES: [&str; 13] = [
    "a.raw",
    "a.npy",
    "a.nii",
    "a.nii.gz",
    "a.nrrd",
    "a.mha",
    "m.mhd",
    "a.vti",
    "s.pvd",
    "a.tif",
    "a.ome.tif",
    "a/",
    "a.zarr",
];

/// Whether a name is a folder's.
fn is_folder(name: &str) -> bool {
    Format::of(Path::new(name)).unwrap().is_folder()
}

fn remove(path: &Path) {
    let removed = if path.is_dir() { std::fs::remove_dir_all(path) } else { std::fs::remove_file(path) };
    removed.unwrap();
}

fn go_on(_: u64, _: u64) -> ControlFlow<()> {
    ControlFlow::Continue(())
}

/// All files in a folder, with their contents.
fn files(folder: &Path) -> Vec<(PathBuf, Vec<u8>)> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            found.push((path.clone(), Vec::new()));
            found.extend(files(&path));
        } else {
            found.push((path.clone(), std::fs::read(&path).unwrap()));
        }
    }
    found.sort();
    found
}

#[test]
fn a_cancelled_export_leaves_what_was_there() {
    let test = TestStore::of(info());
    for name in NAMES {
        let out = tempfile::tempdir().unwrap();
        let output = out.path().join(name);
        for is_there in [false, true] {
            // A folder is never replaced.
            if is_there && name == "s.pvd" {
                export(&test.store, &output, &ExportRequest::default(), go_on).unwrap();
            } else if is_there && !is_folder(name) {
                crate::paths_of(&output).unwrap().iter().for_each(|path| std::fs::write(path, "mine").unwrap());
            }
            let before = files(out.path());
            let request = ExportRequest { overwrite: true, ..ExportRequest::default() };
            // At the first part, and when only the name is missing.
            for is_last in [false, true] {
                let watch = |done, total| match is_last && done < total {
                    true => ControlFlow::Continue(()),
                    false => ControlFlow::Break(()),
                };
                let error = export(&test.store, &output, &request, watch).unwrap_err();
                assert!(matches!(error, ExportError::Cancelled { .. }), "{error}");
                assert!(files(out.path()) == before, "{name}");
            }
        }
    }
}

#[test]
fn a_store_that_is_replaced_meanwhile_is_not_exported() {
    let long = SourceInfo { extent: Extent::new(8 * 40, 8, 8 * 8), ..info() };
    // One of each way of writing.
    for name in ["a.raw", "a.nii.gz", "a/", "s.pvd", "a.zarr"] {
        let test = TestStore::of(long.clone());
        let out = tempfile::tempdir().unwrap();
        let is_first = AtomicBool::new(true);
        let replace = |_, _| {
            if is_first.swap(false, Ordering::Relaxed) {
                std::fs::remove_dir_all(test.store.path()).unwrap();
                pack_at(test.store.path(), SourceInfo { voxel_type: VoxelType::U8, ..long.clone() }, Kind::Image);
            }
            ControlFlow::Continue(())
        };
        // The rest is then read after the first part.
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        let output = out.path().join(name);
        let request = ExportRequest::default();
        let error = pool.install(|| export(&test.store, &output, &request, replace)).unwrap_err();
        assert!(matches!(error, ExportError::Read(ReadError::Replaced { .. })), "{name}: {error}");
        assert_eq!(files(out.path()), []);
    }
}

/// Parts of rows or layers give the same file; too little memory is refused with the actual minimum.
#[test]
fn the_file_is_the_same_within_any_memory() {
    let test = TestStore::of(SourceInfo { extent: Extent::new(300, 20, 19), times: 2, ..info() });
    for name in NAMES {
        let out = tempfile::tempdir().unwrap();
        let output = out.path().join(name);
        let region = Some(VoxelBox::new([3, 1, 2], [299, 20, 18]));
        let request = ExportRequest { region, overwrite: true, ..ExportRequest::default() };
        let written = |memory_bytes| {
            let written = export(&test.store, &output, &ExportRequest { memory_bytes, ..request.clone() }, go_on);
            let found = files(out.path());
            if is_folder(name) && written.is_ok() {
                std::fs::remove_dir_all(&output).unwrap();
            }
            written.map(|_| found)
        };
        let expected = written(1 << 30).unwrap();
        let least = match written(1) {
            Err(ExportError::Memory { needed_bytes, .. }) => needed_bytes,
            other => panic!("{other:?}"),
        };
        for more in [0, 2, 5, 30, 100].map(|cores| cores * test.store.core_bytes() as u64) {
            assert!(written(least + more).unwrap() == expected, "{name}: {more} bytes more");
        }
        assert!(matches!(written(least - 1), Err(ExportError::Memory { .. })));
    }
}

#[test]
fn an_export_has_the_permissions_of_any_new_file() {
    use std::os::unix::fs::PermissionsExt;
    let test = TestStore::of(info());
    let out = tempfile::tempdir().unwrap();
    let [plain, folder] = ["plain", "folder"].map(|name| out.path().join(name));
    std::fs::write(&plain, "").unwrap();
    std::fs::create_dir(&folder).unwrap();
    let mode = |path: &Path| path.metadata().unwrap().permissions().mode();
    for name in NAMES {
        let output = out.path().join(name);
        export(&test.store, &output, &ExportRequest { overwrite: true, ..Default::default() }, go_on).unwrap();
        for path in crate::paths_of(&output).unwrap() {
            assert_eq!(mode(&path), mode(if path.is_dir() { &folder } else { &plain }), "{name}");
        }
    }
    assert_eq!(mode(&out.path().join("a/0000.png")), mode(&plain));
}

/// Existing files stay, without the word for it; folders, devices and foreign descriptions always.
#[test]
fn what_is_in_the_way_is_refused_and_stays() {
    let test = TestStore::of(info());
    for name in NAMES {
        let out = tempfile::tempdir().unwrap();
        let output = out.path().join(name);
        for path in crate::paths_of(&output).unwrap() {
            let overwriting = |overwrite| {
                let request = ExportRequest { overwrite, ..ExportRequest::default() };
                export(&test.store, &output, &request, go_on).map_err(|error| error.to_string())
            };
            std::fs::write(&path, "mine").unwrap();
            let before = files(out.path());
            let found = overwriting(false).unwrap_err();
            assert!(found.contains("exists already") && found.contains("`overwrite`"), "{name}: {found}");
            assert_eq!(files(out.path()), before);
            if !is_folder(name) && path.extension().is_some() {
                overwriting(true).unwrap();
                crate::paths_of(&output).unwrap().iter().for_each(|path| remove(path));
            } else {
                std::fs::remove_file(&path).unwrap();
            }
            std::fs::create_dir(&path).unwrap();
            assert!(overwriting(false).unwrap_err().contains("exists already"));
            // An empty folder of a series is no one's.
            if !(name == "s.pvd" && path.extension().is_none()) {
                let found = overwriting(true).unwrap_err();
                assert!(found.contains("never replaced"), "{name}: {found}");
                assert_eq!(files(out.path()), [(path.components().collect(), Vec::new())]);
            }
            std::fs::remove_dir(&path).unwrap();
            std::os::unix::fs::symlink("nowhere", &path).unwrap();
            assert!(overwriting(false).unwrap_err().contains("exists already"), "{name}");
            std::fs::remove_file(&path).unwrap();
        }
        let inside = test.store.path().join(name);
        let error = export(&test.store, &inside, &ExportRequest::default(), go_on).unwrap_err();
        assert!(error.to_string().contains("inside the store"), "{name}: {error}");
    }
    let out = tempfile::tempdir().unwrap();
    std::fs::write(out.path().join("a.raw.json"), "{}").unwrap();
    let error = export(&test.store, &out.path().join("a.mhd"), &ExportRequest::default(), go_on).unwrap_err();
    assert!(error.to_string().contains("describes other voxels"), "{error}");
}

/// A series replaces a longer one whole, and never a folder with anything else.
#[test]
fn a_series_is_replaced_with_its_folder() {
    let out = tempfile::tempdir().unwrap();
    let output = out.path().join("s.pvd");
    let request = |end| ExportRequest {
        time: ExportTime::Steps { first: 0, end, stride: 1 },
        overwrite: true,
        ..ExportRequest::default()
    };
    let test = TestStore::of(SourceInfo { times: 3, ..info() });
    let names = || files(out.path()).into_iter().map(|(path, _)| path).collect::<Vec<PathBuf>>();
    let expected = |count: usize| {
        let steps = (0..count).map(|step| format!("s/s_000{step}.vti"));
        let all = ["s".to_owned()].into_iter().chain(steps).chain(["s.pvd".to_owned()]);
        all.map(|name| out.path().join(name)).collect::<Vec<PathBuf>>()
    };
    for end in [3, 2] {
        export(&test.store, &output, &request(end), go_on).unwrap();
        assert_eq!(names(), expected(end as usize));
    }
    for foreign in ["s/notes.txt", "s/s_0000.vtu", "s/t_0000.vti", "s/s_0007.vti"] {
        std::fs::write(out.path().join(foreign), "mine").unwrap();
        let before = files(out.path());
        let error = export(&test.store, &output, &request(3), go_on).unwrap_err().to_string();
        assert!(error.contains(foreign) && error.contains("never replaced"), "{error}");
        assert!(files(out.path()) == before);
        std::fs::remove_file(out.path().join(foreign)).unwrap();
    }
    // Others' file that comes during the export.
    let late = |_, _| {
        std::fs::write(out.path().join("s/late"), "mine").unwrap();
        ControlFlow::Continue(())
    };
    let error = export(&test.store, &output, &request(3), late).unwrap_err().to_string();
    assert!(error.contains("s/late"), "{error}");
    std::fs::remove_file(out.path().join("s/late")).unwrap();
    assert_eq!(names(), expected(2));
}

/// After a kill, the next export of the name takes away what was left, but for others' files.
#[test]
fn the_next_export_takes_left_overs_away() {
    let test = TestStore::of(SourceInfo { times: 2, ..info() });
    for name in NAMES {
        let out = tempfile::tempdir().unwrap();
        let output = out.path().join(name);
        let request = ExportRequest { overwrite: true, ..ExportRequest::default() };
        let left = Target::of(Format::of(&output).unwrap(), &output).data;
        match is_folder(name) || name == "s.pvd" {
            true => {
                let folder = create_folder(&left).unwrap().keep();
                for file in ["0000.png", "s_0000.vti", "packed/zarr.json", "packed/0/c/0/0/0.tmp", "chunks/0/0/1"] {
                    let file = folder.join(file);
                    std::fs::create_dir_all(file.parent().unwrap()).unwrap();
                    std::fs::write(file, "half").unwrap();
                }
            }
            false => drop(Target::of(Format::of(&output).unwrap(), &output).create().unwrap().keep().unwrap()),
        }
        assert_eq!(std::fs::read_dir(out.path()).unwrap().count(), 1, "{name}");
        export(&test.store, &output, &request, go_on).unwrap();
        let found: Vec<PathBuf> = std::fs::read_dir(out.path()).unwrap().map(|entry| entry.unwrap().path()).collect();
        assert!(!found.iter().any(|path| path.to_string_lossy().contains(".brickyard-")), "{name}: {found:?}");
    }
    let out = tempfile::tempdir().unwrap();
    let output = out.path().join("a.zarr");
    let folder = create_folder(&output).unwrap().keep();
    std::fs::create_dir(folder.join("packed")).unwrap();
    std::fs::write(folder.join("packed/notes.txt"), "mine").unwrap();
    export(&test.store, &output, &ExportRequest::default(), go_on).unwrap();
    assert_eq!(std::fs::read(folder.join("packed/notes.txt")).unwrap(), b"mine");
}

#[test]
fn refusals_leave_nothing_behind() {
    let test = TestStore::of(info());
    for name in NAMES {
        let out = tempfile::tempdir().unwrap();
        let attempt = |name: &str, request: &ExportRequest| {
            export(&test.store, &out.path().join(name), request, go_on).unwrap_err().to_string()
        };
        let request = ExportRequest::default();
        let some =
            |channels: &[u32]| ExportRequest { channels: ExportChannels::Several(channels.into()), ..request.clone() };
        let at = |time| ExportRequest { time, ..request.clone() };
        assert!(attempt("a.xyz", &request).contains(".npy, .raw or"));
        assert!(attempt(name, &ExportRequest { level: Level(9), ..request.clone() }).contains("expected 0 to 3"));
        assert!(attempt(name, &at(ExportTime::Step(1))).contains("time step 1"));
        assert!(attempt(name, &some(&[1])).contains("channel 1"));
        assert!(attempt(name, &some(&[0, 0])).contains("named twice"));
        assert!(attempt(name, &some(&[])).contains("channel none"));
        assert!(attempt(name, &at(ExportTime::Steps { first: 3, end: 3, stride: 1 })).contains("at least one"));
        let region = Some(VoxelBox::new([0, 0, 0], [38, 1, 1]));
        assert!(attempt(name, &ExportRequest { region, ..request.clone() }).contains("inside 0:37,0:20,0:19"));
        assert!(attempt(&format!("no/{name}"), &request).contains("No such file"));
        assert_eq!(files(out.path()), []);
    }
    std::fs::remove_file(test.store.path().join("0/c/1/1/1")).unwrap();
    for name in NAMES {
        let out = tempfile::tempdir().unwrap();
        let error = export(&test.store, &out.path().join(name), &ExportRequest::default(), go_on).unwrap_err();
        assert!(error.to_string().contains("missing shard"), "{name}: {error}");
        assert_eq!(files(out.path()), []);
    }
}

/// Names too long for the system are refused before a voxel is read, whichever file's they are; others are written, and replaced.
#[test]
fn too_long_names_are_refused_before_the_work() {
    let test = TestStore::of(info());
    for name in NAMES {
        let (stem, end) = name.split_at(1);
        for stem in (236..=256).map(|length| stem.repeat(length)) {
            let out = tempfile::tempdir().unwrap();
            let output = out.path().join(stem + end);
            for overwrite in [false, true] {
                let is_begun = AtomicBool::new(false);
                let begin = |_, _| {
                    is_begun.store(true, Ordering::Relaxed);
                    ControlFlow::Continue(())
                };
                let before = files(out.path());
                let request = ExportRequest { overwrite, ..ExportRequest::default() };
                if overwrite && name == "a/" {
                    continue;
                }
                if let Err(error) = export(&test.store, &output, &request, begin) {
                    let told = error.to_string();
                    assert!(told.contains("too long") && !is_begun.load(Ordering::Relaxed), "{overwrite}: {told}");
                    assert!(files(out.path()) == before);
                }
            }
        }
    }
}

#[test]
fn what_a_format_cannot_hold_is_refused_with_formats_that_can() {
    let of = |voxel_type, channels, times| TestStore::of(SourceInfo { voxel_type, channels, times, ..info() });
    let request = |store: &Store| ExportRequest {
        channels: ExportChannels::All,
        time: ExportTime::Steps { first: 0, end: store.times(), stride: 1 },
        ..ExportRequest::default()
    };
    let labels_in_floats = TestStore::of_kind(SourceInfo { voxel_type: VoxelType::F32, ..info() }, Kind::Labels);
    for (test, name, words) in [
        (of(VoxelType::F32, 1, 1), "a/", "PNG holds u8 and u16, not f32: choose .tif"),
        (of(VoxelType::I16, 1, 1), "a/", "not i16"),
        (of(VoxelType::U8, 2, 1), "a/", "one channel, not 2: choose one with `channel`"),
        (of(VoxelType::U8, 1, 3), "a/", "one time step, not 3: choose one with `time`"),
        (of(VoxelType::U8, 2, 1), "a.mha", "MetaImage holds one channel"),
        (of(VoxelType::U8, 2, 1), "a.mhd", "MetaImage holds one channel"),
        (of(VoxelType::U8, 2, 2), "a.vti", "one time step, not 2"),
        (of(VoxelType::U8, 2, 2), "a.vti", ".pvd"),
        (of(VoxelType::U8, 1, 1), "a b.mhd", "without blanks"),
        (of(VoxelType::U8, 1, 1), "a\\b.pvd", "choose one of letters"),
        (of(VoxelType::U8, 1, 1), "a.seg.nrrd", "the store is an image: choose .nrrd"),
        (labels_in_floats, "a.seg.nrrd", "the store's are floats: choose .nrrd"),
    ] {
        let out = tempfile::tempdir().unwrap();
        let error = export(&test.store, &out.path().join(name), &request(&test.store), go_on).unwrap_err();
        assert!(matches!(error, ExportError::Unfit { .. }) && error.to_string().contains(words), "{error}");
        assert_eq!(files(out.path()), []);
    }
}

#[test]
fn raw_is_the_voxels_alone() {
    let test = TestStore::of(SourceInfo { times: 2, channels: 2, ..info() });
    let output = test.folder.path().join("out.raw");
    let whole = AtomicBool::new(false);
    for level in 0..test.store.pyramid().levels().len() {
        let level = Level(level as u8);
        let (time, channels, overwrite) = (ExportTime::Step(1), ExportChannels::One(1), true);
        let request = ExportRequest { level, time, channels, overwrite, ..ExportRequest::default() };
        let watch = |done, total| {
            whole.store(done == total, Ordering::Relaxed);
            ControlFlow::Continue(())
        };
        export(&test.store, &output, &request, watch).unwrap();
        let region = test.store.pyramid().level(level).extent.full_box();
        let mut expected = vec![0; region.extent().volume() as usize * 2];
        test.store.read_box(1, 1, level, region, &mut expected).unwrap();
        assert!(std::fs::read(&output).unwrap() == expected, "level {level}");
    }
    assert!(whole.into_inner());
}

/// Voxels of a box, steps slowest, then channels.
fn expected(voxel_type: VoxelType, steps: &[u32], channels: &[u32], region: VoxelBox) -> Vec<u8> {
    let volumes = steps.iter().flat_map(|t| channels.iter().map(move |c| (*t, *c)));
    volumes.flat_map(|(t, c)| region.voxels().flat_map(move |at| bytes_of(voxel_type, value(t, c, at)))).collect()
}

#[test]
fn npy_of_a_box_reads_back() {
    let region = VoxelBox::new([3, 8, 2], [36, 17, 19]);
    for voxel_type in VoxelType::ALL {
        let test = TestStore::of(SourceInfo { voxel_type, ..info() });
        let output = test.folder.path().join("out.npy");
        export(&test.store, &output, &ExportRequest { region: Some(region), ..Default::default() }, go_on).unwrap();
        let bytes = std::fs::read(&output).unwrap();
        let header = u16::from_le_bytes([bytes[8], bytes[9]]) as usize + 10;
        assert_eq!((header % 64, bytes[header - 1]), (0, b'\n'));
        let text = std::str::from_utf8(&bytes[10..header]).unwrap();
        assert!(text.contains("'shape': (17, 9, 33)"), "{text}");
        assert!(bytes[header..] == expected(voxel_type, &[0], &[0], region), "{voxel_type}");
    }
}

#[test]
fn steps_and_channels_follow_one_another() {
    let test = TestStore::of(SourceInfo { times: 6, channels: 3, ..info() });
    let region = VoxelBox::new([3, 8, 2], [36, 17, 19]);
    let steps = |first, end, stride| ExportTime::Steps { first, end, stride };
    let of = |channels: &[u32]| ExportChannels::Several(channels.into());
    for (time, steps, channels, numbers, shape) in [
        (steps(1, 6, 2), &[1, 3, 5][..], ExportChannels::One(1), &[1][..], "(3, 17, 9, 33)"),
        (steps(0, 6, 4), &[0, 4], of(&[2, 0]), &[2, 0], "(2, 2, 17, 9, 33)"),
        (steps(2, 3, 1), &[2], ExportChannels::All, &[0, 1, 2], "(1, 3, 17, 9, 33)"),
        (ExportTime::Step(2), &[2], of(&[1]), &[1], "(1, 17, 9, 33)"),
    ] {
        let request = ExportRequest { time, channels, region: Some(region), overwrite: true, ..Default::default() };
        let expected = expected(VoxelType::U16, steps, numbers, region);
        let [raw, npy] = ["out.raw", "out.npy"].map(|name| {
            let whole = AtomicBool::new(false);
            let watch = |done, total| {
                whole.fetch_or(done == total && total == expected.len() as u64, Ordering::Relaxed);
                ControlFlow::Continue(())
            };
            export(&test.store, &test.folder.path().join(name), &request, watch).unwrap();
            assert!(whole.into_inner());
            std::fs::read(test.folder.path().join(name)).unwrap()
        });
        assert!(raw == expected, "{steps:?}");
        let header = u16::from_le_bytes([npy[8], npy[9]]) as usize + 10;
        assert!(npy[header..] == expected, "{steps:?}");
        let text = std::str::from_utf8(&npy[10..header]).unwrap();
        assert!(text.contains(&format!("'shape': {shape}")), "{text}");
    }
}
