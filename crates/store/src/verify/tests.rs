use super::*;
use crate::codec::{BrickCodec, Codec};
use crate::metadata::document_bytes;
use crate::scratch::Scratch;
use crate::shard::{BrickRange, encode_index, index_bytes};
use crate::shard_file::IoMode;
use crate::test_store::{TestStore, bumps, edit_page};
use brickyard_volume::VoxelType;

/// Damage after shards were opened is a problem, too.
#[test]
fn what_cannot_be_read_any_more_is_a_problem() {
    for mode in [IoMode::Mmap, IoMode::Pread] {
        let dir = tempfile::tempdir().unwrap();
        TestStore { codec: Codec::None, ..TestStore::default() }.write(dir.path(), bumps);
        let views = [Store::open_with(dir.path(), mode).unwrap()];
        let verifier = Verifier::new(&views, &|_, _| {}, 256);
        let mut report = verifier.check_shards().unwrap();
        assert_eq!(report.problems, []);
        let harmed = ["0/c/0/1/1", "0/c/1/0/1", "1/c/0/0/0"].map(|name| dir.path().join(name));
        // A file that only loses its name still exists for those with it open.
        for path in &harmed {
            std::fs::File::options().write(true).open(path).unwrap().set_len(100).unwrap();
        }
        verifier.check_bricks::<u16>(&mut report);
        let mut paths: Vec<_> = report.problems.iter().map(|problem| problem.path.clone()).collect();
        paths.sort();
        assert_eq!(paths, harmed, "{mode:?}: {:#?}", report.problems);
    }
}

/// Unopenable from the start, though the file exists.
#[test]
fn what_cannot_be_opened_is_a_problem() {
    let dir = tempfile::tempdir().unwrap();
    TestStore::default().write(dir.path(), bumps);
    let path = dir.path().join("1/c/0/0/0");
    std::fs::remove_file(&path).unwrap();
    std::os::unix::fs::symlink(&path, &path).unwrap();
    let found = problems(dir.path());
    assert!(found.len() == 1 && found[0].contains("1/c/0/0/0: Too many levels"), "{found:#?}");
}

fn problems(path: &Path) -> Vec<String> {
    verify(path, |_, _| {}).unwrap().problems.iter().map(VerifyProblem::to_string).collect()
}

#[test]
fn sound_stores_have_no_problem() {
    for (voxel_type, times, channels, shard_times) in
        [(VoxelType::U8, 1, 1, 1), (VoxelType::I16, 2, 3, 1), (VoxelType::U32, 3, 2, 2), (VoxelType::F32, 3, 1, 3)]
    {
        let codec = Codec::default_for(voxel_type);
        let spec = TestStore { voxel_type, codec, times, channels, shard_times, ..TestStore::default() };
        let dir = tempfile::tempdir().unwrap();
        spec.write(dir.path(), bumps);
        assert_eq!(problems(dir.path()), [""; 0], "{voxel_type}");
    }
}

#[test]
fn anisotropic_and_non_finite_stores_have_no_problem() {
    let spec = TestStore {
        extent: [33, 40, 17],
        spacing: [1.0, 1.0, 2.5],
        voxel_type: VoxelType::F32,
        ..TestStore::default()
    };
    let dir = tempfile::tempdir().unwrap();
    spec.write(dir.path(), |t, c, [x, y, z]| match (x * y + z) % 13 {
        _ if x > 20 && y > 10 => f64::NAN,
        0 => f64::NAN,
        1 => f64::INFINITY,
        2 => f64::NEG_INFINITY,
        _ => bumps(t, c, [x, y, z]) * 0.37 - 5.0,
    });
    assert_eq!(problems(dir.path()), [""; 0]);
}

#[test]
fn stores_wider_than_a_block_and_mostly_empty_are_checked_across_blocks() {
    let spec =
        TestStore { extent: [530, 9, 9], voxel_type: VoxelType::U8, codec: Codec::Zstd(1), ..TestStore::default() };
    let dir = tempfile::tempdir().unwrap();
    spec.write(dir.path(), |_, _, [x, y, _]| if x == 255 && y == 3 { 200.0 } else { 0.0 });
    let report = verify(dir.path(), |done, total| assert!(done <= total)).unwrap();
    assert_eq!((report.problems, report.shards), (vec![], 5));
}

#[test]
fn little_memory_takes_smaller_blocks_and_then_fewer_threads() {
    let spec = TestStore { extent: [300, 70, 40], voxel_type: VoxelType::F32, ..TestStore::default() };
    let dir = tempfile::tempdir().unwrap();
    spec.write(dir.path(), bumps);
    let views = [Store::open(dir.path()).unwrap()];
    let chosen = |bytes| block_edge(&views, bytes, 4);
    assert_eq!(chosen(1 << 40).unwrap(), (256, 4));
    let Err(VerifyError::Memory { needed_bytes: least, .. }) = chosen(1) else { panic!("one byte is too little") };
    assert_eq!(chosen(least).unwrap(), (8, 1));
    assert!(chosen(least - 1).is_err());
    let report = verify(dir.path(), |_, _| {}).unwrap();
    let mut before = (256, 4);
    for bytes in (least..4 * least).rev().step_by(1 << 20) {
        let now = chosen(bytes).unwrap();
        assert!(now.0 <= before.0 && now.1 <= before.1, "less memory took more: {now:?} after {before:?}");
        before = now;
    }
    for bytes in [least, 2 * least] {
        assert_eq!(verify_within(dir.path(), bytes, |_, _| {}).unwrap(), report);
    }
}

#[test]
fn damaged_bricks_are_all_named() {
    let dir = tempfile::tempdir().unwrap();
    TestStore::default().write(dir.path(), bumps);
    for (file, at) in [("0/c/1/0/1", 20), ("0/c/0/0/2", 9), ("1/c/0/0/0", 40)] {
        let path = dir.path().join(file);
        let mut bytes = std::fs::read(&path).unwrap();
        bytes[at] ^= 1;
        std::fs::write(&path, bytes).unwrap();
    }
    let found = problems(dir.path());
    assert_eq!(found.len(), 3, "{found:#?}");
    for (problem, named) in
        found.iter().zip(["level 0 brick (4,0,0)", "level 0 brick (2,0,2)", "level 1 brick (1,0,0)"])
    {
        assert!(problem.contains(named) && problem.contains("checksum"), "{problem}");
    }
}

#[test]
fn damaged_and_missing_shards_are_named_once() {
    let dir = tempfile::tempdir().unwrap();
    TestStore::default().write(dir.path(), bumps);
    std::fs::remove_file(dir.path().join("0/c/1/0/1")).unwrap();
    let path = dir.path().join("0/c/0/1/1");
    let mut bytes = std::fs::read(&path).unwrap();
    let last = bytes.len() - 9;
    bytes[last] ^= 1;
    std::fs::write(&path, bytes).unwrap();
    std::fs::write(dir.path().join("0/c/0/0/0"), "stray").unwrap();
    let found = problems(dir.path());
    assert_eq!(found.len(), 3, "{found:#?}");
    assert!(found[0].contains("0/c/0/0/0: unexpected file: the shard was packed without one"), "{}", found[0]);
    assert!(found[1].contains("0/c/0/1/1: damaged shard index"), "{}", found[1]);
    assert!(found[2].contains("0/c/1/0/1: missing shard"), "{}", found[2]);
}

/// A brick replaced by another, with sound checksums and fingerprints: only its meaning is wrong.
#[test]
fn wrong_voxels_with_right_checksums_are_found() {
    let dir = tempfile::tempdir().unwrap();
    let spec = TestStore { extent: [16, 8, 8], ..TestStore::default() };
    spec.write(dir.path(), |_, _, [x, y, z]| (1 + x + y + z) as f64);
    let path = dir.path().join("1/c/0/0/0");
    let codec = BrickCodec::new(spec.codec, spec.voxel_type, spec.edge);
    let core: Vec<u8> = (0..512u16).flat_map(|i| (5 + i % 3).to_le_bytes()).collect();
    let mut file = Vec::new();
    codec.encode(&mut Scratch::default(), &core, &mut file);
    let (index, crc) = encode_index(&[Some(BrickRange { offset: 0, length: file.len() as u64 })]);
    file.extend_from_slice(&index);
    assert_eq!(index.len(), index_bytes(1));
    std::fs::write(&path, &file).unwrap();
    let array = SideArray::fingerprints(dir.path(), &spec.layout(), Level(1));
    let fingerprint = crate::shard::Fingerprint { file_bytes: file.len() as u64, index_crc: crc.into() };
    edit_page(&array, array.page_at(Level(1), 0), |bytes| bytes.copy_from_slice(bytemuck::bytes_of(&fingerprint)));
    let found = problems(dir.path());
    assert!(
        found.iter().any(|p| p.contains("level 1 brick (0,0,0): ") && p.contains("differ from the mean")),
        "{found:#?}"
    );
}

#[test]
fn damaged_and_missing_pages_are_named_once() {
    let dir = tempfile::tempdir().unwrap();
    TestStore { times: 2, ..TestStore::default() }.write(dir.path(), bumps);
    let page = |array: &str| dir.path().join("0/.brickyard").join(array).join("c/1/0/0/0/0/0");
    for array in ["ranges", "hashes", "shards"] {
        let mut bytes = std::fs::read(page(array)).unwrap();
        bytes[5] ^= 1;
        std::fs::write(page(array), bytes).unwrap();
    }
    std::fs::remove_file(dir.path().join("1/.brickyard/hashes/c/0/0/0/0/0/0")).unwrap();
    let found = problems(dir.path());
    assert_eq!(found.len(), 4, "{found:#?}");
    for (problem, named) in found.iter().zip(["ranges", "hashes", "shards", "1/.brickyard/hashes/c/0"]) {
        assert!(problem.contains(named), "{problem}");
    }
}

#[test]
fn wrong_statistics_are_found() {
    let dir = tempfile::tempdir().unwrap();
    let spec = TestStore::default();
    spec.write(dir.path(), bumps);
    let [ranges, hashes, _] = level_arrays(dir.path(), &spec.layout(), Level(0), spec.voxel_type);
    let page = ranges.page_at(Level(0), 0);
    // Four voxels of two bytes per brick, five bricks in a row, three rows.
    edit_page(&ranges, page, |bytes| {
        bytes[7 * 8 + 6] ^= 1;
        bytes[9 * 8] ^= 1;
    });
    edit_page(&hashes, page, |bytes| bytes[11 * 16] ^= 1);
    let root = dir.path().join("zarr.json");
    let mut document: serde_json::Value = serde_json::from_slice(&std::fs::read(&root).unwrap()).unwrap();
    document["attributes"]["brickyard"]["channels"][0]["percentiles"]["95"] = serde_json::json!(3.5);
    std::fs::write(&root, document_bytes(&document)).unwrap();
    let found = problems(dir.path()).join("\n");
    assert!(found.contains("level 0 brick (2,1,0): range of the core and its surroundings: expected"), "{found}");
    assert!(found.contains("level 0 brick (4,1,0): range of the core: expected"), "{found}");
    assert!(found.contains("level 0 brick (1,2,0): hashes: expected"), "{found}");
    assert!(found.contains("channels[0]: percentiles: expected"), "{found}");
}

/// A few documents can claim any number of files.
#[test]
fn a_store_that_claims_more_than_it_has_is_not_looked_at_to_its_end() {
    let dir = tempfile::tempdir().unwrap();
    let spec = TestStore { extent: [32768; 3], edge: 64, shard: 512, ..TestStore::default() };
    spec.write_documents(dir.path());
    let report = verify(dir.path(), |_, _| {}).unwrap();
    assert!(report.is_cut_short && report.problems.len() == MOST_PROBLEMS, "{}", report.problems.len());
    let missing = &report.problems[0];
    assert!(missing.path.starts_with(dir.path().join("0/.brickyard/ranges")), "{missing}");
}
