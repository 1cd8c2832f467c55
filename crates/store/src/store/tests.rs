use super::*;
use crate::codec::Codec;
use crate::test_store::{TestStore, bumps};
use serde_json::{Value, json};

fn written(spec: &TestStore) -> tempfile::TempDir {
    let dir = tempfile::tempdir().unwrap();
    spec.write(dir.path(), bumps);
    dir
}

/// Covers all voxels, levels, types, codecs and I/O modes, odd extents, steps and channels.
#[test]
fn stores_read_back_bit_for_bit() {
    for voxel_type in VoxelType::ALL {
        for (codec, times, channels, shard_times) in
            [(Codec::default_for(voxel_type), 2, 3, 1), (Codec::None, 1, 1, 1), (Codec::None, 3, 2, 2)]
        {
            let spec = TestStore { voxel_type, codec, times, channels, shard_times, ..TestStore::default() };
            let dir = written(&spec);
            for mode in [IoMode::Mmap, IoMode::Pread] {
                let store = Store::open_with(dir.path(), mode).unwrap();
                assert_eq!((store.layout(), store.geometry()), (&spec.layout(), &spec.geometry()));
                for (t, c) in (0..times).flat_map(|t| (0..channels).map(move |c| (t, c))) {
                    for (k, expected) in spec.levels(|v| bumps(t, c, v)).iter().enumerate() {
                        let expected: Vec<u8> = expected.iter().flat_map(|v| spec.bytes_of(*v)).collect();
                        let level = Level(k as u8);
                        let mut found = vec![1; expected.len()];
                        let whole = store.pyramid().level(level).extent.full_box();
                        store.read_box(t, c, level, whole, &mut found).unwrap();
                        assert!(found == expected, "{voxel_type} {codec} t{t} c{c} level {k}");
                    }
                }
            }
        }
    }
}

/// A shard lost while open affects only its own bricks.
#[test]
fn files_that_change_while_open_are_damaged_bricks() {
    let spec = TestStore { codec: Codec::None, ..TestStore::default() };
    let (first, other) = (BrickIndex::new(0, 0, 2), BrickIndex::new(2, 0, 0));
    let id = |index| BrickId { time: 0, channel: 0, level: Level(0), index };
    for mode in [IoMode::Mmap, IoMode::Pread] {
        let dir = written(&spec);
        let store = Store::open_with(dir.path(), mode).unwrap();
        let mut core = vec![0; store.core_bytes()];
        for index in [first, other] {
            store.read_core(id(index), &mut core).unwrap();
        }
        let path = store.layout().shard_path(dir.path(), store.layout().shard_of(id(first)).0);
        let file = std::fs::OpenOptions::new().write(true).open(&path).unwrap();
        std::os::unix::fs::FileExt::write_all_at(&file, &[1, 2, 3], 5).unwrap();
        let found = store.read_core(id(first), &mut core);
        assert!(matches!(&found, Err(ReadError::CorruptBrick { .. })), "{mode:?}: {found:?}");
        for bytes in [100, 0] {
            file.set_len(bytes).unwrap();
            let found = store.read_core(id(first), &mut core);
            let message = found.as_ref().expect_err("most of the brick is gone").to_string();
            assert!(message.contains(path.to_str().unwrap()), "{mode:?}: {message}");
            assert!(
                matches!(found, Err(ReadError::Rewritten { what: "bytes", found, .. }) if found == bytes)
                    || mode == IoMode::Pread,
                "{message}"
            );
        }
        std::fs::remove_file(&path).unwrap();
        assert!(store.read_core(id(first), &mut core).is_err(), "{mode:?}");
        store.read_core(id(other), &mut core).unwrap();
    }
}

#[test]
fn boxes_across_bricks_are_cut_right() {
    let spec = TestStore::default();
    let dir = written(&spec);
    let store = Store::open(dir.path()).unwrap();
    let region = VoxelBox::new([5, 7, 8], [37, 9, 17]);
    let expected: Vec<u8> = crate::test_store::voxels(region).flat_map(|v| spec.bytes_of(bumps(0, 0, v))).collect();
    let mut found = vec![0; expected.len()];
    store.read_box(0, 0, Level(0), region, &mut found).unwrap();
    assert!(found == expected);
    store.read_box(0, 0, Level(0), VoxelBox::new([4, 4, 4], [4, 9, 9]), &mut []).unwrap();
}

#[test]
fn empty_bricks_are_not_stored_and_read_as_zero() {
    let dir = written(&TestStore::default());
    let store = Store::open(dir.path()).unwrap();
    let id = |x| BrickId { time: 0, channel: 0, level: Level(0), index: BrickIndex::new(x, 0, 0) };
    assert_eq!([0, 1, 2].map(|x| store.is_stored(id(x)).unwrap()), [false, false, true]);
    let mut core = vec![9; store.core_bytes()];
    store.read_core(id(0), &mut core).unwrap();
    assert!(core.iter().all(|&b| b == 0));
    assert_eq!(store.minmax(id(0)).unwrap(), Some((0.0, 0.0)));
    // Its apron reaches into the next brick.
    let zero = store.occupancy_bins(0).mask(0.0, 0.0);
    assert_eq!([0, 1].map(|x| store.occupancy(id(x)).unwrap() == zero), [true, false]);
}

#[test]
fn advice_about_anything_is_harmless() {
    let dir = written(&TestStore::default());
    let store = Store::open(dir.path()).unwrap();
    let id = |x, level| BrickId { time: 0, channel: 0, level: Level(level), index: BrickIndex::new(x, 2, 1) };
    store.advise(&[id(1, 0), id(0, 0), id(4, 0), id(99, 0), id(0, 9), id(1, 0)]);
    std::fs::remove_dir_all(dir.path().join("0/c")).unwrap();
    Store::open(dir.path()).unwrap().advise(&[id(0, 0)]);
}

/// Contract: any damaged byte in a shard makes some read fail with a message naming the file.
#[test]
fn every_damaged_byte_of_a_shard_is_found() {
    for (voxel_type, codec) in [(VoxelType::U8, Codec::Zstd(1)), (VoxelType::U16, Codec::ShuffleZstd(1))] {
        let spec = TestStore { extent: [29, 8, 8], voxel_type, codec, ..TestStore::default() };
        let dir = written(&spec);
        let path = dir.path().join("0/c/0/0/1");
        let sound = std::fs::read(&path).unwrap();
        for i in 0..sound.len() {
            let mut bad = sound.clone();
            bad[i] ^= 0x10;
            std::fs::write(&path, bad).unwrap();
            let store = Store::open(dir.path()).unwrap();
            let mut voxels = vec![0; 29 * 8 * 8 * voxel_type.bytes()];
            let error = store.read_box(0, 0, Level(0), VoxelBox::new([0; 3], [29, 8, 8]), &mut voxels).unwrap_err();
            assert!(error.to_string().contains("0/c/0/0/1"), "byte {i}: {error}");
        }
        for n in [0, 1, sound.len() / 2, sound.len() - 1] {
            std::fs::write(&path, &sound[..n]).unwrap();
            let store = Store::open(dir.path()).unwrap();
            let id = BrickId { time: 0, channel: 0, level: Level(0), index: BrickIndex::new(2, 0, 0) };
            let error = store.read_core(id, &mut vec![0; store.core_bytes()]).unwrap_err();
            assert!(matches!(error, ReadError::Rewritten { .. }), "cut to {n}: {error}");
        }
    }
}

/// A replaced store stays readable while its files exist, and is never confused with its successor.
#[test]
fn a_store_that_is_replaced_is_never_mixed_with_the_other() {
    let brighter = |t: u32, c: u32, v: [u32; 3]| bumps(t, c, v) + 100.0;
    for mode in [IoMode::Mmap, IoMode::Pread] {
        let parent = tempfile::tempdir().unwrap();
        let [path, old, new] = ["s.zarr", "old.zarr", "new.zarr"].map(|name| parent.path().join(name));
        let spec = TestStore::default();
        for (path, value) in [(&path, bumps as fn(_, _, _) -> f64), (&new, brighter)] {
            std::fs::create_dir(path).unwrap();
            spec.write(path, value);
        }
        let [read, unread] = [0, 1].map(|_| Store::open_with(&path, mode).unwrap());
        let id = BrickId { time: 0, channel: 0, level: Level(0), index: BrickIndex::new(2, 1, 1) };
        let core = |store: &Store| {
            let mut core = vec![0; store.core_bytes()];
            store.read_core(id, &mut core).map(|()| core)
        };
        let [before, of_new] = [&path, &new].map(|path| core(&Store::open(path).unwrap()).unwrap());
        assert!(before != of_new && core(&read).unwrap() == before);
        std::fs::rename(&path, &old).unwrap();
        assert!(unread.is_replaced() && core(&unread).unwrap() == before, "moved away");
        std::fs::rename(&new, &path).unwrap();
        let late = unread.reduced(Downsample::Mean).unwrap();
        assert!(core(&late).unwrap() == before && late.minmax(id).unwrap() == read.minmax(id).unwrap());
        let untouched = unread.reduced(Downsample::Mean).unwrap();
        std::fs::remove_dir_all(&old).unwrap();
        let is_replaced =
            |error: ReadError| assert!(matches!(&error, ReadError::Replaced { store } if *store == path), "{error}");
        is_replaced(core(&untouched).unwrap_err());
        is_replaced(untouched.occupancy(id).err().unwrap());
        is_replaced(untouched.read_hashes(untouched.pyramid().page_of(id).0).err().unwrap());
        let is_gone = |error: OpenError| assert!(matches!(error, OpenError::Replaced { .. }), "{error}");
        is_gone(untouched.reduced(Downsample::Mean).err().unwrap());
        is_gone(untouched.newer().err().unwrap());
        assert!(core(&Store::open_with(&path, mode).unwrap()).unwrap() == of_new);
    }
}

#[test]
fn missing_and_replaced_shards_are_told_apart() {
    let dir = written(&TestStore::default());
    let path = dir.path().join("0/c/1/0/1");
    let id = BrickId { time: 0, channel: 0, level: Level(0), index: BrickIndex::new(2, 0, 2) };
    let read = || {
        let store = Store::open(dir.path()).unwrap();
        store.read_core(id, &mut vec![0; store.core_bytes()]).map_err(|e| e.to_string())
    };
    read().unwrap();
    // A sound shard of the same length, but a different one.
    let other = std::fs::read(&path).unwrap();
    let (body, index) = other.split_at(other.len() - crate::shard::index_bytes(8));
    let index = crate::shard::ShardIndex::new(index, other.len() as u64, 8, 1 << 20).unwrap();
    let mut ranges: Vec<_> = (0..8).map(|slot| index.range(slot).unwrap()).collect();
    ranges.reverse();
    std::fs::write(&path, [body, &crate::shard::encode_index(&ranges).0].concat()).unwrap();
    assert!(read().unwrap_err().contains("rewritten"));
    std::fs::remove_file(&path).unwrap();
    let message = read().unwrap_err();
    assert!(message.contains("missing shard") && message.contains("0/c/1/0/1"), "{message}");
}

#[test]
fn what_is_not_a_finished_store_says_what_it_is() {
    let dir = tempfile::tempdir().unwrap();
    let open = |path: &Path| Store::open(path).err().unwrap();
    assert!(matches!(open(dir.path()), OpenError::NotAStore { .. }));
    assert!(matches!(open(&dir.path().join("nowhere")), OpenError::Io { .. }));
    let file = dir.path().join("file");
    std::fs::write(&file, "x").unwrap();
    assert!(matches!(open(&file), OpenError::NotAStore { .. }));
    std::fs::write(dir.path().join(JOURNAL_NAME), "{\"shards\": 4}\nx\n").unwrap();
    assert!(matches!(open(dir.path()), OpenError::Incomplete { percent: 25, .. }));
    std::fs::write(dir.path().join("zarr.json"), "{\"zarr_format\": 3, \"attributes\": {\"ome\": {}}}").unwrap();
    assert!(matches!(open(dir.path()), OpenError::Unsupported { .. }));
    std::fs::write(dir.path().join("zarr.json"), "{").unwrap();
    assert!(matches!(open(dir.path()), OpenError::Invalid { .. }));
}

/// Each contradiction in the metadata is refused with a message naming the field.
#[test]
fn contradictions_name_their_field() {
    let dir = written(&TestStore { times: 3, shard_times: 2, ..TestStore::default() });
    let cases: [(&str, &str, Value, &str); 23] = [
        ("zarr.json", "/attributes/brickyard/version", json!(3), "version 3"),
        ("zarr.json", "/attributes/brickyard/version", json!(1), "pack it anew"),
        ("zarr.json", "/attributes/brickyard/edge", json!(0), "edge"),
        ("zarr.json", "/attributes/brickyard/edge", json!(16), "datasets"),
        ("zarr.json", "/attributes/brickyard/shard", json!(0), "shard"),
        ("zarr.json", "/attributes/brickyard/shard_times", json!(0), "shard_times: expected 1 to 3"),
        ("zarr.json", "/attributes/brickyard/shard_times", json!(4), "shard_times: expected 1 to 3"),
        ("zarr.json", "/attributes/brickyard/shard_times", json!(1), "chunk_grid"),
        ("zarr.json", "/attributes/brickyard/codec", json!("lzma:3"), "lzma"),
        ("zarr.json", "/attributes/brickyard/codec", json!("zstd:3"), "codecs"),
        ("zarr.json", "/attributes/brickyard/voxel_type", json!("u8"), "data_type"),
        ("zarr.json", "/attributes/brickyard/spacing", json!([1, 1, 0]), "spacing"),
        ("zarr.json", "/attributes/brickyard/spacing", json!([1, 1, 9]), "datasets"),
        ("zarr.json", "/attributes/brickyard/channels", json!([]), "channels"),
        ("zarr.json", "/attributes/brickyard/complete", json!(false), "incomplete"),
        ("zarr.json", "/attributes/ome/multiscales/0/axes/0/name", json!("q"), "axes"),
        (
            "zarr.json",
            "/attributes/ome/multiscales/0/datasets/1/coordinateTransformations/0/scale/3",
            json!(7),
            "datasets[1]",
        ),
        ("0/zarr.json", "/shape/3", json!(-4), "shape"),
        ("0/zarr.json", "/shape", json!([4294967295u32, 4294967295u32, 4294967295u32, 4294967295u32]), "shape"),
        ("0/zarr.json", "/shape/3", json!(4294967295u32), "datasets"),
        ("1/zarr.json", "/shape/3", json!(3), "shape"),
        ("1/.brickyard/ranges/zarr.json", "/shape/4", json!(5), "shape"),
        ("1/.brickyard/hashes/zarr.json", "/data_type", json!("int64"), "data_type"),
    ];
    for (file, pointer, value, named) in cases {
        let path = dir.path().join(file);
        let sound = std::fs::read(&path).unwrap();
        let mut document: Value = serde_json::from_slice(&sound).unwrap();
        *document.pointer_mut(pointer).unwrap() = value.clone();
        std::fs::write(&path, document.to_string()).unwrap();
        let message = Store::open(dir.path()).err().unwrap().to_string();
        assert!(message.contains(named) && message.contains("tmp"), "{pointer}: {message}");
        std::fs::write(&path, sound).unwrap();
    }
}

/// Opening reads no side data: damage there shows on access, with the page's name.
#[test]
fn damaged_side_data_are_named_when_they_are_read() {
    let dir = written(&TestStore { times: 2, ..TestStore::default() });
    for (file, what) in [("ranges", 7), ("shards", 9)] {
        let path = dir.path().join("0/.brickyard").join(file).join("c/1/0/0/0/0/0");
        let sound = std::fs::read(&path).unwrap();
        let mut bad = sound.clone();
        bad[what] ^= 1;
        let cut = sound[..3].to_vec();
        for (bad, named) in [(bad, "checksum"), (cut, "shorter than its checksum"), (vec![0; 1 << 20], "larger than")] {
            std::fs::write(&path, bad).unwrap();
            let store = Store::open(dir.path()).unwrap();
            let id = |time| BrickId { time, channel: 0, level: Level(0), index: BrickIndex::new(3, 1, 1) };
            let read = |time| match file {
                "ranges" => store.occupancy(id(time)).map(drop),
                _ => store.read_core(id(time), &mut vec![0; store.core_bytes()]),
            };
            read(0).unwrap();
            let message = read(1).unwrap_err().to_string();
            assert!(message.contains(path.to_str().unwrap()) && message.contains(named), "{message}");
        }
        std::fs::write(&path, sound).unwrap();
    }
}

/// 134 million bricks, and a million time steps: opening reads only the documents, the only files here.
#[test]
fn opening_takes_the_same_memory_whatever_the_size() {
    const CHILD: &str = "BRICKYARD_TEST_OPEN";
    let Some(path) = std::env::var_os(CHILD).map(PathBuf::from) else {
        for (edge, times) in [(32768, 1), (64, 1_000_000)] {
            let dir = tempfile::tempdir().unwrap();
            let spec = TestStore { extent: [edge; 3], times, edge: 64, shard: 512, ..TestStore::default() };
            spec.write_documents(dir.path());
            let name = "store::tests::opening_takes_the_same_memory_whatever_the_size";
            let child = std::process::Command::new(std::env::current_exe().unwrap())
                .args(["--exact", name, "--nocapture"])
                .env(CHILD, dir.path())
                .output();
            let child = child.unwrap();
            assert!(child.status.success(), "{}", String::from_utf8_lossy(&child.stderr));
        }
        return;
    };
    let anonymous_kib = || -> u64 {
        let status = std::fs::read_to_string("/proc/self/status").unwrap();
        let line = status.lines().find(|line| line.starts_with("RssAnon:")).unwrap();
        line.split_whitespace().nth(1).unwrap().parse().unwrap()
    };
    let before = anonymous_kib();
    let store = Store::open(path).unwrap();
    let after = anonymous_kib();
    assert!(after - before < 4 << 10, "{before} KiB before, {after} KiB after");
    // At most 8 MiB of ranges, 4 of indexes, 1 of fingerprints.
    assert!(store.cache_bytes() < 14 << 20);
}

/// More shards than stay open at a time, forwards and backwards.
#[test]
fn any_number_of_shards_can_be_read() {
    let spec = TestStore {
        extent: [8 * 600, 2, 2],
        shard: 8,
        voxel_type: VoxelType::U8,
        codec: Codec::Zstd(1),
        ..TestStore::default()
    };
    let dir = written(&spec);
    let maps = || std::fs::read_to_string("/proc/self/maps").unwrap().matches(dir.path().to_str().unwrap()).count();
    let store = Store::open(dir.path()).unwrap();
    let mut core = vec![0; store.core_bytes()];
    for x in (0..600).chain((0..600).rev()) {
        let id = BrickId { time: 0, channel: 0, level: Level(0), index: BrickIndex::new(x, 0, 0) };
        store.advise(&[id]);
        store.read_core(id, &mut core).unwrap();
        let expected = spec.bytes_of(bumps(0, 0, [8 * x + 5, 1, 1]));
        assert_eq!(core[5 + 8 + 64..][..1], expected);
    }
    assert!((1..=512).contains(&maps()), "{} maps", maps());
    drop(store);
    assert_eq!(maps(), 0);
}

#[test]
fn keys_of_other_tools_are_left_alone() {
    let dir = written(&TestStore::default());
    let path = dir.path().join("zarr.json");
    let mut document: Value = serde_json::from_slice(&std::fs::read(&path).unwrap()).unwrap();
    document["attributes"]["brickyard"]["later"] = json!(1);
    document["consolidated_metadata"] = json!(null);
    std::fs::write(&path, document.to_string()).unwrap();
    assert_eq!(Store::open(dir.path()).unwrap().pyramid().level(Level(0)).extent, Extent::new(37, 20, 19));
}
