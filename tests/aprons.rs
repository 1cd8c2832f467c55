//! Stores packed with aprons: the same padded bricks and pictures as from stores without, and no brick decoded for a
//! neighbour's sake.

use brickyard::backend::{BackendChoice, CompositorChoice};
use brickyard::pager::{BrickSource, PaddedReader, RamCache};
use brickyard::stats::BrickCounts;
use brickyard::store::{PackOptions, Store};
use brickyard::volume::{BrickId, BrickIndex, Extent, Geometry, Level, LevelPolicy, Scene, Voxel};
use brickyard_tests::{FunctionSource, Sandbox, TestStore, session, settled};
use std::os::unix::fs::FileExt;
use std::path::Path;
use std::sync::Arc;

/// Bricks of 16^3, many of them partial.
const ODD: Extent = Extent::new(100, 37, 211);

/// Waves with noise, and an empty corner.
fn value(channel: u32, [x, y, z]: [u32; 3]) -> f64 {
    let noise = (x.wrapping_mul(73_856_093) ^ y.wrapping_mul(19_349_663) ^ z.wrapping_mul(83_492_791)) >> 7 & 7;
    if x < 40 && z < 90 { 0.0 } else { (x / 2 + y + z / 4 + noise + 5 * channel) as f64 }
}

fn store_with<T: Voxel>(aprons: u32, function: impl Fn(u32, [u32; 3]) -> T + Send + Sync) -> TestStore {
    let source = FunctionSource::series(ODD, Geometry::default(), 1, 2, |_, channel, v| function(channel, v));
    TestStore::pack_with(&source, PackOptions { edge: 16, aprons, ..PackOptions::new(T::TYPE) })
}

/// All bricks of the second channel, level by level.
fn bricks(store: &Store) -> Vec<BrickId> {
    let levels = store.pyramid().levels().iter().enumerate();
    let of_level = |(k, grid): (usize, &brickyard::volume::LevelGrid)| {
        let Extent { x, y, .. } = grid.bricks;
        let index = move |i: u32| BrickIndex::new(i % x, i / x % y, i / x / y);
        let id = move |i| BrickId { time: 0, channel: 1, level: Level(k as u8), index: index(i) };
        (0..grid.bricks.volume() as u32).map(id)
    };
    levels.flat_map(of_level).collect()
}

fn padded(store: &Arc<Store>, apron: u32) -> (Vec<Vec<u8>>, u64) {
    let cache = RamCache::new(store.clone() as Arc<dyn BrickSource>, apron, 1 << 20).expect("a brick fits");
    let cache = Arc::new(cache);
    let mut reader = PaddedReader::new(cache.clone());
    let read = |id: &BrickId| {
        let mut out = vec![0xEE; reader.padded_bytes()];
        reader.read(*id, &mut out).expect("the store is sound");
        out
    };
    let bricks = bricks(store).iter().map(read).collect();
    (bricks, cache.counters().decoded)
}

fn check<T: Voxel>(aprons: u32, function: fn(f64) -> T) {
    let make = |aprons| store_with(aprons, move |c, v| function(value(c, v)));
    let (with, without) = (make(aprons), make(0));
    for apron in 1..=2 {
        let (found, decoded) = padded(&with.store, apron);
        let (expected, _) = padded(&without.store, apron);
        assert!(found == expected, "{}: {apron} of {aprons} stored", T::TYPE);
        assert!(apron > aprons || decoded == expected.len() as u64, "{decoded} of {}", expected.len());
    }
}

#[test]
fn padded_bricks_are_the_same_from_stored_aprons_as_from_neighbours() {
    check(1, |v| v as u8);
    check(2, |v| (v as i32 - 60) as i8);
    check(1, |v| (v * 400.0) as u16);
    check(2, |v| (v * 300.0 - 20000.0) as i16);
    check(2, |v| (v * 1e7) as u32);
    check(1, |v| (v * 1e7 - 1e9) as i32);
    check(2, |v| if v as u32 % 11 == 3 { f32::NAN } else { (v * 0.37) as f32 });
}

/// A scene with everything visible at the finest level.
fn scene() -> Scene {
    let transfer = brickyard::volume::TransferFunction {
        color: vec![[0.0, 0.9, 0.1, 0.4], [255.0, 0.2, 0.8, 0.2]],
        opacity: vec![[0.0, 0.001], [255.0, 0.03]],
        unit_distance: 1.0,
        ..brickyard::volume::TransferFunction::default()
    };
    Scene { level: LevelPolicy::Locked(0), ..Scene::of(transfer) }
}

#[test]
fn pictures_are_the_same_and_no_brick_is_decoded_for_a_neighbour() {
    let size = (97, 75);
    let picture = |aprons| {
        let test = store_with(aprons, |c, v| value(c, v) as u8);
        let way = (BackendChoice::Cpu, CompositorChoice::Raycast);
        let mut session = session(&test.store, way).expect("the CPU is there");
        let levels = test.store.pyramid().levels();
        (settled(&mut session, &scene(), size), levels[1..].iter().map(|level| level.bricks.volume()).sum::<u64>())
    };
    let (((without, from_neighbours), _), ((with, stored), coarse)) = (picture(0), picture(1));
    assert!(with == without, "not the same picture, bit for bit");
    let shown = |bricks: BrickCounts| [bricks.wanted, bricks.resident, bricks.failed, bricks.unreadable];
    assert_eq!((shown(stored.bricks), stored.bricks.reuploaded), (shown(from_neighbours.bricks), 0));
    // 18^3 voxels for each brick read: its core and its apron. Those wanted came once; the number of coarser stand-ins
    // meanwhile depends on timing.
    let (bricks, rest) = (stored.bytes.decoded / (18 * 18 * 18), stored.bytes.decoded % (18 * 18 * 18));
    let most = stored.bricks.wanted + coarse;
    assert!(
        rest == 0 && (stored.bricks.wanted..=most).contains(&bricks),
        "{bricks} of at most {most}, and {rest} bytes"
    );
}

#[test]
fn a_damaged_apron_is_reported_and_drawn_around() {
    let size = (97, 75);
    let test = store_with(1, |c, v| value(c, v) as u8);
    // The first apron of channel 0.
    let path = test.path().join("0/.brickyard/aprons/c/0/0/0/0/0");
    damage(&path, 20);
    let way = (BackendChoice::Cpu, CompositorChoice::Raycast);
    let mut damaged = session(&test.store, way).expect("the CPU is there");
    let (picture, stats) = settled(&mut damaged, &scene(), size);
    // The brick itself is sound, so nothing wanted is missing, and its neighbours' voxels are the apron's.
    let bricks = stats.bricks;
    assert_eq!((stats.completeness, bricks.failed, bricks.unreadable), (1.0, 0, 1), "{stats:?}");
    let sound = store_with(1, |c, v| value(c, v) as u8);
    let (expected, stats) = settled(&mut session(&sound.store, way).expect("the CPU is there"), &scene(), size);
    assert!(picture == expected && stats.bricks.unreadable == 0);
    let sandbox = Sandbox::default();
    let store = test.path().display().to_string();
    let (code, stdout, _) = sandbox.run(&format!("verify {store} --progress none"));
    assert_eq!((code, stdout.lines().count()), (5, 1), "{stdout}");
    assert!(stdout.contains("0/.brickyard/aprons/c/0/0/0/0/0: t0 c0 level 0 brick (") && stdout.contains("checksum"));
}

fn damage(path: &Path, at: u64) {
    let file = std::fs::OpenOptions::new().read(true).write(true).open(path).expect("it is there");
    let mut byte = [0];
    file.read_exact_at(&mut byte, at).expect("the file is longer");
    file.write_all_at(&[!byte[0]], at).expect("it is ours");
}
