//! Previews of volumes before they are packed: every n-th voxel of a source, at most 256 along an axis.
//!
//! The first time step of each channel is read on creation, to find the range of values; every other one on the first
//! request for one of its bricks. Each is read whole by all processors, made into bricks by the packer's kernels, and
//! kept within the preview's memory. That memory is the preview's own: it exists once, however many sessions and layers
//! show the preview, outside all sessions' budgets. Reading 256^3 voxels takes from a tenth of a second (a raw file in
//! the page cache) to as long as decoding 256 planes.

use crate::session::volume_source::VolumeSource;
use crate::window::background::Meter;
use brickyard_import::{ImportError, Source, SourceInfo, Strided};
use brickyard_pager::{BrickError, BrickSource};
use brickyard_store::{ChannelStatistics, Downsample, Kind, LevelBricks};
use brickyard_volume::{
    BrickId, DEFAULT_BRICK_EDGE, Geometry, OccupancyBins, PlacementError, Pyramid, VoxelBox, VoxelType,
};
use lru::LruCache;
use std::num::NonZeroUsize;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// The most voxels of a preview along an axis.
pub const PREVIEW_EDGE: u32 = 256;
/// Least voxels along the longest axis of a preview reduced for many channels.
const LEAST_EDGE: u32 = 64;
/// Divisor of a preview's memory for the share of all reading threads, exceeded only if a single one needs more.
const READING_PART: u64 = 4;

/// Errors in making a preview.
#[derive(Debug, thiserror::Error)]
pub enum PreviewError {
    /// The source cannot be read.
    #[error(transparent)]
    Source(#[from] ImportError),
    /// The source's orientation is invalid.
    #[error(transparent)]
    Placement(#[from] PlacementError),
    /// The observer cancelled the work.
    #[error("cancelled")]
    Cancelled,
}

/// Every n-th voxel of a source along each axis, as bricks of all levels. Ranges, windows and statistics are the first
/// time step's; values of other steps outside the range may be shown as its ends.
pub struct Preview {
    source: Strided,
    pyramid: Pyramid,
    kind: Kind,
    memory_bytes: u64,
    statistics: Vec<ChannelStatistics>,
    kept: Mutex<LruCache<(u32, u32), Step>>,
    /// Held while an array is read, to read one at a time.
    reading: Mutex<()>,
    /// For all reading after the creation.
    meter: Meter,
}

/// One channel at one time step, or its read error.
type Step = Result<Arc<LevelBricks>, String>;

impl Preview {
    /// Reads the first time step of every channel. The preview takes at most `memory_bytes`: with many channels, its
    /// resolution is halved until they fit, down to 64 voxels along the longest axis. This least size, or a single
    /// large reader, may exceed the limit: see [`Preview::held_bytes`].
    ///
    /// # Errors
    /// If the source cannot be read, its orientation is invalid, or `meter` cancels the work.
    pub fn read(source: Arc<dyn Source>, kind: Kind, memory_bytes: u64, meter: &Meter) -> Result<Self, PreviewError> {
        let of_steps = memory_bytes - memory_bytes / READING_PART;
        let mut edge = PREVIEW_EDGE;
        let (source, pyramid, step_bytes, making_bytes) = loop {
            let strided = Strided::new(source.clone(), edge)?;
            let info = strided.info();
            let pyramid = Pyramid::new(info.extent, info.geometry.spacing.to_array(), DEFAULT_BRICK_EDGE);
            let step_bytes = LevelBricks::bytes(&pyramid, info.voxel_type);
            let making_bytes = making_bytes(info, step_bytes);
            if u64::from(info.channels) * step_bytes + making_bytes <= of_steps || edge == LEAST_EDGE {
                break (strided, pyramid, step_bytes, making_bytes);
            }
            edge /= 2;
        };
        let info = source.info().clone();
        let capacity = of_steps.saturating_sub(making_bytes) / step_bytes;
        let capacity = capacity.clamp(1, u64::from(info.channels) * u64::from(info.times));
        let kept = LruCache::new(NonZeroUsize::new(capacity as usize).unwrap_or(NonZeroUsize::MIN));
        let (kept, reading) = (Mutex::new(kept), Mutex::default());
        let mut preview = Self {
            source,
            pyramid,
            kind,
            memory_bytes,
            statistics: Vec::new(),
            kept,
            reading,
            meter: Meter::default(),
        };
        meter.set(0, u64::from(info.channels) * voxels_bytes(&info));
        for channel in 0..info.channels {
            let (bricks, mut statistics) = preview.read_step(0, channel, meter)?;
            if let Some(look) = info.channel_looks.get(channel as usize) {
                statistics.take_look(look);
            }
            preview.statistics.push(statistics);
            preview.kept().put((0, channel), Ok(Arc::new(bricks)));
        }
        Ok(preview)
    }

    /// Returns the preview as a volume, placed and shown like a store of the same source.
    ///
    /// # Errors
    /// If the source's orientation does not fit its spacing.
    pub fn volume(self: &Arc<Self>) -> Result<VolumeSource, PlacementError> {
        let volume = VolumeSource::new(self.clone()).described_by(self.statistics.clone()).holding(self.held_bytes());
        let volume = volume.with_stride(self.stride());
        match self.source.info().orientation {
            Some(orientation) => volume.oriented(orientation),
            None => Ok(volume),
        }
    }

    /// The source's voxels per voxel of the preview, along x, y, z.
    pub fn stride(&self) -> [u32; 3] {
        self.source.stride()
    }

    /// Stops reading: missing time steps stay missing. For a window that closes, or has the store.
    pub fn close(&self) {
        self.meter.cancel();
    }

    fn kept(&self) -> MutexGuard<'_, LruCache<(u32, u32), Step>> {
        self.kept.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The most memory of the preview from now on, in bytes, however many sessions show it.
    pub fn held_bytes(&self) -> u64 {
        let info = self.source.info();
        let step_bytes = LevelBricks::bytes(&self.pyramid, info.voxel_type);
        let kept = self.kept().cap().get() as u64;
        let is_all_kept = info.times == 1 && kept >= u64::from(info.channels);
        let reading = making_bytes(info, step_bytes) + self.threads() * self.source.reader_bytes();
        // A complete preview reads nothing any more.
        kept * step_bytes + if is_all_kept { 0 } else { reading }
    }

    /// Returns the bricks of one channel at one time step, from memory or from the source.
    fn step(&self, time: u32, channel: u32) -> Step {
        if let Some(step) = self.kept().get(&(time, channel)) {
            return step.clone();
        }
        let _one = self.reading.lock().unwrap_or_else(PoisonError::into_inner);
        // Another thread may have read it meanwhile.
        if let Some(step) = self.kept().get(&(time, channel)) {
            return step.clone();
        }
        let step = match self.read_step(time, channel, &self.meter) {
            Ok((bricks, _)) => Ok(Arc::new(bricks)),
            Err(error) => Err(error.to_string()),
        };
        // Failures too: otherwise each of the bricks would read everything again.
        if !self.meter.is_cancelled() {
            self.kept().put((time, channel), step.clone());
        }
        step
    }

    /// Reads one channel at one time step, on several threads, and makes its levels.
    fn read_step(
        &self,
        time: u32,
        channel: u32,
        meter: &Meter,
    ) -> Result<(LevelBricks, ChannelStatistics), PreviewError> {
        let info = self.source.info();
        let mut voxels = vec![0; voxels_bytes(info) as usize];
        let plane_bytes = voxels.len() / info.extent.z as usize;
        let planes = Mutex::new((0..).zip(voxels.chunks_exact_mut(plane_bytes)));
        let failure = Mutex::new(None);
        let read = || {
            while !meter.is_cancelled() {
                let next = planes.lock().unwrap_or_else(PoisonError::into_inner).next();
                let Some((z, plane)) = next else { break };
                let region = VoxelBox::new([0, 0, z], [info.extent.x, info.extent.y, z + 1]);
                if let Err(error) = self.source.read_box(time, channel, region, plane) {
                    failure.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(error);
                    break;
                }
                meter.advance(plane_bytes as u64);
            }
        };
        std::thread::scope(|scope| (0..self.threads()).for_each(|_| drop(scope.spawn(read))));
        if let Some(error) = failure.into_inner().unwrap_or_else(PoisonError::into_inner) {
            return Err(error.into());
        }
        if meter.is_cancelled() {
            return Err(PreviewError::Cancelled);
        }
        let method = match self.kind {
            Kind::Image => Downsample::Mean,
            Kind::Labels => Downsample::Mode,
        };
        Ok(LevelBricks::make(&self.pyramid, info.voxel_type, method, info.sought_nodata(), &voxels))
    }

    /// The number of reading threads, by processors and memory.
    fn threads(&self) -> u64 {
        let processors = std::thread::available_parallelism().map_or(1, usize::from) as u64;
        (self.memory_bytes / READING_PART / self.source.reader_bytes().max(1)).clamp(1, processors)
    }
}

fn voxels_bytes(info: &SourceInfo) -> u64 {
    info.extent.volume() * info.voxel_type.bytes() as u64
}

/// Bytes needed to make a channel's bricks at one time step: its voxels, and its bricks, whose place another step's may
/// still occupy while one of them is copied.
fn making_bytes(info: &SourceInfo, step_bytes: u64) -> u64 {
    step_bytes + voxels_bytes(info)
}

impl BrickSource for Preview {
    fn pyramid(&self) -> &Pyramid {
        &self.pyramid
    }

    fn geometry(&self) -> &Geometry {
        &self.source.info().geometry
    }

    fn voxel_type(&self) -> VoxelType {
        self.source.info().voxel_type
    }

    fn value_range(&self) -> (f64, f64) {
        let ranges = self.statistics.iter().filter(|channel| channel.count > 0).map(|channel| channel.range.into());
        ranges.reduce(|a: (f64, f64), b| (a.0.min(b.0), a.1.max(b.1))).unwrap_or_default()
    }

    fn channel_range(&self, channel: u32) -> (f64, f64) {
        self.statistics[channel as usize].range.into()
    }

    fn is_labels(&self) -> bool {
        self.kind == Kind::Labels
    }

    fn has_non_finite(&self) -> bool {
        // The values of later time steps are still unknown.
        let may_come = self.times() > 1 && self.voxel_type().is_float();
        may_come || self.statistics.iter().any(ChannelStatistics::has_non_finite)
    }

    fn nodata(&self) -> Option<f64> {
        // Those of floats become NaN.
        let nodata = self.source.info().nodata.filter(|_| !self.voxel_type().is_float());
        nodata.filter(|_| self.times() > 1 || self.statistics.iter().any(|channel| channel.nodata > 0))
    }

    fn times(&self) -> u32 {
        self.source.info().times
    }

    fn channels(&self) -> u32 {
        self.source.info().channels
    }

    fn occupancy_bins(&self, channel: u32) -> OccupancyBins {
        self.statistics[channel as usize].bins
    }

    fn read_core(&self, id: BrickId, out: &mut [u8]) -> Result<(), BrickError> {
        let step = self.step(id.time, id.channel);
        let bricks = step.map_err(|reason| BrickError { id, reason, is_passing: false })?;
        out.copy_from_slice(bricks.core(id.level, id.index));
        Ok(())
    }

    fn bytes_read(&self) -> u64 {
        self.meter.progress().0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::session::backend::BackendChoice;
    use crate::session::channels::default_layers;
    use crate::session::{Session, SessionOptions, resolve};
    use brickyard_import::Access;
    use brickyard_store::{PackOptions, pack};
    use brickyard_volume::{BrickIndex, ChannelLook, Extent, Level, LevelGrid, LevelPolicy, Mode, Orientation, Scene};
    use glam::DVec3;
    use std::sync::atomic::{AtomicU32, Ordering};

    /// A source of computed voxels that counts its planes, and fails at a time step.
    struct Computed {
        info: SourceInfo,
        value: fn(&SourceInfo, u32, u32, [u32; 3]) -> f64,
        access: Access,
        planes: AtomicU32,
        fails_at: Option<u32>,
    }

    impl Computed {
        fn new(info: SourceInfo, value: fn(&SourceInfo, u32, u32, [u32; 3]) -> f64) -> Self {
            Self { info, value, access: Access::Planes, planes: AtomicU32::new(0), fails_at: None }
        }
    }

    impl Source for Computed {
        fn info(&self) -> &SourceInfo {
            &self.info
        }

        fn access(&self) -> Access {
            self.access
        }

        fn read_box(&self, time: u32, channel: u32, region: VoxelBox, out: &mut [u8]) -> Result<(), ImportError> {
            if self.fails_at == Some(time) {
                return Err(ImportError::Invalid { path: "scan.tif".into(), problem: "is cut short".into() });
            }
            self.planes.fetch_add(region.extent().z, Ordering::Relaxed);
            let (min, max) = (region.min, region.max);
            let mut out = out.chunks_exact_mut(self.info.voxel_type.bytes());
            for z in min.z..max.z {
                for y in min.y..max.y {
                    for x in min.x..max.x {
                        let value = (self.value)(&self.info, time, channel, [x, y, z]);
                        let out = out.next().expect("the box has as many voxels");
                        match self.info.voxel_type {
                            VoxelType::F32 => out.copy_from_slice(&(value as f32).to_le_bytes()),
                            _ => out.copy_from_slice(&(value as i16).to_le_bytes()),
                        }
                    }
                }
            }
            Ok(())
        }
    }

    fn info(extent: [u32; 3], voxel_type: VoxelType) -> SourceInfo {
        SourceInfo {
            geometry: Geometry {
                spacing: DVec3::new(0.5, 1.0, 4.0),
                origin: DVec3::new(-9.0, 3.0, 7.0),
                ..Geometry::default()
            },
            calibrated: true,
            identity: "computed".into(),
            ..SourceInfo::of_volume(Extent::from_array(extent), voxel_type)
        }
    }

    /// A ramp in the world: the centre's x + 10 y + 100 z.
    fn ramp(info: &SourceInfo, _: u32, _: u32, place: [u32; 3]) -> f64 {
        let centre = info.geometry.world_from_voxel(DVec3::from_array(place.map(f64::from)) + 0.5);
        centre.dot(DVec3::new(1.0, 10.0, 100.0))
    }

    /// Noise by time and channel, with some voxels of no data.
    fn noise(_: &SourceInfo, time: u32, channel: u32, [x, y, z]: [u32; 3]) -> f64 {
        let key =
            u64::from(x) + 1009 * u64::from(y) + 100_003 * u64::from(z) + 7 * u64::from(time) + 3 * u64::from(channel);
        f64::from((key.wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 55) as u32) - 100.0
    }

    fn preview(source: Computed) -> Preview {
        Preview::read(Arc::new(source), Kind::Image, 1 << 30, &Meter::default()).unwrap()
    }

    fn stored(source: &Computed, kind: Kind) -> (tempfile::TempDir, VolumeSource) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("s.zarr");
        let options = crate::files::openable::pack_options(source.info.voxel_type, kind);
        pack(source, &path, &PackOptions { threads: 2, ..options }, &()).unwrap();
        let volume = VolumeSource::open(&path).unwrap();
        (folder, volume)
    }

    fn for_voxels(source: &dyn BrickSource, time: u32, channel: u32, mut check: impl FnMut([u32; 3], f64)) {
        let (pyramid, voxel_type) = (source.pyramid(), source.voxel_type());
        let LevelGrid { extent, bricks, .. } = pyramid.levels()[0];
        let mut core = vec![0; (pyramid.edge() as usize).pow(3) * voxel_type.bytes()];
        for z in 0..bricks.z {
            for y in 0..bricks.y {
                for x in 0..bricks.x {
                    let index = BrickIndex::new(x, y, z);
                    source.read_core(BrickId { time, channel, level: Level(0), index }, &mut core).unwrap();
                    for (i, place) in pyramid.core_voxels(index).enumerate().filter(|(_, at)| extent.contains(*at)) {
                        check(place, voxel_type.read(&core, i));
                    }
                }
            }
        }
    }

    #[test]
    fn voxels_keep_their_values_and_places() {
        let preview = preview(Computed::new(info([700, 300, 40], VoxelType::F32), ramp));
        assert_eq!(preview.stride(), [3, 2, 1]);
        let (geometry, mut count) = (preview.geometry().clone(), 0);
        for_voxels(&preview, 0, 0, |place, value| {
            let centre = geometry.world_from_voxel(DVec3::from_array(place.map(f64::from)) + 0.5);
            let expected = centre.dot(DVec3::new(1.0, 10.0, 100.0));
            assert!((value - expected).abs() < 0.01, "{place:?}: {value} for {expected}");
            count += 1;
        });
        assert_eq!(count, 233 * 150 * 40);
    }

    #[test]
    fn voxels_are_those_of_a_store_of_the_same_source() {
        for access in [Access::Box, Access::Planes] {
            let of_both = SourceInfo { channels: 2, times: 2, ..info([530, 90, 7], VoxelType::I16) };
            let source = || Computed { access, ..Computed::new(of_both.clone(), noise) };
            let (_folder, store) = stored(&source(), Kind::Image);
            let preview = preview(source());
            let ([by, ..], store) = (preview.stride(), store.store().expect("a store"));
            for (time, channel) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
                let mut whole = vec![0; 530 * 90 * 7 * 2];
                store.read_box(time, channel, Level(0), of_both.extent.full_box(), &mut whole).unwrap();
                for_voxels(&preview, time, channel, |[x, y, z], value| {
                    let there = of_both.extent.linear([x * by + (by - 1) / 2, y, z]);
                    assert_eq!(value, VoxelType::I16.read(&whole, there as usize), "{x} {y} {z}");
                });
            }
        }
    }

    /// For a volume small enough for all of its voxels.
    #[test]
    fn a_volume_looks_as_its_store_does() {
        let look = ChannelLook {
            name: Some("dapi".into()),
            color: Some([0, 128, 255]),
            window: Some([-20.0, 300.0]),
            unit: None,
        };
        let rows = [[-0.5, 0.0, 0.0, 20.0], [0.0, -1.0, 0.0, 5.0], [0.0, 0.0, 4.0, -7.0]];
        for (voxel_type, kind) in [VoxelType::F32, VoxelType::I16]
            .into_iter()
            .zip([Kind::Image, Kind::Labels])
            .chain([(VoxelType::I16, Kind::Image)])
        {
            let described = SourceInfo {
                channels: 2,
                channel_looks: vec![look.clone(), ChannelLook::default()],
                orientation: Some(Orientation::new(rows).unwrap()),
                nodata: Some(-100.0),
                ..info([70, 40, 30], voxel_type)
            };
            let source = || Computed::new(described.clone(), noise);
            let (_folder, store) = stored(&source(), kind);
            let preview = Preview::read(Arc::new(source()), kind, 1 << 30, &Meter::default()).unwrap();
            let volume = Arc::new(preview).volume().unwrap();
            assert_eq!(volume.place(), store.place());
            for channel in 0..2 {
                let [ours, stored] = [&volume, &store].map(|v| v.statistics(channel).expect("statistics").clone());
                let mean = stored.mean;
                assert!((ours.mean - mean).abs() < 1e-9 * mean.abs());
                assert_eq!(ChannelStatistics { mean, ..ours }, stored);
                assert_eq!(volume.source.channel_range(channel), store.source.channel_range(channel));
                let displays = [&volume, &store].map(|v| v.displays()[channel as usize].clone());
                assert!(displays[0] == displays[1] || kind == Kind::Labels, "{displays:?}");
            }
            let facts = |v: &VolumeSource| (v.source.nodata(), v.source.has_non_finite(), v.source.is_labels());
            assert_eq!(facts(&volume), facts(&store));
            let picture = |volume: &VolumeSource| {
                let layers = default_layers(std::slice::from_ref(volume));
                let scene = Scene { layers, ..Scene::default() };
                let options = SessionOptions { backend: BackendChoice::Cpu, ..SessionOptions::default() };
                let mut session = Session::new(vec![volume.clone()], options);
                session.render(&scene, (64, 48)).unwrap().picture
            };
            let (ours, stored) = (picture(&volume), picture(&store));
            assert!(ours.rgb.iter().any(|part| *part != ours.rgb[0]), "nothing is shown");
            assert_eq!(ours.rgb, stored.rgb, "{voxel_type} {kind:?}");
        }
    }

    #[test]
    fn only_what_is_looked_at_is_read_and_kept_as_far_as_memory_reaches() {
        let source = Arc::new(Computed::new(SourceInfo { times: 3, ..info([64, 64, 600], VoxelType::I16) }, noise));
        // One step of every third plane.
        let pyramid = Pyramid::new(Extent::new(64, 64, 200), [0.5, 1.0, 12.0], DEFAULT_BRICK_EDGE);
        let step_bytes = LevelBricks::bytes(&pyramid, VoxelType::I16);
        let meter = Meter::default();
        // One step is kept, one is made, and a part is for reading.
        let preview = Preview::read(source.clone(), Kind::Image, 4 * step_bytes, &meter).unwrap();
        let planes = || source.planes.load(Ordering::Relaxed);
        assert_eq!((planes(), meter.progress()), (200, (64 * 64 * 200 * 2, 64 * 64 * 200 * 2)));
        let look_at = |time| for_voxels(&preview, time, 0, |_, _| ());
        look_at(0);
        assert_eq!(planes(), 200);
        look_at(2);
        look_at(2);
        assert_eq!(planes(), 400);
        look_at(0);
        assert_eq!(planes(), 600);
        assert!((2 * step_bytes..4 * step_bytes).contains(&preview.held_bytes()), "{}", preview.held_bytes());
        // It exists once, however often it is shown.
        assert_eq!(preview.cache_bytes(), 0);
        let held_bytes = preview.held_bytes();
        assert_eq!(Arc::new(preview).volume().unwrap().held_bytes(), held_bytes);
    }

    #[test]
    fn what_is_all_there_takes_no_memory_for_reading() {
        let source = Arc::new(Computed::new(info([64, 64, 200], VoxelType::I16), noise));
        let step_bytes = LevelBricks::bytes(
            &Pyramid::new(Extent::new(64, 64, 200), [0.5, 1.0, 4.0], DEFAULT_BRICK_EDGE),
            VoxelType::I16,
        );
        let preview = Preview::read(source, Kind::Image, 1 << 30, &Meter::default()).unwrap();
        assert_eq!(preview.held_bytes(), step_bytes);
    }

    #[test]
    fn sessions_show_a_preview_that_takes_more_than_their_budgets() {
        let source =
            Computed::new(SourceInfo { channels: 3, times: 9, ..info([130, 130, 130], VoxelType::I16) }, noise);
        let preview = Arc::new(Preview::read(Arc::new(source), Kind::Image, 1 << 30, &Meter::default()).unwrap());
        let host_memory_bytes = 64 << 20;
        assert!(preview.held_bytes() > 2 * host_memory_bytes);
        let volume = preview.volume().unwrap();
        let (backend, mode) = (BackendChoice::Cpu, Mode::Mip);
        let layers = default_layers(std::slice::from_ref(&volume));
        assert_eq!(layers.len(), 3);
        let options = SessionOptions { backend, host_memory_bytes, ..SessionOptions::default() };
        let scene = Scene { mode, layers, ..Scene::default() };
        Session::new(vec![volume], options).render(&scene, (32, 24)).unwrap();
    }

    #[test]
    fn many_channels_have_fewer_voxels() {
        let source = Computed::new(SourceInfo { channels: 3, ..info([400, 10, 10], VoxelType::I16) }, noise);
        let preview = Preview::read(Arc::new(source), Kind::Image, 1 << 20, &Meter::default()).unwrap();
        assert_eq!(preview.stride(), [7, 1, 1]);
    }

    /// One voxel of several is no maximum of them, even at level 0; in a preview of all voxels level 0 is right.
    #[test]
    fn previews_of_some_voxels_lose_maxima_at_every_level() {
        for (extent, expected) in [([400, 10, 10], [vec![0], vec![0]]), ([200, 10, 10], [vec![], vec![0]])] {
            let source = Computed::new(info(extent, VoxelType::I16), noise);
            let preview = Preview::read(Arc::new(source), Kind::Image, 1 << 30, &Meter::default()).unwrap();
            let volumes = [Arc::new(preview).volume().unwrap()];
            for (level, expected) in [0, 1].into_iter().zip(expected) {
                let level = LevelPolicy::Locked(level);
                let scene = Scene { mode: Mode::Mip, level, ..Scene::default() };
                assert_eq!(
                    resolve(&volumes, &scene, (32, 24)).unwrap().doubtful_extremes(&volumes).lost,
                    expected,
                    "{level:?}"
                );
                let fog = Scene { mode: Mode::Average, ..scene };
                assert!(resolve(&volumes, &fog, (32, 24)).unwrap().doubtful_extremes(&volumes).lost.is_empty());
            }
        }
    }

    #[test]
    fn what_cannot_be_read_says_why_once() {
        let of_two = SourceInfo { times: 2, ..info([30, 20, 10], VoxelType::I16) };
        let failing = |time| Arc::new(Computed { fails_at: Some(time), ..Computed::new(of_two.clone(), noise) });
        let read = |source| Preview::read(source, Kind::Image, 1 << 30, &Meter::default());
        let error = read(failing(0)).err().expect("the first step fails");
        assert_eq!(error.to_string(), "scan.tif: is cut short");
        let source = failing(1);
        let preview = read(source).unwrap();
        let mut core = vec![0; 64 * 64 * 64 * 2];
        let id = BrickId { time: 1, channel: 0, level: Level(0), index: BrickIndex::default() };
        for _ in 0..2 {
            let error = preview.read_core(id, &mut core).unwrap_err();
            assert_eq!((error.reason.as_str(), error.is_passing), ("scan.tif: is cut short", false));
        }
        preview.read_core(BrickId { time: 0, ..id }, &mut core).unwrap();
    }

    #[test]
    fn reading_is_cancelled() {
        let source = Arc::new(Computed::new(SourceInfo { times: 2, ..info([30, 20, 10], VoxelType::I16) }, noise));
        let meter = Meter::default();
        meter.cancel();
        let ended = Preview::read(source.clone(), Kind::Image, 1 << 30, &meter);
        assert!(matches!(ended, Err(PreviewError::Cancelled)) && source.planes.load(Ordering::Relaxed) == 0);
        let preview = Preview::read(source.clone(), Kind::Image, 1 << 30, &Meter::default()).unwrap();
        preview.close();
        let id = BrickId { time: 1, channel: 0, level: Level(0), index: BrickIndex::default() };
        preview.read_core(id, &mut vec![0; 64 * 64 * 64 * 2]).unwrap_err();
        assert_eq!(source.planes.load(Ordering::Relaxed), 10);
    }
}
