//! Processing of one brick: from its voxels to core, ranges, counts, and its part of the next level.
//!
//! Cores are read in runs along x: long rows, once through the source's memory, make reading cheap. Ranges shared with
//! neighbours are kept by part (`parts.rs`). Cores at the far faces are padded with their last voxels, which keeps
//! constant bricks constant and averages only existing voxels over odd extents.

use crate::downsample::{Downsample, Reduction, downsample};
use crate::nodata;
use crate::pack::parts::Parts;
use crate::stats::{Counter, Measure, Range, Tally};
use brickyard_import::Lent;
use brickyard_volume::labels::label_of;

/// Bricks read together, at least 1: rows of 1 KiB, and at most 4 MiB of cores, which fit a last-level cache.
pub(crate) const fn run_length(edge: usize, voxel_bytes: usize) -> usize {
    let by_row = 1024 / (edge * voxel_bytes);
    let by_cores = (4 << 20) / (edge.pow(3) * voxel_bytes);
    let run = if by_row < by_cores { by_row } else { by_cores };
    if run > 1 { run } else { 1 }
}

/// One thread's buffers for bricks of one edge length.
pub(crate) struct Workspace<T> {
    edge: usize,
    /// The value marking voxels without data.
    nodata: Option<T>,
    /// A run of cores, `edge`^3 each.
    cores: Vec<T>,
    /// The last reduced part of the next level, packed.
    pub(crate) coarse: Vec<T>,
    /// Counts of level-0 voxels by value.
    pub(crate) counter: Counter,
}

/// Measurements of a brick's core.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Summary<T> {
    /// The ranges of the core's valid voxels, by part.
    pub(crate) parts: Parts<T>,
    /// Sums and counts for the channel's statistics; empty except at level 0.
    pub(crate) tally: Tally,
    /// Whether every voxel has all bits zero, the fill value.
    pub(crate) is_fill: bool,
}

impl<T: Measure> Workspace<T> {
    pub(crate) fn new(edge: usize, nodata: Option<T>) -> Self {
        Self {
            edge,
            nodata,
            cores: vec![T::default(); run_length(edge, size_of::<T>()) * edge.pow(3)],
            // At least one axis is halved.
            coarse: vec![T::default(); edge.pow(3) / 2],
            counter: Counter::new(T::TYPE),
        }
    }

    pub(crate) const fn bytes(edge: usize, voxel_bytes: usize) -> usize {
        (run_length(edge, voxel_bytes) * edge.pow(3) + edge.pow(3) / 2) * voxel_bytes + Counter::bytes(voxel_bytes)
    }

    /// Core `i` of the run.
    pub(crate) fn core(&self, i: usize) -> &[T] {
        &self.cores[i * self.edge.pow(3)..][..self.edge.pow(3)]
    }

    pub(crate) fn core_mut(&mut self, i: usize) -> &mut [T] {
        &mut self.cores[i * self.edge.pow(3)..][..self.edge.pow(3)]
    }

    /// Copies lent slices into a run of cores, `shape` voxels in all.
    pub(crate) fn gather(&mut self, lent: Lent, shape: [usize; 3]) {
        let (row, slice, core) =
            (self.row_bytes(), self.edge * self.row_bytes(), self.edge * self.edge * self.row_bytes());
        let cores: &mut [u8] = bytemuck::cast_slice_mut(&mut self.cores);
        for (i, z) in lent.slices.enumerate() {
            for y in 0..shape[1] {
                let from = &lent.bytes[i * lent.slice_bytes + y * lent.row_bytes..][..shape[0] * size_of::<T>()];
                for (i, piece) in from.chunks(row).enumerate() {
                    copy(piece, &mut cores[i * core + z * slice + y * row..][..piece.len()]);
                }
            }
        }
    }

    fn row_bytes(&self) -> usize {
        self.edge * size_of::<T>()
    }

    /// Moves voxels of `shape`, packed at the start of core `i`, to their places in the core.
    pub(crate) fn spread(&mut self, i: usize, shape: [usize; 3]) {
        let edge = self.edge;
        spread(self.core_mut(i), edge, shape);
    }

    /// Replaces every `value` in core `i` by NaN, for floats.
    pub(crate) fn blank(&mut self, i: usize, value: T) {
        let invalid = T::from_f64_rounded(f64::NAN);
        for voxel in self.core_mut(i).iter_mut().filter(|voxel| **voxel == value) {
            *voxel = invalid;
        }
    }

    /// Pads core `i` beyond `shape`, its extent, and measures it. Counts its voxels if `finest`.
    pub(crate) fn digest(&mut self, i: usize, shape: [usize; 3], finest: bool) -> Summary<T> {
        #[cfg(target_arch = "x86_64")]
        if std::arch::is_x86_feature_detected!("avx2") {
            #[target_feature(enable = "avx2")]
            fn digest_avx2<T: Measure>(w: &mut Workspace<T>, i: usize, shape: [usize; 3], finest: bool) -> Summary<T> {
                w.digest_any(i, shape, finest)
            }
            // SAFETY: the processor has the feature.
            return unsafe { digest_avx2(self, i, shape, finest) };
        }
        self.digest_any(i, shape, finest)
    }

    #[inline(always)]
    fn digest_any(&mut self, i: usize, shape: [usize; 3], finest: bool) -> Summary<T> {
        let core = &mut self.cores[i * self.edge.pow(3)..][..self.edge.pow(3)];
        fill_up(core, self.edge, shape);
        // Bricks without no-data voxels are measured as if there were no such value.
        let nodata = self.nodata.filter(|&nodata| nodata::is_in(core, nodata));
        let mut tally = Tally::default();
        if finest {
            count(core, self.edge, shape, nodata, &mut self.counter, &mut tally);
        }
        let parts = Parts::of(core, self.edge, shape, nodata);
        let Range { low, high } = parts.whole();
        let may_be_fill = low == T::default() && high == T::default() || nodata == Some(T::default());
        let is_fill = may_be_fill && bytemuck::cast_slice::<T, u8>(core).iter().all(|&b| b == 0);
        Summary { parts, tally, is_fill }
    }

    /// Fills core `i` with the finite `value`, and measures it like [`Workspace::digest`] at level 0.
    pub(crate) fn digest_constant(&mut self, i: usize, shape: [usize; 3], value: T) -> Summary<T> {
        let voxels = shape.iter().product::<usize>();
        self.core_mut(i).fill(value);
        let is_fill = bytemuck::bytes_of(&value).iter().all(|&b| b == 0);
        if self.nodata == Some(value) {
            let tally = Tally { nodata: voxels as u64, ..Tally::default() };
            return Summary { parts: Parts::uniform(T::EMPTY), tally, is_fill };
        }
        self.counter.constant(value, voxels as u64);
        let parts = Parts::uniform(Range { low: value, high: value });
        let tally = Tally { sum: value.to_f64() * voxels as f64, ..Tally::default() };
        Summary { parts, tally, is_fill }
    }

    /// The first voxel of the digested core `i` between two labels, with its place; NaN and infinities have no data.
    pub(crate) fn fraction(&self, i: usize) -> Option<([u32; 3], f64)> {
        if !T::TYPE.is_float() {
            return None;
        }
        // The padding repeats voxels before it.
        let values = self.core(i).iter().map(|voxel| voxel.to_f64());
        let (at, value) = values.enumerate().find(|(_, value)| value.is_finite() && label_of(*value).is_none())?;
        Some(([at % self.edge, at / self.edge % self.edge, at / self.edge.pow(2)].map(|n| n as u32), value))
    }

    /// Reduces the digested core `i` to its part of the next level, by `factor` voxels.
    pub(crate) fn reduce(&mut self, i: usize, shape: [usize; 3], factor: [usize; 3], method: Downsample) {
        let core = &self.cores[i * self.edge.pow(3)..][..self.edge.pow(3)];
        reduce(Reduction { method, edge: self.edge, shape, factor }, core, self.nodata, &mut self.coarse);
    }
}

/// Reduces a padded core, of `reduction.shape` voxels, to its part of the next level, packed in `out`. A voxel is `nodata` only if all of its finer
/// ones are.
pub(crate) fn reduce<T: Measure>(reduction: Reduction, core: &[T], nodata: Option<T>, out: &mut [T]) {
    // Odd extents include one of the padding voxels.
    let shape: [usize; 3] = std::array::from_fn(|a| reduction.shape[a].next_multiple_of(reduction.factor[a]));
    let reduction = Reduction { shape, ..reduction };
    let Some(nodata) = nodata else { return reduce_whole(reduction, core, out) };
    let mut is_marked = nodata::is_in(core, nodata);
    if !is_marked {
        reduce_whole(reduction, core, out);
        // A mean may equal that value even if no voxel does.
        let voxels = (0..3).map(|a| shape[a] / reduction.factor[a]).product();
        is_marked = nodata::is_in(&out[..voxels], nodata);
    }
    if is_marked {
        nodata::downsample(reduction, core, nodata, out);
    }
}

/// Reduces a core, whose integers all have data, to its part of the next level.
fn reduce_whole<T: Measure>(reduction: Reduction, core: &[T], out: &mut [T]) {
    #[cfg(target_arch = "x86_64")]
    if std::arch::is_x86_feature_detected!("avx2") {
        #[target_feature(enable = "avx2")]
        fn downsample_avx2<T: Measure>(reduction: Reduction, core: &[T], out: &mut [T]) {
            downsample(reduction, core, out);
        }
        // SAFETY: the processor has the feature.
        return unsafe { downsample_avx2(reduction, core, out) };
    }
    downsample(reduction, core, out);
}

/// Copies by cache lines, cheaper than a call for each short row.
#[inline(always)]
fn copy(from: &[u8], to: &mut [u8]) {
    let (from, from_rest) = from.as_chunks::<64>();
    let (to, to_rest) = to.as_chunks_mut::<64>();
    to.copy_from_slice(from);
    to_rest.copy_from_slice(from_rest);
}

/// Moves voxels of `shape`, packed at the start of a core, to their places in it.
pub(crate) fn spread<T: Copy>(core: &mut [T], edge: usize, [nx, ny, nz]: [usize; 3]) {
    if nx < edge || ny < edge {
        // From the last row on: none is overwritten before it has moved.
        for row in (0..ny * nz).rev() {
            core.copy_within(row * nx..(row + 1) * nx, (row / ny * edge + row % ny) * edge);
        }
    }
}

/// Pads a core with the last voxel of each row, then with the last row and the last slice of `shape`.
#[inline(always)]
pub(crate) fn fill_up<T: Copy>(core: &mut [T], edge: usize, [nx, ny, nz]: [usize; 3]) {
    let slice = edge * edge;
    for z in 0..nz {
        for y in 0..if nx < edge { ny } else { 0 } {
            let row = &mut core[z * slice + y * edge..][..edge];
            let last = row[nx - 1];
            row[nx..].fill(last);
        }
        for y in ny..edge {
            let last = z * slice + (ny - 1) * edge;
            core.copy_within(last..last + edge, z * slice + y * edge);
        }
    }
    for z in nz..edge {
        core.copy_within((nz - 1) * slice..nz * slice, z * slice);
    }
}

/// Counts and sums the voxels of `shape`, without `nodata` ones.
#[inline(always)]
fn count<T: Measure>(
    core: &[T],
    edge: usize,
    shape: [usize; 3],
    nodata: Option<T>,
    counter: &mut Counter,
    tally: &mut Tally,
) {
    let mut add = |voxels: &[T]| nodata::count(voxels, nodata, counter, tally);
    if shape == [edge; 3] {
        return add(core);
    }
    for z in 0..shape[2] {
        (0..shape[1]).for_each(|y| add(&core[(z * edge + y) * edge..][..shape[0]]));
    }
}
