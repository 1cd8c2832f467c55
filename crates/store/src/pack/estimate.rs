//! The time of a pack, estimated before it starts from a sample of its own work: bricks, or planes, are read, measured, reduced and
//! encoded for at most a quarter of a second, as packing will. Costs that time, a thread's buffers, and nothing for small inputs.

use crate::codec::BrickCodec;
use crate::pack::PackOptions;
use crate::pack::brick::Workspace;
use crate::pack::cascade::{no_data, ratio, shape};
use crate::pack::plan::{PackPlan, Stage};
use crate::scratch::Scratch;
use crate::stats::Measure;
use brickyard_import::{Access, ImportError, Source};
use brickyard_volume::{BrickIndex, Level, VoxelBox, with_voxel_type};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::time::{Duration, Instant};

/// Inputs of fewer bytes are packed too soon for an estimate to matter.
const LEAST_BYTES: u64 = 128 << 20;
/// Time for the sample of inputs of 16 GiB and more; of smaller ones less, some hundredth of their packing.
const PATIENCE: Duration = Duration::from_millis(250);
/// Bytes of the input for each millisecond of the sample.
const BYTES_PER_MS: u64 = 64 << 20;
/// Most bricks of a sample.
const MOST_BRICKS: u64 = 64;

/// Estimates the time of packing `source` by this plan, without its disk's. `None` for small inputs, and where a sample would say little or cost
/// much: steps that are unpacked into scratch space one by one, or unreadable voxels, which the pack itself reports.
pub fn estimate(source: &dyn Source, options: &PackOptions, plan: &PackPlan) -> Option<Duration> {
    let info = source.info();
    let bytes = plan.input_voxels().saturating_mul(info.voxel_type.bytes() as u64);
    if bytes < LEAST_BYTES || info.times > 1 && source.scratch_bytes() > 0 {
        return None;
    }
    // A fault of a reader ends the estimate, as of the pack, which reports it.
    catch_unwind(AssertUnwindSafe(|| with_voxel_type!(info.voxel_type, T => estimate_of::<T>(source, options, plan))))
        .ok()?
}

fn estimate_of<T: Measure>(source: &dyn Source, options: &PackOptions, plan: &PackPlan) -> Option<Duration> {
    let mut sample = Sample::<T>::new(source, options, plan);
    let taken = match source.access() {
        Access::Box => sample.take_bricks(),
        Access::Planes => sample.take_planes(),
    };
    taken.ok().and_then(|()| sample.scaled())
}

/// Work sampled so far.
struct Sample<'a, T> {
    source: &'a dyn Source,
    options: &'a PackOptions,
    plan: &'a PackPlan,
    codec: BrickCodec,
    workspace: Workspace<T>,
    blanked: Option<T>,
    scratch: Scratch,
    encoded: Vec<u8>,
    began: Instant,
    patience: Duration,
    reading: Duration,
    /// Voxels read.
    read: u64,
    working: Duration,
    /// Voxels of encoded cores.
    worked: u64,
}

impl<'a, T: Measure> Sample<'a, T> {
    fn new(source: &'a dyn Source, options: &'a PackOptions, plan: &'a PackPlan) -> Self {
        let info = source.info();
        let bytes = plan.input_voxels().saturating_mul(size_of::<T>() as u64);
        let (nodata, blanked) = no_data(info.sought_nodata());
        Self {
            source,
            options,
            plan,
            codec: BrickCodec::new(options.codec, info.voxel_type, options.edge),
            workspace: Workspace::new(options.edge as usize, nodata),
            blanked,
            scratch: Scratch::default(),
            encoded: Vec::new(),
            began: Instant::now(),
            patience: Duration::from_millis(bytes / BYTES_PER_MS).min(PATIENCE),
            reading: Duration::ZERO,
            read: 0,
            working: Duration::ZERO,
            worked: 0,
        }
    }

    fn finest(&self) -> &'a Stage {
        &self.plan.stages[0]
    }

    fn has_time(&self) -> bool {
        self.began.elapsed() < self.patience
    }

    /// Reads and works through bricks all over the first step, spread evenly.
    fn take_bricks(&mut self) -> Result<(), ImportError> {
        let (grid, channels) = (self.finest().grid().bricks, self.source.info().channels);
        let count = grid.volume() * u64::from(channels);
        let most = count.min(MOST_BRICKS);
        for i in 0..most {
            // Steps of a golden section: any number of them is spread over the whole.
            let part = (0.5 + i as f64 * 0.618_033_988_749_895).fract();
            let at = ((part * count as f64) as u64).min(count - 1);
            let (channel, at) = ((at / grid.volume()) as u32, at % grid.volume());
            let row = u64::from(grid.x);
            let [x, y, z] = [at % row, at / row % u64::from(grid.y), at / row / u64::from(grid.y)].map(|n| n as u32);
            let region = self.finest().layout.pyramid.brick_box(Level(0), BrickIndex::new(x, y, z));
            let voxels = region.extent().volume();
            let start = Instant::now();
            let is_constant = self.source.constant_in(0, channel, region).is_some();
            let core = &mut self.workspace.core_mut(0)[..voxels as usize];
            if is_constant {
                core.fill(T::default());
            } else {
                self.source.read_box(0, channel, region, bytemuck::cast_slice_mut(core))?;
            }
            self.workspace.spread(0, shape(region));
            self.reading += start.elapsed();
            self.read += voxels;
            self.work(region);
            if !self.has_time() {
                break;
            }
        }
        Ok(())
    }

    /// Reads planes from the middle of the first step on, and works through bricks made of their parts, each part once.
    fn take_planes(&mut self) -> Result<(), ImportError> {
        let (extent, edge) = (self.source.info().extent, self.options.edge);
        let mut plane = vec![T::default(); extent.x as usize * extent.y as usize];
        let [tiles_x, tiles_y] = [extent.x, extent.y].map(|n| (n / edge).max(1));
        let [across, down] = [extent.x, extent.y].map(|n| n.min(edge));
        let (row, slice) = (edge as usize, (edge * edge) as usize);
        let mut filled = 0;
        for z in extent.z / 2..extent.z {
            let start = Instant::now();
            let region = VoxelBox::new([0, 0, z], [extent.x, extent.y, z + 1]);
            self.source.read_box(0, 0, region, bytemuck::cast_slice_mut(&mut plane))?;
            self.reading += start.elapsed();
            self.read += plane.len() as u64;
            for (tile_y, tile_x) in (0..tiles_y).flat_map(|y| (0..tiles_x).map(move |x| (y, x))) {
                let core = self.workspace.core_mut(0);
                for y in 0..down as usize {
                    let from = ((tile_y * edge) as usize + y) * extent.x as usize + (tile_x * edge) as usize;
                    core[filled * slice + y * row..][..across as usize]
                        .copy_from_slice(&plane[from..from + across as usize]);
                }
                filled += 1;
                if filled == row {
                    filled = 0;
                    self.work(VoxelBox::new([0; 3], [across, down, edge]));
                    if !self.has_time() {
                        return Ok(());
                    }
                }
            }
            if !self.has_time() {
                break;
            }
        }
        Ok(())
    }

    /// Measures, reduces and encodes core 0.
    fn work(&mut self, region: VoxelBox) {
        let start = Instant::now();
        if let Some(blanked) = self.blanked {
            self.workspace.blank(0, blanked);
        }
        let summary = self.workspace.digest(0, shape(region), true);
        for (coarser, method) in self.plan.coarser(0) {
            let factor = ratio(self.finest().grid(), self.plan.stages[coarser].grid());
            self.workspace.reduce(0, shape(region), factor, method);
        }
        if !summary.is_fill {
            self.encoded.clear();
            self.codec.encode(&mut self.scratch, bytemuck::cast_slice(self.workspace.core(0)), &mut self.encoded);
        }
        self.working += start.elapsed();
        self.worked += region.extent().volume();
    }

    /// The time of all of the pack's work; `None` without a whole brick.
    fn scaled(&self) -> Option<Duration> {
        if self.worked == 0 || self.read == 0 {
            return None;
        }
        let cores = std::thread::available_parallelism().map_or(1, usize::from);
        let threads = self.options.threads.min(cores).max(1) as f64;
        let reading = self.reading.as_secs_f64() / self.read as f64 * self.plan.input_voxels() as f64;
        // Coarser levels and aprons cost what as many bytes of level 0 cost.
        let voxels = self.plan.output_bytes_at_most as f64 / size_of::<T>() as f64;
        let working = self.working.as_secs_f64() / self.worked as f64 * voxels;
        let seconds = match self.source.access() {
            Access::Box => (reading + working) / threads,
            // One thread reads planes while the others work.
            Access::Planes => reading.max(working / threads),
        };
        Duration::try_from_secs_f64(seconds).ok()
    }
}
