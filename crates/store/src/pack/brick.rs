//! One brick's way from its voxels to what is kept of it: core, ranges, counts, and its part of the next level.
//!
//! A run of bricks is read with one voxel around it, clipped to the volume. Replicating the volume's faces would add no new
//! value, so ranges need no copies; the core is filled up with its last voxels, which keeps a constant brick constant and
//! makes means over odd extents those of what exists.

use crate::downsample::{Downsample, downsample};
use crate::stats::{Measure, Range, Tally, WordCounter};
use brickyard_volume::VoxelBox;

/// Neighbours along x that are read as one box: two, as far as that stays in a processor's second-level cache. Longer rows
/// make reading a fifth cheaper, since fewer pages and cache lines are touched twice.
pub(crate) const fn run_length(edge: usize, voxel_bytes: usize) -> usize {
    if box_voxels(edge, 2) * voxel_bytes <= 5 << 18 { 2 } else { 1 }
}

const fn box_voxels(edge: usize, run: usize) -> usize {
    (run * edge + 2) * (edge + 2) * (edge + 2)
}

/// One thread's buffers for bricks of one edge.
pub(crate) struct Workspace<T> {
    edge: usize,
    /// A run of bricks and one voxel around it, packed.
    pub(crate) padded: Vec<T>,
    /// The core, `edge`^3.
    pub(crate) core: Vec<T>,
    /// The core's part of the next level, packed.
    pub(crate) coarse: Vec<T>,
    /// Level-0 voxels by value.
    pub(crate) counter: WordCounter,
}

/// Where a brick lies in the box that was read, and how it is brought to the next level.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Cut {
    /// Voxels of a row of the box.
    pitch: usize,
    /// Of the brick and what surrounds it, the first voxel in such a row.
    column: usize,
    /// Extent of the brick and what surrounds it.
    padded: [usize; 3],
    /// The core's first voxel in that.
    offset: [usize; 3],
    /// The core's extent, at most `edge`.
    core: [usize; 3],
    /// Voxels per coarser voxel; `None` at the coarsest level.
    factor: Option<[usize; 3]>,
}

impl Cut {
    /// The cut of `core` out of a box that holds it and what surrounds it.
    pub(crate) fn new(padded: VoxelBox, core: VoxelBox, factor: Option<[usize; 3]>) -> Self {
        Self::within(padded, padded, core, factor)
    }

    /// The cut of `core`, which has `padded` around it, out of a box that is longer along x.
    pub(crate) fn within(whole: VoxelBox, padded: VoxelBox, core: VoxelBox, factor: Option<[usize; 3]>) -> Self {
        let extent = |b: VoxelBox| b.extent().to_array().map(|n| n as usize);
        let (from, to) = (padded.min.to_array(), core.min.to_array());
        Self {
            pitch: whole.extent().x as usize,
            column: (padded.min.x - whole.min.x) as usize,
            padded: extent(padded),
            offset: std::array::from_fn(|a| (to[a] - from[a]) as usize),
            core: extent(core),
            factor,
        }
    }

    /// The place in the box of row `y` of slice `z` of the brick and what surrounds it.
    #[inline(always)]
    fn row(&self, y: usize, z: usize) -> usize {
        (z * self.padded[1] + y) * self.pitch + self.column
    }

    fn is_whole(&self, edge: usize) -> bool {
        self.core == [edge; 3]
    }

    /// The core's voxels.
    pub(crate) fn voxels(&self) -> u64 {
        self.core.iter().map(|&n| n as u64).product()
    }
}

/// What is known of a brick.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Summary<T> {
    /// Valid voxels of the core.
    pub(crate) core: Range<T>,
    /// Valid voxels of the core and one voxel around it.
    pub(crate) reach: Range<T>,
    /// Of the core; only at level 0.
    pub(crate) tally: Tally,
    /// Whether every voxel of the core is the fill value, all bits zero.
    pub(crate) is_fill: bool,
}

impl<T: Measure> Workspace<T> {
    pub(crate) fn new(edge: usize) -> Self {
        Self {
            edge,
            padded: vec![T::default(); box_voxels(edge, run_length(edge, size_of::<T>()))],
            core: vec![T::default(); edge.pow(3)],
            // At least one axis is halved.
            coarse: vec![T::default(); edge.pow(3) / 2],
            counter: WordCounter::new(),
        }
    }

    /// Bytes that the buffers take.
    pub(crate) const fn bytes(edge: usize, voxel_bytes: usize) -> usize {
        let run = box_voxels(edge, run_length(edge, voxel_bytes));
        (run + edge.pow(3) + edge.pow(3) / 2) * voxel_bytes + crate::stats::COUNTER_BYTES
    }

    /// Cuts the core out of `padded` and measures it; counts its voxels if `finest`.
    pub(crate) fn digest(&mut self, cut: &Cut, method: Downsample, finest: bool) -> Summary<T> {
        #[cfg(target_arch = "x86_64")]
        if std::arch::is_x86_feature_detected!("avx2") {
            #[target_feature(enable = "avx2")]
            fn digest_avx2<T: Measure>(w: &mut Workspace<T>, cut: &Cut, m: Downsample, finest: bool) -> Summary<T> {
                w.digest_any(cut, m, finest)
            }
            // SAFETY: the processor has the feature.
            return unsafe { digest_avx2(self, cut, method, finest) };
        }
        self.digest_any(cut, method, finest)
    }

    #[inline(always)]
    fn digest_any(&mut self, cut: &Cut, method: Downsample, finest: bool) -> Summary<T> {
        self.cut_core(cut);
        let core = T::range(&self.core);
        let reach = core.join(self.shell(cut));
        let mut tally = Tally::default();
        if finest {
            self.count(cut, &mut tally);
        }
        if let Some(factor) = cut.factor {
            // Odd extents include one of the voxels that fill the core up.
            let shape = std::array::from_fn(|a| cut.core[a].next_multiple_of(factor[a]));
            downsample(method, &self.core, self.edge, shape, factor, &mut self.coarse);
        }
        let is_fill = core.low == T::default()
            && core.high == T::default()
            && bytemuck::cast_slice::<T, u8>(&self.core).iter().all(|&b| b == 0);
        Summary { core, reach, tally, is_fill }
    }

    /// Copies the core, filled up with its last voxel, row and slice.
    #[inline(always)]
    fn cut_core(&mut self, cut: &Cut) {
        let (edge, [nx, ny, nz]) = (self.edge, cut.core);
        let slice = edge * edge;
        for z in 0..nz {
            for y in 0..ny {
                let from = cut.row(y + cut.offset[1], z + cut.offset[2]) + cut.offset[0];
                let row = &mut self.core[z * slice + y * edge..][..edge];
                row[..nx].copy_from_slice(&self.padded[from..from + nx]);
                let last = row[nx - 1];
                row[nx..].fill(last);
            }
            for y in ny..edge {
                let last = z * slice + (ny - 1) * edge;
                self.core.copy_within(last..last + edge, z * slice + y * edge);
            }
        }
        for z in nz..edge {
            self.core.copy_within((nz - 1) * slice..nz * slice, z * slice);
        }
    }

    /// The range of what surrounds the core in the box.
    #[inline(always)]
    fn shell(&self, cut: &Cut) -> Range<T> {
        let [px, py, pz] = cut.padded;
        let inside = |a: usize, i: usize| (cut.offset[a]..cut.offset[a] + cut.core[a]).contains(&i);
        let mut range = T::EMPTY;
        for z in 0..pz {
            for y in 0..py {
                let row = &self.padded[cut.row(y, z)..][..px];
                if inside(2, z) && inside(1, y) {
                    // At most one voxel on each side; where there is none, one of the core, which adds nothing.
                    range = range.join(T::range_of(row[0])).join(T::range_of(row[px - 1]));
                } else {
                    range = range.join(T::range(row));
                }
            }
        }
        range
    }

    #[inline(always)]
    fn count(&mut self, cut: &Cut, tally: &mut Tally) {
        if cut.is_whole(self.edge) {
            T::count(&self.core, &mut self.counter);
            T::tally(&self.core, tally);
            return;
        }
        for z in 0..cut.core[2] {
            for y in 0..cut.core[1] {
                let row = &self.core[(z * self.edge + y) * self.edge..][..cut.core[0]];
                T::count(row, &mut self.counter);
                T::tally(row, tally);
            }
        }
    }

    /// The same as [`Workspace::digest`] at level 0 for a box of which every voxel is `value`, which is finite.
    pub(crate) fn digest_constant(&mut self, cut: &Cut, value: T) -> Summary<T> {
        self.core.fill(value);
        let range = Range { low: value, high: value };
        self.counter.constant(value, cut.voxels());
        if let Some(factor) = cut.factor {
            let n = (0..3).map(|a| cut.core[a].div_ceil(factor[a])).product();
            self.coarse[..n].fill(value);
        }
        let tally = Tally { sum: value.to_f64() * cut.voxels() as f64, ..Tally::default() };
        Summary { core: range, reach: range, tally, is_fill: bytemuck::bytes_of(&value).iter().all(|&b| b == 0) }
    }
}
