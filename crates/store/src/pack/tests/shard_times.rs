//! Shards of several time steps: the same voxels in fewer files, and bricks of equal content stored once.

use super::*;
use crate::layout::ShardId;
use crate::pack::shards::{finishing_bytes, open_bytes};
use crate::shard::{BrickRange, Fingerprint, ShardIndex, encode_index, index_bytes};
use crate::side::{SideArray, level_arrays};
use crate::test_store::edit_page;
use std::collections::BTreeSet;

const STEPS: u32 = 5;

fn with(shard_times: u32) -> PackOptions {
    PackOptions { shard_times, downsample: mean_and_max(), aprons: 1, ..options(VoxelType::U8) }
}

/// A box moving through a constant volume of several channels.
fn moving_box(channels: u32) -> Array<u8> {
    Array::series([64, 40, 35], STEPS, channels, move |i, [x, y, z]| {
        let (time, channel) = (i / channels, i % channels);
        let is_in_box = (12 * time..12 * time + 9).contains(&x) && (22..30).contains(&y) && z < 8;
        if is_in_box { 250 - channel as u8 } else { (value([x, y, z]) as u8).wrapping_mul(channel as u8 + 1) }
    })
}

/// All cores and aprons of one pyramid of a store, brick by brick.
fn contents(path: &Path, method: Downsample) -> BTreeMap<String, (Vec<u8>, Vec<u8>)> {
    let store = Store::open_reduced(path, method, IoMode::Pread).unwrap();
    let apron = store.apron().unwrap();
    let mut contents = BTreeMap::new();
    for (time, channel) in (0..store.times()).flat_map(|t| (0..store.channels()).map(move |c| (t, c))) {
        for (k, grid) in store.pyramid().levels().iter().enumerate() {
            for index in crate::store::bricks_of(grid.bricks.full_box(), 1) {
                let id = BrickId { time, channel, level: Level(k as u8), index };
                let (mut core, mut around) = (vec![9; store.core_bytes()], vec![9; apron.voxels()]);
                store.read_core(id, &mut core).unwrap();
                store.read_apron(id, &mut around).unwrap();
                contents.insert(id.to_string(), (core, around));
            }
        }
    }
    contents
}

/// A store's pages of ranges and hashes, of both pyramids.
fn pages(path: &Path) -> Vec<Vec<u8>> {
    let mut pages = Vec::new();
    for method in [Downsample::Mean, Downsample::Max] {
        let store = Store::open_reduced(path, method, IoMode::Pread).unwrap();
        for level in (0..store.pyramid().levels().len()).map(|k| Level(k as u8)) {
            for array in &level_arrays(path, store.layout(), level, store.voxel_type())[..2] {
                pages.extend(
                    (0..array.page_count()).map(|i| array.read_page(store.folder(), array.page_at(level, i)).unwrap()),
                );
            }
        }
    }
    pages
}

/// The index of a shard's file: each entry's range.
fn ranges(path: &Path, slots: usize) -> Vec<Option<BrickRange>> {
    let file = std::fs::read(path).unwrap();
    let tail = &file[file.len() - index_bytes(slots)..];
    let index = ShardIndex::new(tail, file.len() as u64, slots, 1 << 20).unwrap();
    index.check().unwrap();
    (0..slots).map(|slot| index.range(slot).unwrap()).collect()
}

#[test]
fn however_many_steps_a_shard_has_the_voxels_are_the_same() {
    let source = moving_box(2);
    let dir = tempfile::tempdir().unwrap();
    let path = |n: u32| dir.path().join(format!("{n}.zarr"));
    let of_single_steps = plan(&source, &with(1)).unwrap().shard_count();
    for n in [1, 2, 3, 5, 7] {
        let report = pack(&source, &path(n), &with(n), &()).unwrap();
        let groups = STEPS.div_ceil(n.min(STEPS));
        assert_eq!(report.shards * u64::from(STEPS), of_single_steps * u64::from(groups));
        assert_eq!(crate::verify::verify(&path(n), |_, _| {}).unwrap().problems, [], "{n} steps");
        let store = Store::open(path(n)).unwrap();
        assert_eq!((store.info().shard_times, store.layout().shard_groups()), (n.min(STEPS), groups));
        for method in [Downsample::Mean, Downsample::Max] {
            assert!(contents(&path(n), method) == contents(&path(1), method), "{n} steps, {}", method.name());
        }
        // Side data have the same pages of bricks, and one file per group.
        assert!(pages(&path(n)) == pages(&path(1)), "{n} steps");
        for name in ["ranges", "hashes", "shards"] {
            let mut found = files(&path(n));
            found.retain(|path, _| path.to_string_lossy().contains(&format!(".brickyard/{name}/")));
            let in_chunks = found.keys().filter(|path| path.to_string_lossy().contains("/c/")).count() as u32;
            let arrays = found.len() as u32 - in_chunks;
            assert_eq!(in_chunks, arrays * groups * 2, "{n} steps: a file of {name} a group and channel");
        }
    }
    assert_same(&files(&path(5)), &files(&path(7)), "more steps than there are");
}

#[test]
fn levels_and_aprons_are_what_plain_loops_make_of_them() {
    check_pyramid(&moving_box(2), &with(3));
    check_aprons(&moving_box(1), &with(2));
    let wide = Array::series([40, 20, 35], 3, 2, |i, p| value(p) as f32 + i as f32);
    let options = PackOptions { shard_times: 2, aprons: 2, ..options(VoxelType::F32) };
    check_pyramid(&wide, &options);
    check_aprons(&wide, &options);
}

#[test]
fn bricks_of_the_same_content_are_stored_once() {
    let source = moving_box(1);
    let dir = tempfile::tempdir().unwrap();
    let path = |n: u32| dir.path().join(format!("{n}.zarr"));
    for n in [1, 3] {
        pack(&source, &path(n), &with(n), &()).unwrap();
    }
    let store = Store::open(path(3)).unwrap();
    let layout = store.layout().clone();
    let (mut of_cores, mut stored, mut kept) = (0, 0, 0);
    for (chunks, layout) in [(store.chunks().next(), layout.clone()), (store.aprons(), layout.of_aprons())] {
        let chunks = chunks.unwrap();
        for id in (0..layout.pyramid.levels().len()).flat_map(|k| layout.shards(Level(k as u8))) {
            let file = layout.shard_path(&path(3), id);
            if !file.exists() {
                continue;
            }
            let slots = layout.shard_slots(id.level);
            let ranges = ranges(&file, slots);
            let mut by_content: BTreeMap<Vec<u8>, BTreeSet<u64>> = BTreeMap::new();
            for (slot, range) in ranges.iter().enumerate().filter_map(|(slot, range)| Some((slot, range.as_ref()?))) {
                let mut content = vec![0; chunks.chunk_bytes()];
                chunks.read(layout.brick_at(id, slot).unwrap(), &mut content).unwrap();
                by_content.entry(content).or_default().insert(range.offset);
                stored += 1;
            }
            assert!(by_content.values().all(|places| places.len() == 1), "{}", file.display());
            kept += by_content.len();
            let distinct: BTreeMap<u64, u64> = ranges.iter().flatten().map(|r| (r.offset, r.length)).collect();
            assert_eq!(distinct.len(), by_content.len());
            let bytes = distinct.values().sum::<u64>() + index_bytes(slots) as u64;
            assert_eq!(std::fs::metadata(&file).unwrap().len(), bytes, "{}", file.display());
            // A group of two steps: the entries of a third one are empty.
            let of_step = layout.shard_bricks(id.level).volume() as usize;
            let last = &ranges[2 * of_step..];
            assert_eq!(last.iter().all(Option::is_none), id.group == 1, "{}", file.display());
            of_cores += (chunks.chunk_bytes() == store.core_bytes()) as u32;
        }
    }
    assert!(of_cores > 4 && kept * 2 < stored, "{kept} kept of {stored}");
    let bytes = |n: u32| {
        let files = files(&path(n)).into_iter().filter(|(path, _)| !path.to_string_lossy().contains("zarr.json"));
        files.map(|(_, bytes)| bytes.len()).sum::<usize>()
    };
    assert!(bytes(3) * 10 < bytes(1) * 6, "{} bytes, {} in shards of one step", bytes(3), bytes(1));
    assert!(files(&path(3)).len() < files(&path(1)).len());
}

/// In shards of one step, equal bricks are stored separately, as always.
#[test]
fn shards_of_one_step_share_nothing() {
    let source = Array::new([64, 16, 16], |p| p[1] as u8 + 1);
    let dir = tempfile::tempdir().unwrap();
    let store = dir.path().join("s.zarr");
    pack(&source, &store, &PackOptions { shard_edge: 64, ..options(VoxelType::U8) }, &()).unwrap();
    let ranges: BTreeSet<u64> = ranges(&store.join("0/c/0/0/0"), 4).iter().flatten().map(|r| r.offset).collect();
    assert_eq!(ranges.len(), 4);
    assert!(!String::from_utf8(std::fs::read(store.join("zarr.json")).unwrap()).unwrap().contains("shard_times"));
}

#[test]
fn output_does_not_depend_on_threads_memory_or_the_order_of_reading() {
    let mut source = moving_box(2);
    let expected = packed(&source, &PackOptions { threads: 1, ..with(2) });
    assert_same(&expected, &packed(&source, &PackOptions { threads: 4, ..with(2) }), "4 threads");
    let PackError::Memory { needed_bytes, .. } =
        plan(&source, &PackOptions { memory_bytes: 0, ..with(2) }).unwrap_err()
    else {
        panic!("no memory is too little")
    };
    assert_same(&expected, &packed(&source, &PackOptions { memory_bytes: needed_bytes, ..with(2) }), "least memory");
    source.access = Access::Planes;
    assert_same(&expected, &packed(&source, &with(2)), "planes");
}

#[test]
fn resuming_after_a_failure_at_any_write_gives_the_uninterrupted_store() {
    let source = Array::series([40, 20, 20], 3, 1, |i, p| if p[0] / 8 == i { 9 } else { value(p) as u8 + 1 });
    // Two groups: two shards of level 0, and one of each other level; the same for aprons.
    check_resuming(&source, &PackOptions { downsample: Downsample::Mean.into(), ..with(2) }, 2 * 2 * (2 + 2));
}

#[test]
fn a_shard_is_whole_or_is_made_again() {
    let source = moving_box(1);
    let fresh = with(2);
    let expected = packed(&source, &fresh);
    let dir = tempfile::tempdir().unwrap();
    for reads in [1, 40, 90, 130] {
        let store = dir.path().join(format!("{reads}.zarr"));
        source.fuse.store(reads, Ordering::Relaxed);
        let stopped = pack(&source, &store, &fresh, &()).unwrap_err();
        let PackError::Source { done, .. } = stopped else { panic!("{stopped}") };
        source.fuse.store(i64::MAX, Ordering::Relaxed);
        let report = pack(&source, &store, &PackOptions { exists: Exists::Resume, ..fresh.clone() }, &()).unwrap();
        assert_eq!(report.shards_resumed, done, "{reads}");
        assert_same(&expected, &files(&store), &format!("{reads} reads"));
    }
}

#[test]
fn the_number_of_steps_is_a_setting() {
    let source = moving_box(1);
    let settings = |n| super::settings(&source, &with(n));
    assert!(settings(1).get("shard_times").is_none(), "fingerprints of stores that there are must not change");
    assert_eq!((&settings(2)["shard_times"], settings(7)), (&serde_json::json!(2), settings(5)));
    let dir = tempfile::tempdir().unwrap();
    let store = dir.path().join("s.zarr");
    let resume = |n| pack(&source, &store, &PackOptions { exists: Exists::Resume, ..with(n) }, &());
    assert!(!resume(7).unwrap().was_complete && resume(5).unwrap().was_complete);
    for other in [1, 2] {
        assert!(matches!(resume(other), Err(PackError::Mismatch { .. })), "{other}");
    }
    let overwrite = PackOptions { exists: Exists::Overwrite, ..with(2) };
    pack(&source, &store, &overwrite, &()).unwrap();
    assert_same(&packed(&source, &with(2)), &files(&store), "after an overwrite");
}

/// Found in every brick with the damaged range, and in no other.
#[test]
fn damage_to_a_shared_range_is_found_in_every_brick_that_has_it() {
    let source = moving_box(1);
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("s.zarr");
    pack(&source, &path, &with(3), &()).unwrap();
    let layout = Store::open(&path).unwrap().layout().clone();
    let problems = || {
        let problems = crate::verify::verify(&path, |_, _| {}).unwrap().problems;
        problems.iter().map(ToString::to_string).collect::<Vec<_>>()
    };
    let id = ShardId { group: 0, channel: 0, level: Level(0), z: 1, y: 1, x: 1 };
    for layout in [layout.clone(), layout.of_aprons()] {
        let (file, slots) = (layout.shard_path(&path, id), layout.shard_slots(id.level));
        let ranges = ranges(&file, slots);
        let shared = ranges.iter().flatten().find(|range| ranges.iter().flatten().filter(|r| r == range).count() == 3);
        let shared = *shared.unwrap();
        let sound = std::fs::read(&file).unwrap();
        let mut bad = sound.clone();
        bad[shared.offset as usize + 5] ^= 1;
        std::fs::write(&file, &bad).unwrap();
        let bricks: Vec<String> = (0..slots)
            .filter(|&slot| ranges[slot] == Some(shared))
            .map(|slot| format!("{}: damaged brick", layout.brick_at(id, slot).unwrap()))
            .collect();
        let found = problems();
        assert_eq!(found.len(), 3, "{found:#?}");
        for brick in bricks {
            assert!(found.iter().any(|problem| problem.contains(&brick)), "{brick}: {found:#?}");
        }
        std::fs::write(&file, sound).unwrap();
    }
    assert_eq!(problems(), [""; 0]);
}

/// A sound index, except for a range that starts inside another, as no writer produces.
#[test]
fn ranges_that_overlap_in_part_are_found() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("s.zarr");
    pack(&moving_box(1), &path, &with(2), &()).unwrap();
    let layout = Store::open(&path).unwrap().layout().clone();
    let id = ShardId { group: 0, channel: 0, level: Level(0), z: 0, y: 0, x: 1 };
    let (file, slots) = (layout.shard_path(&path, id), layout.shard_slots(id.level));
    let mut ranges = ranges(&file, slots);
    let last = ranges.iter().rposition(Option::is_some).unwrap();
    let of_another = ranges.iter().flatten().next().copied().unwrap();
    ranges[last] = Some(BrickRange { offset: of_another.offset + 1, length: of_another.length });
    let mut bytes = std::fs::read(&file).unwrap();
    bytes.truncate(bytes.len() - index_bytes(slots));
    let (index, crc) = encode_index(&ranges);
    bytes.extend_from_slice(&index);
    std::fs::write(&file, &bytes).unwrap();
    let array = SideArray::fingerprints(&path, &layout, Level(0));
    let place = array.paging().locate([id.x, id.y, id.z]).1;
    let fingerprint = Fingerprint { file_bytes: bytes.len() as u64, index_crc: crc.into() };
    edit_page(&array, array.page_at(Level(0), 0), |bytes| {
        bytes[place * 16..][..16].copy_from_slice(bytemuck::bytes_of(&fingerprint));
    });
    let problems = crate::verify::verify(&path, |_, _| {}).unwrap().problems;
    let problems: Vec<String> = problems.iter().map(ToString::to_string).collect();
    let brick = layout.brick_at(id, last).unwrap().to_string();
    let overlap = |p: &String| p.contains("overlap partly") && p.contains(&brick);
    assert_eq!(problems.iter().filter(|p| overlap(p)).count(), 1, "{problems:#?}");
    assert!(problems.iter().any(|p| p.contains(&format!("{brick}: damaged brick"))), "{problems:#?}");
}

/// A cube for planning only, never read.
fn planned(edge: u32, times: u32, channels: u32) -> Array<u8> {
    let mut source = Array::new([1; 3], |_| 0);
    source.info = SourceInfo { extent: Extent::from_array([edge; 3]), times, channels, ..source.info };
    source
}

/// Memory of open shards is counted, and a refusal gives the sufficient amount and a fitting number of steps.
#[test]
fn memory_of_open_shards_is_counted() {
    let source = planned(256, 64, 2);
    let options = |shard_times, memory_bytes| PackOptions {
        edge: 8,
        shard_edge: 32,
        threads: 1,
        shard_times,
        memory_bytes,
        downsample: Downsample::Mean.into(),
        ..PackOptions::new(VoxelType::U8)
    };
    let refused = |shard_times, memory_bytes| match plan(&source, &options(shard_times, memory_bytes)) {
        Err(PackError::Memory { needed_bytes, advice, .. }) => (needed_bytes, advice),
        other => panic!("{other:?}"),
    };
    let needed = |shard_times| refused(shard_times, 0).0;
    // Bricks and shards of each level: 32^3 in shards of 4^3, then 16^3, 8^3, 4^3, 2^3 and 1.
    let layout = plan(&source, &options(16, 1 << 40)).unwrap().layout;
    let open = |n: u32, k: u8| open_bytes(&layout.clone().with_shard_times(n), Level(k));
    let all = |n| 2 * [512, 64, 8, 1, 1, 1].iter().zip(0..).map(|(shards, k)| shards * open(n, k)).sum::<u64>();
    let layer = [64, 16, 4, 1, 1, 1].iter().zip(0..).map(|(shards, k)| shards * open(1, k)).sum::<u64>();
    let finishing = |n: u32| finishing_bytes(&layout.clone().with_shard_times(n), Level(0));
    // Pages of 20 bytes a brick wait for those of the other steps; one file of hashes is joined at a time.
    let pages = [(8, 4096), (1, 4096), (1, 512), (1, 64), (1, 8), (1, 1)];
    let waiting = 2 * pages.map(|(pages, cells)| pages * (cells * 20 + 256)).iter().sum::<u64>() + 4096 * 16 + 128;
    let side = |n: u32| needed(n) - finishing(n) - if n > 1 { n as u64 * waiting } else { 0 };
    assert_eq!(side(16) - side(1), all(16) - layer);
    assert_eq!(side(64) - side(16), all(64) - all(16));
    // 24 bytes a brick of 64 steps and 2 channels, and at most 40 of a hash table.
    let bricks = 64 * 2 * (32768 + 4096 + 512 + 64 + 8 + 1);
    assert!((bricks * 24..bricks * 64).contains(&all(64)), "{} bytes of {bricks}", all(64));
    let (_, advice) = refused(64, needed(64) - 1);
    assert!(advice.starts_with(", or put fewer time steps in a shard (`shard_times` 32)"), "{advice}");
    let (_, advice) = refused(100, needed(10));
    assert!(advice.starts_with(", or put fewer time steps in a shard (`shard_times` 8)"), "{advice}");
    assert!(!refused(1, 0).1.contains("shard_times"));
    assert!(plan(&source, &options(8, needed(8))).is_ok());
}

#[test]
fn too_many_or_no_steps_in_a_shard_are_refused() {
    let source = planned(1024, 1000, 1);
    let with = |shard_times| PackOptions {
        edge: 8,
        shard_edge: 512,
        shard_times,
        memory_bytes: 1 << 50,
        ..PackOptions::new(VoxelType::U8)
    };
    let refused = |n| match plan(&source, &with(n)) {
        Err(PackError::Options(problem)) => problem,
        other => panic!("{other:?}"),
    };
    assert!(refused(0).contains("`shard_times` 0: expected at least one"), "{}", refused(0));
    assert!(refused(9).contains("`shard_times` 9: expected at most 8, as a shard has 262144 bricks"), "{}", refused(9));
    assert_eq!(plan(&source, &with(8)).unwrap().layout.shard_groups(), 125);
    let all_steps_there_can_be = PackOptions { shard_edge: 8192, ..with(u32::MAX) };
    assert!(matches!(plan(&planned(2048, 1 << 29, 1), &all_steps_there_can_be), Err(PackError::Options(_))));
    assert!(plan(&source, &PackOptions { shard_edge: 64, ..with(9999) }).is_ok(), "512 bricks, 1000 steps");
}
