//! Whole packs of small volumes, against plain loops and against each other.

mod cancel;
mod fractions;
mod image_labels;
mod limits;
mod output;
mod panics;
mod rehearsal;
mod shard_times;
pub(crate) mod trial;

use super::disk::Disk;
use super::*;
use crate::downsample::Downsample;
use crate::layout::JOURNAL_NAME;
use crate::shard_file::IoMode;
use crate::store::Store;
use brickyard_import::{Access, SourceInfo};
use brickyard_volume::{
    BrickId, BrickIndex, ChannelLook, Extent, Geometry, Level, OccupancyBins, Orientation, Pyramid, TimeAxis, Voxel,
    VoxelBox,
};
use proptest::prelude::*;
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicI64, AtomicU32, Ordering};
use trial::Trial;

/// An in-memory array as a source.
pub(crate) struct Array<T> {
    pub(crate) info: SourceInfo,
    voxels: Vec<T>,
    pub(crate) access: Access,
    /// Reads before all further ones fail.
    pub(crate) fuse: AtomicI64,
    /// Number of boxes read.
    reads: AtomicU32,
}

impl<T: Voxel> Array<T> {
    fn new(extent: [u32; 3], value: impl Fn([u32; 3]) -> T) -> Self {
        Self::series(extent, 1, 1, |_, p| value(p))
    }

    pub(crate) fn series(extent: [u32; 3], times: u32, channels: u32, value: impl Fn(u32, [u32; 3]) -> T) -> Self {
        Self::made(extent, times, channels, &value)
    }

    /// Compiled once for each type, not for each closure of a test.
    fn made(extent: [u32; 3], times: u32, channels: u32, value: &dyn Fn(u32, [u32; 3]) -> T) -> Self {
        let extent = Extent::from_array(extent);
        let info = SourceInfo { channels, times, identity: "array".into(), ..SourceInfo::of_volume(extent, T::TYPE) };
        let mut voxels = Vec::with_capacity((u64::from(times * channels) * extent.volume()) as usize);
        for i in 0..times * channels {
            for z in 0..extent.z {
                for y in 0..extent.y {
                    voxels.extend((0..extent.x).map(|x| value(i, [x, y, z])));
                }
            }
        }
        let fuse = AtomicI64::new(i64::MAX);
        Self { info, voxels, access: Access::Box, fuse, reads: AtomicU32::new(0) }
    }

    fn at(&self, volume: u32, p: [u32; 3]) -> T {
        let extent = self.info.extent;
        self.voxels[(volume as u64 * extent.volume() + extent.linear(p)) as usize]
    }
}

impl<T: Voxel> Source for Array<T> {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    fn access(&self) -> Access {
        self.access
    }

    fn read_box(&self, time: u32, channel: u32, region: VoxelBox, out: &mut [u8]) -> Result<(), ImportError> {
        self.reads.fetch_add(1, Ordering::Relaxed);
        if self.fuse.fetch_sub(1, Ordering::Relaxed) <= 0 {
            let error = std::io::ErrorKind::UnexpectedEof.into();
            return Err(ImportError::Io { path: "array".into(), error });
        }
        let mut out = out.chunks_exact_mut(size_of::<T>());
        for z in region.min.z..region.max.z {
            for y in region.min.y..region.max.y {
                for x in region.min.x..region.max.x {
                    let voxel = self.at(time * self.info.channels + channel, [x, y, z]);
                    out.next().unwrap().copy_from_slice(bytemuck::bytes_of(&voxel));
                }
            }
        }
        Ok(())
    }
}

/// Smooth, with noise in the low bits, and with an empty corner.
pub(crate) fn value([x, y, z]: [u32; 3]) -> f64 {
    let noise = (x.wrapping_mul(73_856_093) ^ y.wrapping_mul(19_349_663) ^ z.wrapping_mul(83_492_791)) >> 7 & 7;
    if x < 20 && y < 20 { 0.0 } else { ((x + y) / 2 + z / 4 + noise) as f64 }
}

pub(crate) fn options(voxel_type: VoxelType) -> PackOptions {
    PackOptions {
        edge: 16,
        shard_edge: 32,
        downsample: Downsample::Mean.into(),
        threads: 2,
        memory_bytes: 1 << 30,
        ..PackOptions::new(voxel_type)
    }
}

/// Cancels a pack at once, which leaves nothing.
pub(crate) struct CancelledAtOnce;

impl Progress for CancelledAtOnce {
    fn is_cancelled(&self) -> bool {
        true
    }
}

pub(crate) fn files(dir: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    fn walk(root: &Path, dir: &Path, files: &mut BTreeMap<PathBuf, Vec<u8>>) {
        for entry in std::fs::read_dir(dir).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                walk(root, &path, files);
            } else {
                files.insert(path.strip_prefix(root).unwrap().into(), std::fs::read(&path).unwrap());
            }
        }
    }
    let mut found = BTreeMap::new();
    walk(dir, dir, &mut found);
    found
}

/// Compares without printing megabytes.
pub(crate) fn assert_same(a: &BTreeMap<PathBuf, Vec<u8>>, b: &BTreeMap<PathBuf, Vec<u8>>, what: &str) {
    assert_eq!(a.keys().collect::<Vec<_>>(), b.keys().collect::<Vec<_>>(), "{what}");
    for (path, bytes) in a {
        assert!(bytes == &b[path], "{what}: {} differs", path.display());
    }
}

fn packed<T: Voxel>(source: &Array<T>, options: &PackOptions) -> BTreeMap<PathBuf, Vec<u8>> {
    let dir = tempfile::tempdir().unwrap();
    let store = dir.path().join("s.zarr");
    pack(source, &store, options, &()).unwrap();
    files(&store)
}

/// These come from the source; they are no statistics to recompute from voxels.
#[test]
fn a_store_whose_channels_have_names_colors_and_windows_is_sound() {
    let mut source = Array::<u8>::series([20, 20, 20], 1, 2, |_, p| value(p) as u8);
    let look = ChannelLook {
        name: Some("DAPI".into()),
        color: Some([40, 90, 255]),
        window: Some([3.0, 90.0]),
        unit: Some("HU".into()),
    };
    source.info.channel_looks = vec![look, ChannelLook::default()];
    let dir = tempfile::tempdir().unwrap();
    let store = dir.path().join("s.zarr");
    pack(&source, &store, &options(VoxelType::U8), &()).unwrap();
    assert_eq!(crate::verify::verify(&store, |_, _| {}).unwrap().problems, []);
    let units: Vec<_> =
        Store::open(&store).unwrap().channel_displays().iter().map(|display| display.unit.clone()).collect();
    assert_eq!(units, [Some("HU".to_owned()), None]);
    source.info.channel_looks[0].unit = Some("a\nb".into());
    let refused = pack(&source, &dir.path().join("t.zarr"), &options(VoxelType::U8), &()).unwrap_err().to_string();
    assert!(refused.contains("unit of values") && refused.contains("control"), "{refused}");
}

/// Other programs see lengths only, and each axis has its unit back, in both pyramids.
#[test]
fn unlike_axes_keep_their_units() {
    for (units, seen) in [
        (["degree", "degree", "hPa"], [None; 3]),
        (["um", "mm", "hPa"], [Some("micrometer"), Some("micrometer"), None]),
        (["um", "mm", ""], [Some("micrometer"), Some("micrometer"), None]),
        (["um", "mm", "m"], [Some("micrometer"); 3]),
    ] {
        let mut source = Array::<u8>::series([20, 20, 20], 1, 1, |_, p| value(p) as u8);
        source.info.geometry.take_units(units);
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("s.zarr");
        let two = PackOptions { downsample: "mean,max".parse().unwrap(), ..options(VoxelType::U8) };
        pack(&source, &path, &two, &()).unwrap();
        let root = std::fs::read_to_string(path.join("zarr.json")).unwrap();
        let root: serde_json::Value = serde_json::from_str(&root).unwrap();
        let axes = &root["attributes"]["ome"]["multiscales"][0]["axes"];
        let found = [2, 1, 0].map(|axis| axes[axis]["unit"].as_str().map(str::to_owned));
        assert_eq!(found, seen.map(|unit| unit.map(str::to_owned)), "{units:?}");
        assert_eq!(Store::open(&path).unwrap().geometry(), &source.info.geometry);
        assert_eq!(
            Store::open_reduced(&path, Downsample::Max, IoMode::default()).unwrap().geometry(),
            &source.info.geometry
        );
        assert_eq!(crate::verify::verify(&path, |_, _| {}).unwrap().problems, []);
    }
}

pub(crate) fn level_voxels(store: &Store, time: u32, channel: u32, level: Level) -> Vec<f64> {
    let region = store.pyramid().level(level).extent.full_box();
    let voxel_type = store.voxel_type();
    let mut bytes = vec![0; region.extent().volume() as usize * voxel_type.bytes()];
    store.read_box(time, channel, level, region, &mut bytes).unwrap();
    (0..region.extent().volume() as usize).map(|i| voxel_type.read(&bytes, i)).collect()
}

/// One level from the finer one, by plain loops. `nodata` is the value of voxels without data, NaN for floats.
fn coarser<T: Voxel>(
    fine: &[f64],
    from: Extent,
    to: Extent,
    factor: [u32; 3],
    method: Downsample,
    nodata: f64,
) -> Vec<f64> {
    let mut coarse = Vec::new();
    for z in 0..to.z {
        for y in 0..to.y {
            for x in 0..to.x {
                let corner = [x * factor[0], y * factor[1], z * factor[2]];
                let mut inside = Vec::new();
                for d in 0..8 {
                    let step = [d & 1, d >> 1 & 1, d >> 2];
                    let p = std::array::from_fn(|a| corner[a] + step[a]);
                    if (0..3).all(|a| step[a] < factor[a]) && from.contains(p) {
                        inside.push(fine[from.linear(p) as usize]);
                    }
                }
                inside.retain(|v| v.is_finite() && *v != nodata);
                let first = inside.first().copied();
                inside.sort_by(f64::total_cmp);
                let frequency = |v: f64| inside.iter().filter(|w| **w == v).count();
                let result = match method {
                    _ if inside.is_empty() => nodata,
                    Downsample::Nearest => first.unwrap(),
                    Downsample::Mean => {
                        let mean = inside.iter().sum::<f64>() / inside.len() as f64;
                        let is_nodata = T::from_f64_rounded(mean).to_f64() == nodata;
                        if is_nodata { nodata + if mean < nodata { -1.0 } else { 1.0 } } else { mean }
                    }
                    Downsample::Max => inside[inside.len() - 1],
                    Downsample::Min => inside[0],
                    // `max_by_key` returns the last of several maxima: the least value, from the back.
                    Downsample::Mode => *inside.iter().rev().max_by_key(|v| frequency(**v)).unwrap(),
                };
                coarse.push(T::from_f64_rounded(result).to_f64());
            }
        }
    }
    coarse
}

/// Every level of every pyramid against plain loops over the finer one.
fn check_pyramid<T: Voxel>(source: &Array<T>, options: &PackOptions) {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("s.zarr");
    pack(source, &path, options, &()).unwrap();
    let info = &source.info;
    for method in std::iter::once(options.downsample.main()).chain(options.downsample.second()) {
        let store = Store::open_reduced(&path, method, IoMode::default()).unwrap();
        assert_eq!(store.downsample(), method);
        for (time, channel) in (0..info.times).flat_map(|t| (0..info.channels).map(move |c| (t, c))) {
            let volume = (time * info.channels + channel) as usize * info.extent.volume() as usize;
            let voxels = &source.voxels[volume..volume + info.extent.volume() as usize];
            let nodata = info.nodata.filter(|_| !T::TYPE.is_float()).unwrap_or(f64::NAN);
            let is_blank = |v: f64| T::TYPE.is_float() && info.nodata == Some(v);
            let stored = voxels.iter().map(|v| v.to_f64()).map(|v| if is_blank(v) { f64::NAN } else { v });
            let mut expected: Vec<f64> = stored.collect();
            let levels = store.pyramid().levels();
            for k in 0..levels.len() {
                if k > 0 {
                    let factor = std::array::from_fn(|a| levels[k].factor[a] / levels[k - 1].factor[a]);
                    let (from, to) = (levels[k - 1].extent, levels[k].extent);
                    expected = coarser::<T>(&expected, from, to, factor, method, nodata);
                }
                let found = level_voxels(&store, time, channel, Level(k as u8));
                let same = |a: f64, b: f64| a == b || a.is_nan() && b.is_nan();
                let wrong = expected.iter().zip(&found).position(|(a, b)| !same(*a, *b));
                let what = format!("{} {} t{time} c{channel} level {k}", T::TYPE, method.name());
                assert_eq!(wrong.map(|i| (i, expected[i], found[i])), None, "{what}");
            }
        }
    }
    let report = crate::verify::verify(&path, |done, total| assert!(done <= total)).unwrap();
    assert_eq!(report.problems, [], "{} {}", T::TYPE, options.downsample);
}

/// Every stored apron against the voxels of its level, clamped to it; and everything but the aprons against a pack
/// without them.
fn check_aprons<T: Voxel>(source: &Array<T>, options: &PackOptions) {
    let mut without = packed(source, &PackOptions { aprons: 0, ..options.clone() });
    without.remove(Path::new("zarr.json"));
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("s.zarr");
    pack(source, &path, options, &()).unwrap();
    let mut rest = files(&path);
    rest.retain(|path, _| !path.to_string_lossy().contains("/aprons/") && path != Path::new("zarr.json"));
    assert_same(&without, &rest, "all but aprons");
    for method in std::iter::once(options.downsample.main()).chain(options.downsample.second()) {
        let store = Store::open_reduced(&path, method, IoMode::default()).unwrap();
        let apron = store.apron().unwrap();
        let (times, channels) = (store.times(), store.channels());
        for (time, channel) in (0..times).flat_map(|t| (0..channels).map(move |c| (t, c))) {
            for k in 0..store.pyramid().levels().len() {
                let level = Level(k as u8);
                let grid = *store.pyramid().level(level);
                let n = grid.extent.to_array();
                let voxels = level_voxels(&store, time, channel, level);
                for index in crate::store::bricks_of(grid.bricks.full_box(), 1) {
                    let id = BrickId { time, channel, level, index };
                    let mut found = vec![9; apron.voxels() * T::TYPE.bytes()];
                    store.read_apron(id, &mut found).unwrap();
                    let places = apron.slabs().into_iter().flat_map(crate::test_store::voxels);
                    for (i, at) in places.enumerate() {
                        let v = std::array::from_fn(|a| {
                            (index.to_array()[a] * apron.edge + at[a]).saturating_sub(apron.width).min(n[a] - 1)
                        });
                        let (found, expected) = (T::TYPE.read(&found, i), voxels[grid.extent.linear(v) as usize]);
                        let same = found == expected || found.is_nan() && expected.is_nan();
                        assert!(same, "{} {id} at {at:?}: {found}, expected {expected}", T::TYPE);
                    }
                }
            }
        }
    }
    let report = crate::verify::verify(&path, |_, _| {}).unwrap();
    assert_eq!(report.problems, [], "{} aprons of {}", T::TYPE, options.aprons);
}

pub(crate) fn mean_and_max() -> Reductions {
    "mean,max".parse().unwrap()
}

#[test]
fn every_level_is_what_plain_loops_make_of_the_finer_one() {
    let extent = [100, 37, 211];
    let alone = Downsample::ALL.map(Reductions::from);
    for downsample in alone.into_iter().chain([mean_and_max(), "nearest,min".parse().unwrap()]) {
        let with = |t| PackOptions { downsample, ..options(t) };
        check_pyramid(&Array::new(extent, |p| value(p) as u8), &with(VoxelType::U8));
        check_pyramid(&Array::new(extent, |p| (value(p) * 300.0 - 20000.0) as i16), &with(VoxelType::I16));
        let holes = |p: [u32; 3]| if p[0].is_multiple_of(5) || p[2] / 8 == 3 { f32::NAN } else { value(p) as f32 };
        check_pyramid(&Array::new(extent, holes), &with(VoxelType::F32));
    }
}

/// A source with the no-data value in a shell and in holes inside.
fn marked<T: Voxel>(extent: [u32; 3], value: impl Fn([u32; 3]) -> T, nodata: T) -> Array<T> {
    let in_hole = |p: [u32; 3]| p[0].is_multiple_of(5) || p[1] / 7 == 3 || p[2] / 8 == 3;
    let in_shell = |p: [u32; 3]| (0..3).any(|a| p[a] < 18 || p[a] + 3 >= extent[a]);
    let marked = |p| if in_shell(p) || in_hole(p) { nodata } else { value(p) };
    let mut array = Array::new(extent, marked);
    array.info.nodata = Some(nodata.to_f64());
    array
}

#[test]
fn voxels_without_data_are_left_out_of_coarser_levels() {
    let extent = [100, 77, 51];
    let alone = Downsample::ALL.map(Reductions::from);
    for downsample in alone.into_iter().chain([mean_and_max()]) {
        let with = |t| PackOptions { downsample, aprons: 1, ..options(t) };
        check_pyramid(&marked(extent, |p| value(p) as u8, 0), &with(VoxelType::U8));
        // A value also found among means of others.
        check_pyramid(&marked(extent, |p| value(p) as u8, 40), &with(VoxelType::U8));
        check_pyramid(&marked(extent, |p| (value(p) as i32 - 100) as i16, -2000), &with(VoxelType::I16));
        check_pyramid(&marked(extent, |p| value(p) as u16, u16::MAX), &with(VoxelType::U16));
        check_pyramid(&marked(extent, |p| (value(p) * 1e6) as i32, -9999), &with(VoxelType::I32));
        check_pyramid(&marked(extent, |p| value(p) as f32 + 0.5, -9999.0), &with(VoxelType::F32));
    }
    check_pyramid(&marked(extent, |p| (value(p) as i32 - 40) as i8, -1), &options(VoxelType::I8));
    check_pyramid(&marked(extent, |p| u32::MAX - 1 - value(p) as u32, u32::MAX), &options(VoxelType::U32));
}

/// With every voxel type, for the fill value and others.
#[test]
fn a_store_without_any_data_is_a_store() {
    fn check<T: Voxel>(nodata: T) {
        let mut source = Array::new([40, 33, 20], |_| nodata);
        source.info.nodata = Some(nodata.to_f64());
        check_pyramid(&source, &options(T::TYPE));
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("s.zarr");
        let report = pack(&source, &path, &options(T::TYPE), &()).unwrap();
        let store = Store::open(&path).unwrap();
        let channel = &store.info().channels[0];
        let (voxels, is_float) = (source.info.extent.volume(), T::TYPE.is_float());
        assert_eq!((channel.count, channel.range, report.nodata + report.non_finite), (0, [0.0; 2], voxels));
        assert_eq!((channel.nodata, channel.nan), if is_float { (0, voxels) } else { (voxels, 0) });
        let id = BrickId { time: 0, channel: 0, level: Level(0), index: Default::default() };
        assert_eq!(store.minmax(id).unwrap(), None);
        assert_eq!(store.occupancy(id).unwrap(), brickyard_volume::Occupancy::NONE);
        assert_eq!(store.nodata(), Some(nodata.to_f64()).filter(|_| !is_float));
    }
    check(0u8);
    check(255u8);
    check(-2000i16);
    check(0u16);
    check(-9999i32);
    check(u32::MAX);
    check(-9999.0f32);
}

#[test]
fn voxels_without_data_are_left_out_of_statistics() {
    fn check<T: Voxel>(source: &Array<T>) {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("s.zarr");
        let nodata = source.info.nodata.unwrap();
        let report = pack(source, &path, &options(T::TYPE), &()).unwrap();
        let store = Store::open(&path).unwrap();
        let channel = &store.info().channels[0];
        let mut valid: Vec<f64> = source.voxels.iter().map(|v| v.to_f64()).filter(|v| *v != nodata).collect();
        valid.sort_by(f64::total_cmp);
        let left = source.voxels.len() - valid.len();
        assert_eq!((channel.nodata, report.nodata), (left as u64, left as u64));
        assert_eq!((channel.count, channel.range), (valid.len() as u64, [valid[0], valid[valid.len() - 1]]));
        assert_eq!(channel.mean, valid.iter().sum::<f64>() / valid.len() as f64);
        let at = |share: f64| valid[(valid.len() as f64 * share).ceil() as usize - 1];
        assert_eq!(
            (channel.percentiles.p1, channel.percentiles.p50, channel.window[1]),
            (at(0.01), at(0.5), at(0.999))
        );
        assert_eq!(channel.histogram.counts.iter().sum::<u64>(), channel.count);
        let level: serde_json::Value =
            serde_json::from_slice(&std::fs::read(path.join("1/zarr.json")).unwrap()).unwrap();
        assert_eq!(level["attributes"]["_FillValue"], serde_json::json!(nodata as i64));
    }
    let extent = [61, 44, 50];
    check(&marked(extent, |p| value(p) as u8, 255));
    check(&marked(extent, |p| (value(p) as i32 - 100) as i16, -2000));
    check(&marked(extent, |p| value(p) as u16 * 7, 0));
    check(&marked(extent, |p| (value(p) * 1e6) as i32, -9999));
}

#[test]
fn when_steps_were_taken_is_kept_and_is_a_setting() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("s.zarr");
    let with = |time: Option<TimeAxis>, exists| {
        let mut source = Array::series([20, 20, 20], 2, 1, |i, p| (value(p) + f64::from(i)) as u8);
        source.info.time = time;
        let options = PackOptions { exists, ..options(VoxelType::U8) };
        let named = super::settings(&source, &options);
        pack(&source, &path, &options, &()).map(|report| (report.was_complete, named))
    };
    let (_, named) = with(None, Exists::Refuse).unwrap();
    assert!(named.get("time").is_none(), "what is not known must not change the fingerprints of stores that there are");
    assert_eq!(Store::open(&path).unwrap().time_axis(), None);
    let unit = Some("second".to_owned());
    let even = TimeAxis { start: 0.5, step: 0.25, unit, ..TimeAxis::default() };
    assert!(matches!(with(Some(even.clone()), Exists::Resume), Err(PackError::Mismatch { .. })));
    assert!(
        !with(Some(even.clone()), Exists::Overwrite).unwrap().0 && with(Some(even.clone()), Exists::Resume).unwrap().0
    );
    assert_eq!(Store::open(&path).unwrap().time_axis(), Some(&even));
    for (axis, word) in [
        (TimeAxis { step: 0.0, ..even.clone() }, "step: 0: expected a positive number"),
        (TimeAxis { stamps: vec![1.0], ..even.clone() }, "stamps: 1: expected 2, one for each time step"),
        (TimeAxis { stamps: vec![2.0, 1.0], ..even }, "stamps: 1 of step 1 after 2 of step 0: expected ascending"),
    ] {
        let refused = with(Some(axis), Exists::Overwrite).unwrap_err().to_string();
        assert!(refused.contains(word) && refused.contains("`time_step`"), "{refused}");
    }
}

#[test]
fn a_single_step_with_a_time_has_an_axis() {
    let dir = tempfile::tempdir().unwrap();
    for (name, time, axes) in [("a", None, "zyx"), ("b", Some(TimeAxis::default()), "tzyx")] {
        let mut source = Array::new([20, 20, 20], |p| value(p) as u8);
        source.info.time = time.clone();
        let path = dir.path().join(name);
        pack(&source, &path, &options(VoxelType::U8), &()).unwrap();
        let store = Store::open(&path).unwrap();
        assert_eq!((store.layout().axes().concat(), store.time_axis()), (axes.into(), time.as_ref()));
        assert_eq!(crate::verify::verify(&path, |_, _| {}).unwrap().problems, []);
    }
}

#[test]
fn another_value_for_no_data_is_another_pack() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("s.zarr");
    let with = |nodata| {
        let mut source = marked([40, 40, 40], |p| value(p) as u8, 255);
        source.info.nodata = nodata;
        let options = PackOptions { exists: Exists::Resume, ..options(VoxelType::U8) };
        pack(&source, &path, &options, &()).map(|report| report.was_complete)
    };
    assert!(!with(Some(255.0)).unwrap() && with(Some(255.0)).unwrap());
    for other in [Some(0.0), None] {
        assert!(matches!(with(other), Err(PackError::Mismatch { .. })), "{other:?}");
    }
    let refused = with(Some(256.0)).unwrap_err().to_string();
    assert!(refused.contains("256: expected a value within u8"), "{refused}");
}

#[test]
fn every_type_and_shape_packs() {
    let extent = [50, 33, 41];
    check_pyramid(&Array::new(extent, |p| (value(p) as i32 - 40) as i8), &options(VoxelType::I8));
    check_pyramid(&Array::new(extent, |p| (value(p) * 500.0) as u16), &options(VoxelType::U16));
    check_pyramid(&Array::new(extent, |p| u32::MAX - value(p) as u32), &options(VoxelType::U32));
    check_pyramid(&Array::new(extent, |p| i32::MIN + value(p) as i32), &options(VoxelType::I32));
    for extent in [[1, 1, 1], [70, 1, 1], [1, 1, 70], [65, 40, 1], [17, 16, 33]] {
        check_pyramid(&Array::new(extent, |p| value(p) as u8), &options(VoxelType::U8));
    }
    let mut anisotropic = Array::new([90, 80, 30], |p| value(p) as u8);
    anisotropic.info.geometry.spacing = glam::DVec3::new(0.5, 0.5, 2.0);
    let both = PackOptions { downsample: mean_and_max(), ..options(VoxelType::U8) };
    check_pyramid(&anisotropic, &both);
    let series = Array::series([40, 20, 35], 3, 2, |i, p| (value(p) as u8).wrapping_add(i as u8 * 10));
    check_pyramid(&series, &both);
}

#[test]
fn aprons_are_the_voxels_around_every_core() {
    let extent = [100, 37, 211];
    let with = |voxel_type, aprons| PackOptions { aprons, ..options(voxel_type) };
    check_aprons(&Array::new(extent, |p| value(p) as u8), &with(VoxelType::U8, 1));
    check_aprons(&Array::new(extent, |p| (value(p) as i32 - 40) as i8), &with(VoxelType::I8, 2));
    let both = PackOptions { downsample: mean_and_max(), ..with(VoxelType::U16, 2) };
    check_aprons(&Array::new(extent, |p| (value(p) * 500.0) as u16), &both);
    let holes = |p: [u32; 3]| if p[0].is_multiple_of(5) || p[2] / 8 == 3 { f32::NAN } else { value(p) as f32 };
    check_aprons(&Array::new(extent, holes), &with(VoxelType::F32, 1));
    let small = [50, 33, 41];
    check_aprons(&Array::new(small, |p| (value(p) * 300.0 - 20000.0) as i16), &with(VoxelType::I16, 1));
    check_aprons(&Array::new(small, |p| u32::MAX - value(p) as u32), &with(VoxelType::U32, 2));
    let uncompressed = PackOptions { codec: Codec::None, ..with(VoxelType::I32, 1) };
    check_aprons(&Array::new(small, |p| i32::MIN + value(p) as i32), &uncompressed);
    for extent in [[1, 1, 1], [70, 1, 1], [1, 1, 70], [65, 40, 1], [17, 16, 33]] {
        check_aprons(&Array::new(extent, |p| value(p) as u8), &with(VoxelType::U8, 2));
    }
    let series = Array::series([40, 20, 35], 3, 2, |i, p| (value(p) as u8).wrapping_add(i as u8 * 10));
    check_aprons(&series, &PackOptions { downsample: mean_and_max(), ..with(VoxelType::U8, 1) });
}

/// An apron that is all fill has no bytes, though its core may; a core that is all fill may have an apron.
#[test]
fn aprons_of_fill_are_not_stored() {
    let source = Array::new([96, 96, 96], |p| if p.iter().all(|v| (17..32).contains(v)) { 7u8 } else { 0 });
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("s.zarr");
    pack(&source, &path, &PackOptions { aprons: 1, ..options(VoxelType::U8) }, &()).unwrap();
    let store = Store::open(&path).unwrap();
    let is_stored = |x| {
        let id = BrickId { time: 0, channel: 0, level: Level(0), index: BrickIndex::new(x, 1, 1) };
        (store.is_stored(id).unwrap(), store.aprons().unwrap().is_stored(id).unwrap())
    };
    assert_eq!([0, 1, 2, 3].map(is_stored), [(false, false), (true, false), (false, true), (false, false)]);
    let has_file = |i: u32| path.join(format!("0/.brickyard/aprons/c/{i}/{i}/{i}/0")).exists();
    assert_eq!([0, 1, 2].map(has_file), [false, true, false]);
}

#[test]
fn damaged_and_wrong_aprons_are_found() {
    let dir = tempfile::tempdir().unwrap();
    let store = dir.path().join("s.zarr");
    let options = PackOptions { aprons: 1, downsample: mean_and_max(), ..options(VoxelType::U8) };
    pack(&Array::new([60, 40, 50], |p| value(p) as u8 + 1), &store, &options, &()).unwrap();
    let problems = || {
        let problems = crate::verify::verify(&store, |_, _| {}).unwrap().problems;
        problems.iter().map(ToString::to_string).collect::<Vec<_>>()
    };
    for (file, named) in [
        ("0/.brickyard/aprons/c/0/0/0/0", "level 0 brick (0,0,0): damaged brick: checksum"),
        ("2/.brickyard/max/.brickyard/aprons/c/0/0/0/0", "level 2 brick (0,0,0): damaged brick: checksum"),
    ] {
        let path = store.join(file);
        let sound = std::fs::read(&path).unwrap();
        let mut bad = sound.clone();
        bad[9] ^= 1;
        std::fs::write(&path, &bad).unwrap();
        let found = problems();
        assert!(found.len() == 1 && found[0].contains(file) && found[0].contains(named), "{found:#?}");
        bad = sound.clone();
        let last = bad.len() - 1;
        bad[last] ^= 1;
        std::fs::write(&path, &bad).unwrap();
        let found = problems();
        assert!(found.len() == 1 && found[0].contains(file) && found[0].contains("damaged shard index"), "{found:#?}");
        std::fs::write(&path, sound).unwrap();
    }
    // Aprons of other bricks, sound except for their meaning.
    for file in ["c/0/0/0/0", ".brickyard/shards/c/0/0/0/0/0/0"] {
        let aprons = |level: &str| store.join(level).join(".brickyard/aprons").join(file);
        std::fs::copy(aprons("1"), aprons("1/.brickyard/max")).unwrap();
    }
    let found = problems();
    let wrong = |p: &String| {
        p.contains("1/.brickyard/max/.brickyard/aprons/c/0/0/0/0") && p.contains("differ from those around")
    };
    assert!(!found.is_empty() && found.iter().all(wrong), "{found:#?}");
}

#[test]
fn output_does_not_depend_on_threads_memory_or_the_order_of_reading() {
    let mut source = Array::new([150, 90, 110], |p| value(p) as u16);
    let options = PackOptions { downsample: mean_and_max(), ..options(VoxelType::U16) };
    let expected = packed(&source, &PackOptions { threads: 1, ..options.clone() });
    assert_same(&expected, &packed(&source, &PackOptions { threads: 4, ..options.clone() }), "4 threads");
    let in_memory = plan(&source, &options).unwrap();
    assert_eq!(in_memory.scratch_bytes, 0);
    // One byte less than everything: some window goes to a scratch file; with the least memory, all do.
    let least = in_memory.memory_bytes - in_memory.stages.iter().map(|s| s.window.bytes).sum::<u64>();
    for memory_bytes in [in_memory.memory_bytes - 1, least] {
        let options = PackOptions { memory_bytes, ..options.clone() };
        let plan = plan(&source, &options).unwrap();
        assert!(plan.scratch_bytes > 0 && plan.memory_bytes <= memory_bytes);
        assert_same(&expected, &packed(&source, &options), "scratch files");
    }
    let too_little = PackOptions { memory_bytes: least - 1, ..options.clone() };
    let refused = plan(&source, &too_little).unwrap_err();
    assert!(matches!(refused, PackError::Memory { needed_bytes, .. } if needed_bytes == least), "{refused}");

    source.access = Access::Planes;
    source.reads = AtomicU32::new(0);
    assert_same(&expected, &packed(&source, &options), "planes");
    assert_eq!(source.reads.load(Ordering::Relaxed), 110, "each plane is read once");
}

/// The formula of `pack/plan.rs`, by hand.
#[test]
fn windows_hold_one_layer() {
    let mut source = Array::new([64, 48, 200], |_| 0u16);
    let windows = |source: &Array<u16>, downsample| {
        let plan = plan(source, &PackOptions { downsample, ..options(VoxelType::U16) }).unwrap();
        plan.stages.iter().map(|s| (s.window.layers, s.window.bytes)).collect::<Vec<_>>()
    };
    let coarse = [(1, 16 * 32 * 24 * 2), (1, 16 * 16 * 12 * 2), (1, 16 * 8 * 6 * 2), (1, 13 * 4 * 3 * 2)];
    assert_eq!(windows(&source, Downsample::Mean.into()), [&[(0, 0)], &coarse[..]].concat());
    // A second pyramid has windows of its own, except for level 0.
    assert_eq!(windows(&source, mean_and_max()), [&[(0, 0)], &coarse[..], &coarse[..]].concat());
    source.access = Access::Planes;
    assert_eq!(windows(&source, Downsample::Mean.into()), [&[(2, 32 * 64 * 48 * 2)], &coarse[..]].concat());
}

#[test]
fn constant_and_fill_bricks_cost_next_to_nothing() {
    let source = Array::new([64, 64, 64], |[x, ..]| if x < 32 { 0u16 } else { 700 });
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("s.zarr");
    let report = pack(&source, &path, &options(VoxelType::U16), &()).unwrap();
    let store = Store::open(&path).unwrap();
    // Two shards of eight bricks an axis; those at x = 0 hold only fill and have no file.
    assert!(!path.join("0/c/0/0/0").exists() && path.join("0/c/0/0/1").exists());
    let id = |x| BrickId { time: 0, channel: 0, level: Level(0), index: BrickIndex::new(x, 0, 0) };
    assert!(!store.is_stored(id(0)).unwrap() && store.is_stored(id(2)).unwrap());
    // 40 bricks of 8 KiB: 100 bytes each are plenty for a constant one, and each shard has an index of 132.
    assert!(report.written_bytes < 40 * 100 + 8 * 132, "{}", report.written_bytes);
    assert_eq!(store.minmax(id(3)).unwrap(), Some((700.0, 700.0)));
    // Its neighbour's first voxel lies in reach of the last fill brick.
    let bins = store.occupancy_bins(0);
    assert_eq!(store.occupancy(id(0)).unwrap(), bins.mask(0.0, 0.0));
    assert_eq!(store.occupancy(id(1)).unwrap(), bins.mask(0.0, 700.0));
}

/// A source with known constant boxes packs to the same bytes.
#[test]
fn known_constants_are_not_read() {
    struct Known(Array<i16>);
    impl Source for Known {
        fn info(&self) -> &SourceInfo {
            self.0.info()
        }
        fn read_box(&self, t: u32, c: u32, region: VoxelBox, out: &mut [u8]) -> Result<(), ImportError> {
            self.0.read_box(t, c, region, out)
        }
        fn constant_in(&self, _: u32, _: u32, region: VoxelBox) -> Option<f64> {
            (region.min.x >= 40).then_some(-5.0)
        }
    }
    for nodata in [None, Some(-5.0)] {
        let array = || {
            let mut array = Array::new([90, 40, 50], |p| if p[0] < 40 { value(p) as i16 } else { -5 });
            array.info.nodata = nodata;
            array
        };
        let options = PackOptions { downsample: mean_and_max(), ..options(VoxelType::I16) };
        let expected = packed(&array(), &options);
        let known = Known(array());
        let dir = tempfile::tempdir().unwrap();
        let store = dir.path().join("s.zarr");
        pack(&known, &store, &options, &()).unwrap();
        assert_same(&expected, &files(&store), "constants");
        // Of 6 x 3 x 4 bricks, those from 48 on are known.
        assert_eq!(known.0.reads.load(Ordering::Relaxed), 3 * 3 * 4);
    }
}

#[test]
fn statistics_are_those_of_all_voxels() {
    let source = Array::series([30, 20, 25], 2, 2, |i, p| {
        let v = value(p) as f32 + if i % 2 == 1 { 1000.0 } else { 0.0 };
        match p {
            [3, 3, 3] => f32::NAN,
            [4, 4, 4] => f32::INFINITY,
            _ => v,
        }
    });
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("s.zarr");
    let report = pack(&source, &path, &options(VoxelType::F32), &()).unwrap();
    assert_eq!(report.non_finite, 8);
    let store = Store::open(&path).unwrap();
    let volume = source.info.extent.volume() as usize;
    for (c, channel) in store.info().channels.iter().enumerate() {
        let mut valid: Vec<f64> = [c, c + 2]
            .iter()
            .flat_map(|i| source.voxels[i * volume..(i + 1) * volume].iter().map(|v| *v as f64))
            .filter(|v| v.is_finite())
            .collect();
        valid.sort_by(f64::total_cmp);
        assert_eq!((channel.nan, channel.pos_inf, channel.neg_inf), (2, 2, 0));
        assert_eq!((channel.count, channel.range), (valid.len() as u64, [valid[0], valid[valid.len() - 1]]));
        let mean = valid.iter().sum::<f64>() / valid.len() as f64;
        // Sums of whole numbers below 2^53 are exact in any order.
        assert_eq!(channel.mean, mean);
        let median = valid[valid.len() / 2 - 1];
        assert_eq!(channel.percentiles.p50, median);
        assert_eq!(channel.histogram.counts.iter().sum::<u64>(), channel.count);
    }
}

#[test]
fn an_existing_output_is_treated_as_told() {
    let dir = tempfile::tempdir().unwrap();
    let store = dir.path().join("s.zarr");
    let source = Array::new([40, 40, 40], |p| value(p) as u8);
    let with = |exists| PackOptions { exists, ..options(VoxelType::U8) };
    std::fs::create_dir(&store).unwrap();
    pack(&source, &store, &with(Exists::Refuse), &()).unwrap();
    let first = files(&store);
    let refused = pack(&source, &store, &with(Exists::Refuse), &()).unwrap_err();
    assert!(matches!(refused, PackError::Exists { unfinished: false, .. }), "{refused}");
    assert!(pack(&source, &store, &with(Exists::Resume), &()).unwrap().was_complete);
    let other = PackOptions { codec: Codec::None, ..with(Exists::Resume) };
    assert!(matches!(pack(&source, &store, &other, &()), Err(PackError::Mismatch { .. })));

    // A failed overwrite leaves the old store; a finished one replaces it and leaves nothing beside it.
    let overwrite = PackOptions { codec: Codec::None, ..with(Exists::Overwrite) };
    source.fuse.store(10, Ordering::Relaxed);
    assert!(matches!(pack(&source, &store, &overwrite, &()), Err(PackError::Source { .. })));
    assert_same(&first, &files(&store), "after a failed overwrite");
    source.fuse.store(i64::MAX, Ordering::Relaxed);
    pack(&source, &store, &overwrite, &()).unwrap();
    assert_same(&packed(&source, &overwrite), &files(&store), "after an overwrite");
    assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 1);

    let foreign = dir.path().join("photos");
    std::fs::create_dir(&foreign).unwrap();
    std::fs::write(foreign.join("a.jpg"), "x").unwrap();
    for exists in [Exists::Refuse, Exists::Resume, Exists::Overwrite] {
        assert!(matches!(pack(&source, &foreign, &with(exists), &()), Err(PackError::NotOurs { .. })), "{exists:?}");
        assert!(matches!(pack(&source, &foreign.join("a.jpg"), &with(exists), &()), Err(PackError::NotOurs { .. })));
    }
    assert!(foreign.join("a.jpg").exists());
}

#[test]
fn bad_options_are_refused() {
    let source = Array::new([40, 40, 40], |_| 0u8);
    let good = options(VoxelType::U8);
    for bad in [
        PackOptions { edge: 24, ..good.clone() },
        PackOptions { edge: 4, ..good.clone() },
        PackOptions { shard_edge: 40, ..good.clone() },
        PackOptions { shard_edge: 0, ..good.clone() },
        PackOptions { shard_times: 0, ..good.clone() },
        PackOptions { threads: 0, ..good.clone() },
        PackOptions { aprons: 3, ..good.clone() },
    ] {
        assert!(matches!(plan(&source, &bad), Err(PackError::Options(_))), "{bad:?}");
    }
}

/// A crash or a full disk at (nearly) any change to the file system, then `--resume`: the store is byte-identical, and
/// finished work is not rewritten.
#[test]
fn resuming_after_a_failure_at_any_write_gives_the_uninterrupted_store() {
    let source = Array::new([40, 20, 36], |p| value(p) as u16 + 1);
    let fresh = PackOptions { downsample: mean_and_max(), aprons: 1, ..options(VoxelType::U16) };
    // Level 0, and two of each pyramid; the same for aprons.
    check_resuming(&source, &fresh, 2 * (4 + 2 * 2));
}

fn check_resuming<T: Voxel>(source: &Array<T>, fresh: &PackOptions, shards: u64) {
    let resume = PackOptions { exists: Exists::Resume, ..fresh.clone() };
    let expected = packed(source, fresh);
    let dir = tempfile::tempdir().unwrap();
    let (mut n, mut resumed_most) = (0, 0);
    loop {
        let store = dir.path().join(format!("{n}.zarr"));
        let disk = Trial::disk_of(n);
        match pack_on(&disk, source, &store, fresh, &()) {
            Ok(_) => break,
            Err(PackError::Incomplete { done, total, needed_bytes, .. }) => {
                assert!(done <= total && total == shards && needed_bytes > 0);
            }
            Err(error) => panic!("change {n}: {error}"),
        }
        assert!(!store.join("zarr.json").exists() || store.join(JOURNAL_NAME).exists() || files(&store) == expected);
        if store.join(JOURNAL_NAME).exists() {
            let refused = pack(source, &store, fresh, &()).unwrap_err();
            assert!(matches!(refused, PackError::Exists { unfinished: true, .. }), "{refused}");
        }
        let report = pack(source, &store, &resume, &()).unwrap();
        resumed_most = resumed_most.max(report.shards_resumed);
        assert_same(&expected, &files(&store), &format!("change {n}"));
        std::fs::remove_dir_all(&store).unwrap();
        // Every change at first, during shard writes, then ever fewer, during side-file writes.
        n += 1 + n / 8;
    }
    // Every shard's file takes at least a create, an append, a sync, a rename and a journal line.
    assert!(n > 5 * shards as i64 && resumed_most == shards, "{n} changes, {resumed_most} shards");
}

#[test]
fn a_second_pyramid_leaves_the_main_one_as_it_is() {
    let source = Array::new([70, 40, 75], |p| value(p) as u8 + 1);
    let alone = options(VoxelType::U8);
    let both = PackOptions { downsample: mean_and_max(), ..alone.clone() };
    let shared = |options: &PackOptions| {
        let mut files = packed(&source, options);
        files.retain(|path, _| !path.to_string_lossy().contains("/max/") && path != Path::new("zarr.json"));
        files
    };
    assert_same(&shared(&alone), &shared(&both), "the main pyramid");

    // Neither is resumed as the other.
    let dir = tempfile::tempdir().unwrap();
    let store = dir.path().join("s.zarr");
    source.fuse.store(30, Ordering::Relaxed);
    pack(&source, &store, &alone, &()).unwrap_err();
    source.fuse.store(i64::MAX, Ordering::Relaxed);
    let refused = pack(&source, &store, &PackOptions { exists: Exists::Resume, ..both }, &()).unwrap_err().to_string();
    assert!(refused.contains("downsample was \"mean\", now \"mean,max\""), "{refused}");
}

#[test]
fn damage_to_either_pyramid_is_found_once() {
    let dir = tempfile::tempdir().unwrap();
    let store = dir.path().join("s.zarr");
    let options = PackOptions { downsample: mean_and_max(), ..options(VoxelType::U8) };
    pack(&Array::new([60, 40, 50], |p| value(p) as u8 + 1), &store, &options, &()).unwrap();
    let problems = || {
        let problems = crate::verify::verify(&store, |_, _| {}).unwrap().problems;
        problems.iter().map(ToString::to_string).collect::<Vec<_>>()
    };
    for (file, named) in [("0/c/0/0/0", "level 0 brick (0,0,0)"), ("2/.brickyard/max/c/0/0/0", "level 2 brick (0,0,0)")]
    {
        let path = store.join(file);
        let sound = std::fs::read(&path).unwrap();
        let mut bad = sound.clone();
        bad[9] ^= 1;
        std::fs::write(&path, bad).unwrap();
        let found = problems();
        assert!(found.len() == 1 && found[0].contains(file) && found[0].contains(named), "{found:#?}");
        std::fs::write(&path, sound).unwrap();
    }
    // Level 1 of the second pyramid with the voxels of the main one: sound except for its meaning.
    for file in ["c/0/0/0", ".brickyard/shards/c/0/0/0/0/0/0"] {
        std::fs::copy(store.join("1").join(file), store.join("1/.brickyard/max").join(file)).unwrap();
    }
    let found = problems();
    let wrong = |p: &String| p.contains("1/.brickyard/max/c/0/0/0") && p.contains("differ from the max");
    assert!(found.iter().any(wrong) && found.iter().all(|p| p.contains("/.brickyard/max/")), "{found:#?}");
}

#[test]
fn a_pyramid_is_opened_by_its_method() {
    let dir = tempfile::tempdir().unwrap();
    let store = dir.path().join("s.zarr");
    let options = PackOptions { downsample: mean_and_max(), ..options(VoxelType::U8) };
    pack(&Array::new([40, 20, 20], |p| value(p) as u8), &store, &options, &()).unwrap();
    let open = |method| Store::open_reduced(&store, method, IoMode::Pread);
    let layout = |store: Store| store.layout().clone();
    assert_eq!(layout(open(Downsample::Mean).unwrap()), layout(Store::open(&store).unwrap()));
    assert_eq!(open(Downsample::Max).unwrap().layout().second(), Some(Downsample::Max));
    let refused = open(Downsample::Min).err().unwrap().to_string();
    assert!(refused.contains("no level is made by min, only by mean,max"), "{refused}");
    // A contradiction in the second's metadata does not affect the main one.
    let path = store.join("zarr.json");
    let mut root = crate::test_store::read_json(&path).unwrap();
    root["attributes"]["brickyard"]["multiscales"][0]["datasets"][1]["path"] = "1".into();
    std::fs::write(&path, document_bytes(&root)).unwrap();
    Store::open(&store).unwrap();
    let refused = open(Downsample::Max).err().unwrap().to_string();
    assert!(refused.contains("attributes.brickyard.multiscales[0].datasets[1].path"), "{refused}");
}

/// Journal entries count only if the files confirm them.
#[test]
fn resume_checks_the_journal_against_the_files() {
    let source = Array::new([70, 40, 75], |p| value(p) as u8);
    let fresh = options(VoxelType::U8);
    let resume = PackOptions { exists: Exists::Resume, ..fresh.clone() };
    let expected = packed(&source, &fresh);
    let dir = tempfile::tempdir().unwrap();
    let store = dir.path().join("s.zarr");
    // All shards are finished; only the root document fails.
    let changes = {
        let disk = Trial::disk_of(i64::MAX);
        pack_on(&disk, &source, &store, &fresh, &()).unwrap();
        i64::MAX - disk.trial.fuse.unwrap().load(Ordering::SeqCst)
    };
    std::fs::remove_dir_all(&store).unwrap();
    let disk = Trial::disk_of(changes - 4);
    pack_on(&disk, &source, &store, &fresh, &()).unwrap_err();
    // Power loss: a file missing, one cut short, one with other bytes of the same length, a torn line.
    std::fs::remove_file(store.join("0/c/0/0/1")).unwrap();
    std::fs::write(store.join("0/c/0/1/1"), [1; 100]).unwrap();
    let damaged = store.join("0/c/1/1/1");
    std::fs::write(&damaged, vec![9; std::fs::metadata(&damaged).unwrap().len() as usize]).unwrap();
    let journal = store.join(JOURNAL_NAME);
    let text = std::fs::read_to_string(&journal).unwrap();
    let shards = text.strip_suffix(" synced\n").unwrap();
    let last = shards.trim_end().rfind('\n').unwrap() + 1;
    std::fs::write(&journal, format!("{} synced\n{}", &shards[..last], &shards[last..shards.len() - 3])).unwrap();

    let other = PackOptions { codec: Codec::Zstd(5), ..resume.clone() };
    let refused = pack(&source, &store, &other, &()).unwrap_err().to_string();
    assert!(refused.contains("codec was \"zstd:1\", now \"zstd:5\""), "{refused}");
    let report = pack(&source, &store, &resume, &()).unwrap();
    // Out of 18 + 4 + 1 + 1.
    assert_eq!(report.shards_resumed, 24 - 4);
    assert_same(&expected, &files(&store), "resumed");
}

/// A pack without a finished shard leaves nothing to clean up, and what was there.
#[test]
fn a_source_that_fails_at_once_leaves_nothing() {
    let dir = tempfile::tempdir().unwrap();
    let store = dir.path().join("s.zarr");
    let source = Array::new([70, 40, 75], |p| value(p) as u8);
    source.fuse.store(0, Ordering::Relaxed);
    for exists in [Exists::Refuse, Exists::Resume] {
        let error = pack(&source, &store, &PackOptions { exists, ..options(VoxelType::U8) }, &()).unwrap_err();
        assert!(matches!(error, PackError::Source { done: 0, .. }) && !error.to_string().contains("resume"), "{error}");
        assert!(!store.exists());
    }
    std::fs::create_dir(&store).unwrap();
    pack(&source, &store, &options(VoxelType::U8), &()).unwrap_err();
    assert_eq!(std::fs::read_dir(&store).unwrap().count(), 0);
}

#[test]
fn a_failing_source_leaves_a_resumable_store() {
    for access in [Access::Box, Access::Planes] {
        let mut source = Array::new([70, 40, 75], |p| value(p) as u8);
        source.access = access;
        let fresh = options(VoxelType::U8);
        let expected = packed(&source, &fresh);
        let dir = tempfile::tempdir().unwrap();
        let store = dir.path().join("s.zarr");
        source.fuse.store(30, Ordering::Relaxed);
        let error = pack(&source, &store, &fresh, &()).unwrap_err();
        assert!(matches!(error, PackError::Source { .. }), "{error}");
        assert!(!store.join("zarr.json").exists());
        source.fuse.store(i64::MAX, Ordering::Relaxed);
        let resume = PackOptions { exists: Exists::Resume, ..fresh };
        pack(&source, &store, &resume, &()).unwrap();
        assert_same(&expected, &files(&store), "resumed");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    /// The basis of culling: for any value of a trilinear sample in a brick or its apron, its bin is set; at every
    /// level, and in all ancestors.
    #[test]
    fn no_sample_leaves_its_bricks_occupancy(seed in any::<u32>(), steep in 1u32..2000, samples in prop::collection::vec(prop::array::uniform3(0.0f64..1.0), 40)) {
        let random = |p: [u32; 3]| {
            let h = (p[0] / 3).wrapping_mul(seed | 1) ^ (p[1] / 5).wrapping_mul(0x9e37_79b9) ^ p[2].wrapping_mul(0x85eb_ca6b);
            ((h.wrapping_mul(0x2c1b_3c6d) >> 16 & 0xff) * steep / 64) as u16
        };
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("s.zarr");
        let extent = [37, 21, 40];
        let options = PackOptions { edge: 8, shard_edge: 16, downsample: mean_and_max(), ..options(VoxelType::U16) };
        pack(&Array::new(extent, random), &path, &options, &()).unwrap();
        let method = if seed % 2 == 0 { Downsample::Mean } else { Downsample::Max };
        let store = Store::open_reduced(&path, method, IoMode::default()).unwrap();
        let bins = store.occupancy_bins(0);
        let pyramid = Pyramid::new(Extent::from_array(extent), [1.0; 3], 8);
        for k in 0..pyramid.levels().len() {
            let level = Level(k as u8);
            let grid = *pyramid.level(level);
            let voxels = level_voxels(&store, 0, 0, level);
            for i in 0..grid.bricks.volume() as u32 {
                let b = grid.bricks;
                let index = BrickIndex::new(i % b.x, i / b.x % b.y, i / b.x / b.y);
                for s in &samples {
                    // Voxel centres from half a voxel outside the brick's core to half a voxel outside its other end.
                    let at: [f64; 3] = std::array::from_fn(|a| index.to_array()[a] as f64 * 8.0 - 0.5 + s[a] * 8.0);
                    let value = trilinear(&voxels, grid.extent, at);
                    // A sum of eight products of three factors, of numbers up to 65535: rounded by less than this.
                    let (low, high) = (value - 1e-9, value + 1e-9);
                    let mut id = BrickId { time: 0, channel: 0, level, index };
                    loop {
                        prop_assert!(store.occupancy(id).unwrap().meets(bins.mask(low, high)), "{} {:?} {}", id, at, value);
                        let Some(parent) = pyramid.parent(id.level, id.index) else { break };
                        id = BrickId { level: Level(id.level.0 + 1), index: parent, ..id };
                    }
                }
            }
        }
    }
}

/// The value at a point in voxel-centre coordinates, faces replicated.
fn trilinear(voxels: &[f64], extent: Extent, at: [f64; 3]) -> f64 {
    let n = extent.to_array();
    let (mut value, floor) = (0.0, at.map(f64::floor));
    for d in 0..8u32 {
        let step = [d & 1, d >> 1 & 1, d >> 2];
        let weight: f64 = (0..3).map(|a| 1.0 - (at[a] - floor[a] - step[a] as f64).abs()).product();
        let p = std::array::from_fn(|a| (floor[a] as i64 + step[a] as i64).clamp(0, n[a] as i64 - 1) as u32);
        value += weight * voxels[extent.linear(p) as usize];
    }
    value
}

#[test]
fn occupancy_bins_of_bytes_are_four_values_wide() {
    let source = Array::new([20, 20, 20], |p| value(p) as u8);
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("s.zarr");
    pack(&source, &path, &options(VoxelType::U8), &()).unwrap();
    let store = Store::open(&path).unwrap();
    assert_eq!(store.occupancy_bins(0), OccupancyBins { low: 0.0, width: 4.0 });
}

/// Truncates a file once some of its voxels are packed.
struct Cutter {
    path: PathBuf,
    left: u64,
}

impl Progress for Cutter {
    fn advanced(&self, done: u64, _: u64) {
        if done > 0 {
            let file = std::fs::OpenOptions::new().write(true).open(&self.path).unwrap();
            if file.metadata().unwrap().len() > self.left {
                file.set_len(self.left).unwrap();
            }
        }
    }
}

/// Lost parts of a mapped file read as zeros: none of these may become a store's voxels.
#[test]
fn a_source_cut_short_while_it_is_packed_ends_the_pack() {
    use brickyard_import::{Endian, RawLayout, RawSource};
    let extent = Extent::new(64, 64, 512);
    // Lent directly from the file, and copied; truncated by pages, and by a byte of the last page.
    for (voxel_type, endian) in [(VoxelType::U8, Endian::Little), (VoxelType::U16, Endian::Big)] {
        let bytes = extent.volume() * voxel_type.bytes() as u64;
        for left in [bytes / 4, bytes - 1] {
            let dir = tempfile::tempdir().unwrap();
            let (path, store) = (dir.path().join("a.raw"), dir.path().join("s.zarr"));
            std::fs::write(&path, vec![7; bytes as usize]).unwrap();
            let layout = RawLayout { endian, ..RawLayout::new(extent, voxel_type) };
            let source = RawSource::open(&path, &layout).unwrap();
            let stopped = pack(&source, &store, &options(voxel_type), &Cutter { path: path.clone(), left });
            match stopped.unwrap_err() {
                PackError::Source { error: ImportError::Invalid { path: named, problem }, .. } => {
                    assert!(named == path && problem.contains("changed while it was read"), "{problem}");
                }
                other => panic!("{other}"),
            }
            assert!(Store::open(&store).is_err(), "there is no store");
        }
    }
}

/// A source that must decode whole planes, at a cost in memory.
struct Decoding(Array<u8>, u64);

impl Source for Decoding {
    fn info(&self) -> &SourceInfo {
        &self.0.info
    }

    fn access(&self) -> Access {
        self.0.access
    }

    fn reader_bytes(&self) -> u64 {
        self.1
    }

    fn read_box(&self, time: u32, channel: u32, region: VoxelBox, out: &mut [u8]) -> Result<(), ImportError> {
        self.0.read_box(time, channel, region, out)
    }
}

/// The source's decoding memory is counted, and a refusal names a sufficient amount.
#[test]
fn memory_of_the_readers_is_counted() {
    let extent = [64, 32, 5];
    let of = |access, reader_bytes| Decoding(Array { access, ..Array::new(extent, |_| 1) }, reader_bytes);
    let needed = |source: &Decoding, memory_bytes| {
        let options = PackOptions { memory_bytes, threads: 3, ..options(VoxelType::U8) };
        match plan(source, &options) {
            Err(PackError::Memory { needed_bytes, .. }) => needed_bytes,
            other => panic!("{other:?}"),
        }
    };
    let least = needed(&of(Access::Box, 0), 0);
    assert_eq!(needed(&of(Access::Box, 1 << 30), 0), least + (3 << 30), "each thread reads");
    let by_planes = of(Access::Planes, 1 << 30);
    let enough = needed(&by_planes, 0);
    assert_eq!(enough, least + (1 << 30), "one reads, into the window");
    needed(&by_planes, enough - 1);
    let allowed = PackOptions { memory_bytes: enough, threads: 3, ..options(VoxelType::U8) };
    assert!(plan(&by_planes, &allowed).unwrap().memory_bytes >= enough);
}
