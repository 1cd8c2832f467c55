//! Bricks and statistics of foreign images, beside those of the same voxels in a packed store.

use super::*;
use crate::level_source::LevelSource;
use crate::pack::{PackOptions, pack};
use crate::store::Store;
use brickyard_import::{ImageLevel, ImportError, Presentation, SaidKind};
use brickyard_volume::{BrickIndex, Extent, Level, with_voxel_type};
use glam::DVec3;
use std::sync::{Condvar, Mutex};

/// Hashed voxels with runs of no data, in two steps and channels.
struct Hashed {
    info: SourceInfo,
}

impl Hashed {
    fn new(voxel_type: VoxelType, extent: Extent, nodata: Option<f64>) -> Self {
        let info = SourceInfo {
            times: 2,
            channels: 2,
            nodata,
            geometry: Geometry { spacing: DVec3::new(1.0, 1.0, 1.7), ..Geometry::default() },
            calibrated: true,
            identity: format!("hashed {voxel_type} {extent} {}", std::process::id()),
            ..SourceInfo::of_volume(extent, voxel_type)
        };
        Self { info }
    }
}

impl Source for Hashed {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    fn read_box(&self, time: u32, channel: u32, region: VoxelBox, out: &mut [u8]) -> Result<(), ImportError> {
        let value = |[x, y, z]: [u32; 3]| {
            let place = u64::from(x / 3) + 1000 * u64::from(y / 5) + 1_000_000 * u64::from(z) + 7 * u64::from(time);
            ((place + 13 * u64::from(channel)).wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 57) as f64
        };
        with_voxel_type!(self.info.voxel_type, T => {
            for (place, out) in region.voxels().zip(out.chunks_exact_mut(size_of::<T>())) {
                out.copy_from_slice(&(value(place) as T).to_le_bytes());
            }
        });
        Ok(())
    }
}

/// A source whose boxes are read only so many times, and wait for more.
struct Gated {
    inner: Hashed,
    left: Mutex<u32>,
    more: Condvar,
}

impl Gated {
    fn allow(&self, reads: u32) {
        *self.left.lock().unwrap() = reads;
        self.more.notify_all();
    }
}

impl Source for Gated {
    fn info(&self) -> &SourceInfo {
        self.inner.info()
    }

    fn read_box(&self, time: u32, channel: u32, region: VoxelBox, out: &mut [u8]) -> Result<(), ImportError> {
        *self.more.wait_while(self.left.lock().unwrap(), |left| *left == 0).unwrap() -= 1;
        self.inner.read_box(time, channel, region, out)
    }
}

fn image(sources: Vec<Arc<dyn Source>>) -> Image {
    let finest = sources[0].info().extent.to_array();
    let level = |source: Arc<dyn Source>| {
        let coarse = source.info().extent.to_array();
        let factor = DVec3::from_array([0, 1, 2].map(|axis| f64::from(finest[axis]) / f64::from(coarse[axis])));
        ImageLevel { source, factor, folder: "no such folder".into() }
    };
    Image { levels: sources.into_iter().map(level).collect(), presentation: Presentation::default() }
}

fn opened(sources: Vec<Arc<dyn Source>>) -> Store {
    let foreign = Foreign::of(Path::new("a.zarr"), image(sources), SystemTime::now()).unwrap();
    Store::of_foreign(foreign, None).unwrap()
}

/// The voxels of a whole level.
fn level_of(store: &Store, time: u32, channel: u32, level: Level) -> Vec<u8> {
    let whole = store.pyramid().level(level).extent.full_box();
    let mut out = vec![0; whole.extent().volume() as usize * store.voxel_type().bytes()];
    store.read_box(time, channel, level, whole, &mut out).unwrap();
    out
}

fn packed(source: &dyn Source, folder: &Path) -> Arc<Store> {
    let path = folder.join("packed.zarr");
    pack(source, &path, &PackOptions::new(source.info().voxel_type), &()).unwrap();
    Arc::new(Store::open(path).unwrap())
}

/// A level of a packed store as another program's array, possibly cut by a voxel.
fn own_level(store: &Arc<Store>, level: Level, extent: Extent) -> Arc<dyn Source> {
    let grid = store.pyramid().level(level);
    let (spacing, origin) = store.geometry().level_placement(grid.factor);
    let info = SourceInfo {
        times: store.times(),
        channels: store.channels(),
        geometry: Geometry { spacing, origin, ..Geometry::default() },
        ..SourceInfo::of_volume(extent, store.voxel_type())
    };
    Arc::new(LevelSource::new(store.clone(), level, info))
}

#[test]
fn levels_made_from_the_finest_are_a_packed_store_s() {
    for voxel_type in VoxelType::ALL {
        for nodata in [None, Some(3.0)] {
            let folder = tempfile::tempdir().unwrap();
            let source = Hashed::new(voxel_type, Extent::new(150, 67, 66), nodata);
            let store = packed(&source, folder.path());
            let foreign = opened(vec![Arc::new(source)]);
            assert_eq!(foreign.pyramid(), store.pyramid());
            assert!(foreign.pyramid().levels().len() == 3 && foreign.is_foreign());
            for level in store.layout().levels() {
                for (time, channel) in [(0, 0), (1, 1)] {
                    let [found, expected] = [&foreign, &*store].map(|store| level_of(store, time, channel, level));
                    assert!(found == expected, "{voxel_type} {nodata:?} level {level}");
                }
            }
        }
    }
}

/// Arrays rounded down end a voxel early: the last one repeats. A step by four is bridged.
#[test]
fn own_levels_are_used_and_gaps_bridged() {
    let folder = tempfile::tempdir().unwrap();
    let source = Hashed::new(VoxelType::U16, Extent::new(300, 131, 67), None);
    let store = packed(&source, folder.path());
    let level_1 = store.pyramid().level(Level(1)).extent;
    assert_eq!(level_1, Extent::new(150, 66, 67));
    let cut = Extent::new(150, 65, 67);
    let foreign = opened(vec![Arc::new(Hashed { info: source.info.clone() }), own_level(&store, Level(1), cut)]);
    assert_eq!(foreign.pyramid(), store.pyramid());
    let [found, expected] = [&foreign, &*store].map(|store| level_of(store, 1, 0, Level(1)));
    let rows = |voxels: &[u8]| voxels.chunks(300).map(<[u8]>::to_vec).collect::<Vec<_>>();
    for (i, (found, expected)) in rows(&found).iter().zip(rows(&expected)).enumerate() {
        let expected = if i % 66 == 65 { rows(&expected_before(&store, i))[0].clone() } else { expected };
        assert!(*found == expected, "row {i}");
    }
    // Level 2 alone: level 1 is made on the way to it.
    let whole = store.pyramid().level(Level(2)).extent;
    let foreign = opened(vec![Arc::new(Hashed { info: source.info.clone() }), own_level(&store, Level(2), whole)]);
    for level in [Level(1), Level(2), Level(3)] {
        let [found, expected] = [&foreign, &*store].map(|store| level_of(store, 0, 1, level));
        assert!(found == expected, "level {level}");
    }
}

/// The row before row `i` of level 1.
fn expected_before(store: &Store, i: usize) -> Vec<u8> {
    let (y, z) = ((i % 66 - 1) as u32, (i / 66) as u32);
    let mut row = vec![0; 300];
    let region = VoxelBox::new([0, y, z], [150, y + 1, z + 1]);
    store.read_box(1, 0, Level(1), region, &mut row).unwrap();
    row
}

/// Thirds, and levels of another type, are passed over with a note.
#[test]
fn unusable_levels_are_named() {
    let finest = || Hashed::new(VoxelType::U8, Extent::new(90, 90, 90), None);
    let other = |voxel_type, n| -> Arc<dyn Source> { Arc::new(Hashed::new(voxel_type, Extent::new(n, n, n), None)) };
    let foreign = opened(vec![Arc::new(finest()), other(VoxelType::U8, 30), other(VoxelType::U16, 45)]);
    assert_eq!(foreign.pyramid(), opened(vec![Arc::new(finest())]).pyramid());
    let note = foreign.notes()[0].to_string();
    assert!(note.contains("30 x 30 x 30, 45 x 45 x 45"), "{note}");
}

#[test]
fn a_sample_s_statistics_bound_nothing() {
    // One step, all voxels read: exact.
    let mut whole = Hashed::new(VoxelType::F32, Extent::new(40, 30, 20), None);
    whole.info.times = 1;
    let store = opened(vec![Arc::new(whole)]);
    assert!(store.has_exact_statistics() && !store.has_non_finite());
    assert_eq!(store.channel_range(0), (0.0, 126.0));
    // The second step is unread.
    let store = opened(vec![Arc::new(Hashed::new(VoxelType::F32, Extent::new(40, 30, 20), None))]);
    assert!(!store.has_exact_statistics() && store.has_non_finite());
    assert_eq!(store.channel_range(1), VoxelType::F32.limits());
    assert_eq!(store.info().channels[1].range, [0.0, 126.0]);
    let id = BrickId { time: 1, channel: 0, level: Level(0), index: BrickIndex::default() };
    assert!(store.minmax(id).unwrap() == Some(VoxelType::F32.limits()) && store.may_have_label(0, 9));
}

/// Zero but for the first chunk's voxels.
struct Corner {
    info: SourceInfo,
}

impl Source for Corner {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    fn piece(&self) -> Option<Extent> {
        Some(Extent::new(64, 64, 64))
    }

    fn read_box(&self, _: u32, _: u32, region: VoxelBox, out: &mut [u8]) -> Result<(), ImportError> {
        let is_first = |place: [u32; 3]| place.iter().all(|at| *at < 64);
        region.voxels().zip(out).for_each(|(place, out)| *out = if is_first(place) { place[0] as u8 } else { 0 });
        Ok(())
    }
}

#[test]
fn an_object_in_a_corner_is_sampled() {
    let info = SourceInfo { calibrated: true, ..SourceInfo::of_volume(Extent::new(640, 640, 640), VoxelType::U8) };
    let store = opened(vec![Arc::new(Corner { info })]);
    assert!(!store.has_exact_statistics());
    assert_eq!(store.info().channels[0].range, [0.0, 63.0]);
}

#[test]
fn labels_are_reduced_by_mode() {
    let mut source = Hashed::new(VoxelType::U32, Extent::new(100, 40, 40), None);
    source.info.kind = SaidKind::Labels("image-label");
    let store = opened(vec![Arc::new(source)]);
    assert_eq!((store.info().kind, store.downsample()), (Kind::Labels, Downsample::Mode));
    assert!(store.reduced(Downsample::Max).is_err());
}

#[test]
fn an_index_has_a_packed_store_s_ranges_and_statistics() {
    for voxel_type in VoxelType::ALL {
        for nodata in [None, Some(3.0)] {
            let folder = tempfile::tempdir().unwrap();
            let source = Hashed::new(voxel_type, Extent::new(150, 67, 66), nodata);
            let store = packed(&source, folder.path());
            let foreign = Foreign::of(Path::new("a.zarr"), image(vec![Arc::new(source)]), SystemTime::now()).unwrap();
            let go_on = |_, _| std::ops::ControlFlow::Continue(());
            let index = with_voxel_type!(voxel_type, T => index::make::<T>(&foreign, &go_on)).unwrap();
            for (found, expected) in index.channels.iter().zip(&store.info().channels) {
                assert!((found.mean - expected.mean).abs() < 1e-9 * expected.mean, "sums differ in their order alone");
                assert_eq!(ChannelStatistics { mean: expected.mean, ..found.clone() }, *expected, "{voxel_type}");
            }
            for (level, time, channel) in store.layout().levels().flat_map(|l| [(l, 0, 1), (l, 1, 0)]) {
                for index_of in store.pyramid().level(level).bricks.full_box().voxels() {
                    let id = BrickId { time, channel, level, index: BrickIndex::from_array(index_of) };
                    assert_eq!(index.core(store.pyramid(), id), store.minmax(id).unwrap(), "{voxel_type} {id}");
                    // A voxel around a brick lies in the bricks around it.
                    let bins = store.occupancy_bins(channel);
                    let (low, high) = index.around(store.pyramid(), id).unwrap();
                    let all = bins.mask(low, high);
                    assert!(store.occupancy(id).unwrap().union(all) == all, "{voxel_type} {id}");
                }
            }
        }
    }
}

#[test]
fn making_tells_the_bricks_read_and_to_be_read() {
    let inner = Hashed::new(VoxelType::U8, Extent::new(260, 130, 70), None);
    let gated = Arc::new(Gated { inner, left: Mutex::new(u32::MAX), more: Condvar::new() });
    let store = opened(vec![gated.clone()]);
    let of_step = 5 * 3 * 2;
    let root = |store: &Store| BrickId {
        time: 1,
        channel: 0,
        level: store.layout().levels().last().unwrap(),
        index: BrickIndex::default(),
    };
    assert_eq!(store.making(), None);
    gated.allow(of_step - 1);
    std::thread::scope(|scope| {
        let reader = scope.spawn(|| store.read_core(root(&store), &mut vec![0; store.core_bytes()]));
        // One reader waits at the gate; the others have ended.
        let (done, total) = loop {
            match store.making() {
                Some(making) if making.done + 1 >= making.total => break (making.done, making.total),
                _ => std::thread::yield_now(),
            }
        };
        assert_eq!((done, total), (u64::from(of_step) - 1, u64::from(of_step)));
        gated.allow(u32::MAX);
        reader.join().unwrap().unwrap();
    });
    assert_eq!(store.making(), None);
    // Kept, so nothing is made.
    gated.allow(0);
    store.read_core(root(&store), &mut vec![0; store.core_bytes()]).unwrap();
}

#[test]
fn bricks_beneath_are_the_descendants_of_the_own_level() {
    let fine = Hashed::new(VoxelType::U8, Extent::new(700, 130, 129), None);
    let coarse = Hashed::new(VoxelType::U8, Extent::new(350, 65, 129), None);
    let image = image(vec![Arc::new(fine), Arc::new(coarse)]);
    let levels = Levels::of(&image.levels, DEFAULT_BRICK_EDGE);
    let pyramid = levels.pyramid();
    let mut counts: Vec<u64> = vec![1; pyramid.level(Level(1)).bricks.volume() as usize];
    for level in (2..pyramid.levels().len() as u8).map(Level) {
        let (grid, finer) = (pyramid.level(level).bricks, pyramid.level(Level(level.0 - 1)).bricks);
        let indices: Vec<_> = grid.full_box().voxels().map(BrickIndex::from_array).collect();
        let sums = indices.iter().map(|index| {
            pyramid.children(level, *index).map(|child| counts[finer.linear(child.to_array()) as usize]).sum()
        });
        let sums: Vec<u64> = sums.collect();
        for (index, sum) in indices.iter().zip(&sums) {
            let id = BrickId { time: 0, channel: 0, level, index: *index };
            assert_eq!(levels.bricks_beneath(id), *sum, "{id}");
        }
        counts = sums;
    }
    assert_eq!(counts, [6 * 2 * 3]);
}
