//! Stores that another program wrote into, indexed, against stores packed from the same voxels.

use super::*;
use crate::append::Appender;
use crate::metadata::document_bytes;
use crate::pack::tests::{Array, files, mean_and_max, options, value};
use crate::pack::{PackOptions, pack};
use crate::verify::verify;
use brickyard_volume::{ChannelLook, VoxelBox, VoxelType};
use serde_json::{Value, json};
use std::collections::BTreeMap;

/// Shards have 32 voxels along each axis.
const EXTENT: [u32; 3] = [70, 40, 20];

fn first(i: u32, [x, y, z]: [u32; 3]) -> u8 {
    if (32..64).contains(&x) && y < 32 { 0 } else { (value([x, y, z]) as u32 + i + 1) as u8 }
}

/// Voxels that another program writes: one shard of zeros, one where there was none, and four of other values.
fn rewritten(i: u32, [x, y, z]: [u32; 3]) -> u8 {
    match (x / 32, y / 32) {
        (0, 0) => 0,
        (1, 0) => 7,
        _ if z > 12 => 255 - first(i, [x, y, z]),
        _ => first(i, [x, y, z]),
    }
}

fn packed(path: &Path, times: u32, voxel: fn(u32, [u32; 3]) -> u8) {
    let mut source = Array::series(EXTENT, times, 2, voxel);
    source.info.nodata = Some(3.0);
    let packing = PackOptions { downsample: mean_and_max(), aprons: 1, ..options(VoxelType::U8) };
    pack(&source, path, &packing, &()).unwrap();
}

/// Gives a store the shards of level 0 of another one, as a program does that writes these voxels.
fn write_into(path: &Path, voxels_of: &Path) {
    let is_shard = |file: &PathBuf| file.starts_with("0/c");
    for file in files(path).keys().filter(|file| is_shard(file)) {
        std::fs::remove_file(path.join(file)).unwrap();
    }
    for (file, bytes) in files(voxels_of).into_iter().filter(|(file, _)| is_shard(file)) {
        std::fs::create_dir_all(path.join(&file).parent().unwrap()).unwrap();
        std::fs::write(path.join(file), bytes).unwrap();
    }
}

fn indexed(path: &Path) -> Result<IndexReport, RemakeError> {
    index_own(&Disk::default(), path, &|_, _| ControlFlow::Continue(()))
}

/// Files of a store but its root document, and the latter without the marks of its settings.
fn with_root(path: &Path) -> (BTreeMap<PathBuf, Vec<u8>>, Value) {
    let mut files = files(path);
    let root = files.remove(Path::new("zarr.json")).unwrap();
    let mut root: Value = serde_json::from_slice(&root).unwrap();
    for key in ["checksum", "settings_fingerprint"] {
        root["attributes"]["brickyard"].as_object_mut().unwrap().remove(key);
    }
    (files, root)
}

/// Bricks of one volume that hold other voxels afterwards.
fn changed(i: u32) -> u64 {
    let bricks = VoxelBox::new([0; 3], EXTENT.map(|n| n.div_ceil(16)));
    let is_changed = |brick: &[u32; 3]| {
        let max = std::array::from_fn(|a| (16 * brick[a] + 16).min(EXTENT[a]));
        VoxelBox::new(brick.map(|n| 16 * n), max).voxels().any(|p| first(i, p) != rewritten(i, p))
    };
    bricks.voxels().filter(is_changed).count() as u64
}

fn fingerprint(path: &Path) -> String {
    Store::open(path).unwrap().info().settings_fingerprint.clone()
}

#[test]
fn a_store_written_into_becomes_one_packed_so() {
    for times in [1, 3] {
        let folder = tempfile::tempdir().unwrap();
        let [path, expected] = ["s.zarr", "t.zarr"].map(|name| folder.path().join(name));
        packed(&path, times, first);
        packed(&expected, times, rewritten);
        write_into(&path, &expected);
        assert!(!verify(&path, |_, _| {}).unwrap().problems.is_empty());
        let before = fingerprint(&path);
        let report = indexed(&path).unwrap();
        assert_ne!(fingerprint(&path), before, "a resumed pack of the former voxels does not know it");
        let volumes = u64::from(times) * 2;
        let bricks = (0..volumes as u32).map(changed).sum();
        assert_eq!(report.changes, Some(Changes { bricks, lost_shards: volumes }));
        let [found, expected] = [&path, &expected].map(|path| with_root(path));
        assert!(found.0 == expected.0, "{times}: other files");
        assert_eq!(found.1, expected.1, "{times}");
        assert_eq!(verify(&path, |_, _| {}).unwrap().problems, vec![]);
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 2, "nothing is left beside it");
    }
}

#[test]
fn a_store_as_packed_stays_so() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("s.zarr");
    packed(&path, 1, first);
    let before = files(&path);
    assert_eq!(indexed(&path).unwrap().changes, Some(Changes::default()));
    assert!(files(&path) == before);
}

/// Coarse levels written by another program are made again; looks given by users stay, also in a store with appended steps.
#[test]
fn looks_and_steps_stay() {
    let folder = tempfile::tempdir().unwrap();
    let [path, expected] = ["s.zarr", "t.zarr"].map(|name| folder.path().join(name));
    for (path, voxel) in [(&path, first as fn(u32, [u32; 3]) -> u8), (&expected, rewritten)] {
        let mut source = Array::series(EXTENT, 1, 1, voxel);
        source.info.channel_looks = vec![ChannelLook { window: Some([1.0, 99.0]), ..ChannelLook::default() }];
        let mut appender = Appender::create(path, &source, Some(0.0), &options(VoxelType::U8), &()).unwrap();
        appender.append(&source, None, &()).unwrap();
    }
    for path in [&path, &expected] {
        let mut root: Value = serde_json::from_slice(&files(path)[Path::new("zarr.json")]).unwrap();
        root["attributes"]["ome"]["omero"]["channels"][0]["label"] = json!("theirs");
        root["attributes"]["theirs"] = json!([1]);
        std::fs::write(path.join("zarr.json"), document_bytes(&root)).unwrap();
    }
    write_into(&path, &expected);
    std::fs::remove_file(path.join("1/c/0/0/0/0")).unwrap();
    indexed(&path).unwrap();
    let [found, expected] = [&path, &expected].map(|path| with_root(path));
    assert!(found.0 == expected.0);
    assert_eq!(found.1, expected.1);
    let mut appender = Appender::open(&path, AppendOptions { memory_bytes: 1 << 30, threads: 2 }).unwrap();
    appender.append(&Array::series(EXTENT, 1, 1, first), None, &()).unwrap();
    drop(appender);
    assert_eq!(verify(&path, |_, _| {}).unwrap().problems, vec![]);
}

#[test]
fn a_store_that_cannot_be_indexed_stays() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("s.zarr");
    packed(&path, 1, first);
    let before = files(&path);
    let stopped = index_own(&Disk::default(), &path, &|_, _| ControlFlow::Break(())).unwrap_err();
    assert!(matches!(stopped, RemakeError::Cancelled { .. }), "{stopped}");
    assert!(files(folder.path()).len() == before.len() && files(&path) == before);
    // Another program writes meanwhile, where nothing is read.
    let other = path.join("0/c/0/0/1/7");
    let write = |_, _| {
        std::fs::write(&other, "x").unwrap();
        ControlFlow::Continue(())
    };
    let stopped = index_own(&Disk::default(), &path, &write).unwrap_err().to_string();
    assert!(stopped.contains("wrote into it meanwhile"), "{stopped}");
    std::fs::remove_file(&other).unwrap();
    assert!(files(folder.path()).len() == before.len() && files(&path) == before);
    let shard = path.join("0/c/0/0/1/1");
    // A damaged brick.
    let mut bytes = std::fs::read(&shard).unwrap();
    bytes[5] ^= 1;
    std::fs::write(&shard, &bytes).unwrap();
    let damaged = files(&path);
    let message = indexed(&path).unwrap_err().to_string();
    assert!(message.contains("the store is unchanged"), "{message}");
    assert!(files(&path) == damaged);
    std::fs::remove_file(&shard).unwrap();
    // Another name of an axis, and another spacing, which may be damage.
    let document = path.join("0/zarr.json");
    let text = std::fs::read_to_string(&document).unwrap();
    std::fs::write(&document, text.replace("\"x\"", "\"w\"")).unwrap();
    assert!(indexed(&path).is_err());
    std::fs::write(&document, &text).unwrap();
    assert!(indexed(&PathBuf::from(format!("{}::0", path.display()))).is_err());
    let mut root: Value = serde_json::from_slice(&files(&path)[Path::new("zarr.json")]).unwrap();
    root["attributes"]["brickyard"]["spacing"] = json!([1.0, 1.0, 7.0]);
    std::fs::write(path.join("zarr.json"), document_bytes(&root)).unwrap();
    assert!(indexed(&path).is_err());
    assert!(files(folder.path()).len() == before.len() - 1);
}

#[test]
fn a_private_store_stays_so() {
    use std::os::unix::fs::PermissionsExt;
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("s.zarr");
    packed(&path, 1, first);
    std::fs::set_permissions(&path, std::fs::Permissions::from_mode(0o700)).unwrap();
    indexed(&path).unwrap();
    assert_eq!(path.metadata().unwrap().permissions().mode() & 0o777, 0o700);
}
