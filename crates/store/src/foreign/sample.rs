//! Statistics of a foreign image from a sample, for a window and a histogram to begin with: whole chunks, evenly spread over its finest level with
//! few voxels, else over its coarsest one; the first time step. A sample of one value alone is taken again elsewhere.
//!
//! Costs reading and counting at most [`MOST_VOXELS`] of each channel, three times where there is one value: some tenths of a second.

use crate::error::OpenError;
use crate::metadata::ChannelStatistics;
use crate::nodata;
use crate::pack::cascade::no_data;
use crate::stats::{ChannelTotals, Counter, Measure, Tally};
use brickyard_import::{ImageLevel, ImportError, Source};
use brickyard_objects::is_address;
use brickyard_volume::{Extent, VoxelBox, with_voxel_type};
use rayon::prelude::*;
use std::thread;

/// Most voxels of a channel's sample, but at least a part of one chunk.
const MOST_VOXELS: u64 = 1 << 24;

/// Most voxels of a channel's sample at an address, where each is a byte or more on the way to the first picture.
const MOST_FETCHED_VOXELS: u64 = 1 << 21;

/// Most voxels over all channels; each has a sample of a chunk's part at least.
const MOST_IN_ALL: u64 = 1 << 26;

/// Statistics of each channel, by a sample.
pub(crate) struct Sample {
    pub(crate) channels: Vec<ChannelStatistics>,
    /// Whether the sample is all there is.
    pub(crate) is_whole: bool,
}

/// Takes a sample of an image. Boxes that cannot be read are left out.
///
/// # Errors
/// If none can be read.
pub(crate) fn of(levels: &[ImageLevel]) -> Result<Sample, OpenError> {
    let info = levels[0].source.info();
    let is_fetched = is_address(&levels[0].folder);
    let most = if is_fetched { MOST_FETCHED_VOXELS } else { MOST_VOXELS };
    let most = most.min(MOST_IN_ALL / u64::from(info.channels).max(1));
    let same_type = |level: &ImageLevel| level.source.info().voxel_type == info.voxel_type;
    let voxels = |level: &ImageLevel| level.source.info().extent.volume();
    let few = levels.iter().position(|level| same_type(level) && voxels(level) <= most);
    let coarsest = || levels.iter().rposition(same_type).unwrap_or(0);
    let place = few.unwrap_or_else(coarsest);
    let source = &*levels[place].source;
    let whole = source.info().extent;
    let boxes_at = |place| boxes(whole, source.piece().unwrap_or(whole), most, place);
    let first = boxes_at(Place::Middle);
    let taken = |channel| {
        if is_fetched {
            let first = first.iter().map(|region| (source, *region));
            fetch(channel, &first.chain(drawn_first(levels, place)).collect::<Vec<_>>());
        }
        with_voxel_type!(info.voxel_type, T => {
            let mut found = channel_of::<T>(source, channel, &first)?;
            // One value alone may be the background of a small object.
            for place in [Place::First, Place::Last] {
                if found.0.range[0] < found.0.range[1] {
                    break;
                }
                let other = boxes_at(place);
                if other != first && let Ok(other) = channel_of::<T>(source, channel, &other) {
                    found = other;
                }
            }
            Ok(found)
        })
    };
    let channels = (0..info.channels).map(taken).collect::<Result<Vec<_>, ImportError>>()?;
    let is_complete = channels.iter().all(|(_, is_complete)| *is_complete);
    // Coarser arrays by other programs may go beyond the finest one's values.
    let is_whole = few == Some(0) && levels.len() == 1 && info.times == 1 && is_complete;
    Ok(Sample { channels: channels.into_iter().map(|(statistics, _)| statistics).collect(), is_whole })
}

/// The coarsest level, if it is small and not the sample's: a picture begins with it.
fn drawn_first(levels: &[ImageLevel], sampled: usize) -> Option<(&dyn Source, VoxelBox)> {
    let coarsest = levels.len() - 1;
    let source = &*levels[coarsest].source;
    let whole = source.info().extent;
    (coarsest != sampled && whole.volume() <= MOST_FETCHED_VOXELS / 8).then(|| (source, whole.full_box()))
}

/// Fetches boxes of levels of an image at an address, many at once. Failures are left for the reads to report.
fn fetch(channel: u32, boxes: &[(&dyn Source, VoxelBox)]) {
    const AT_ONCE: usize = 16;
    for some in boxes.chunks(AT_ONCE) {
        thread::scope(|scope| {
            for (source, region) in some {
                scope.spawn(|| drop(source.fetch_box(0, channel, *region)));
            }
        });
    }
}

/// The chunk taken of each part of an axis.
#[derive(Clone, Copy)]
enum Place {
    Middle,
    First,
    Last,
}

impl Place {
    /// Index of the chunk of part `i` of `parts` equal ones of `n` chunks.
    fn of_part(self, i: u32, parts: u32, n: u32) -> u32 {
        let end = |i: u32| u64::from(i) * u64::from(n) / u64::from(parts);
        let index = match self {
            Self::Middle => u64::from(2 * i + 1) * u64::from(n) / u64::from(2 * parts),
            Self::First => end(i),
            Self::Last => (end(i + 1) - 1).max(end(i)),
        };
        index as u32
    }
}

/// Boxes of whole chunks, evenly spread along each axis, of at most so many voxels together; one box at least, of a part of a chunk where that is greater.
fn boxes(whole: Extent, chunk: Extent, most_voxels: u64, within: Place) -> Vec<VoxelBox> {
    let (n, chunk) = (whole.to_array(), chunk.to_array());
    let edge: [u32; 3] = std::array::from_fn(|axis| chunk[axis].clamp(1, n[axis]));
    let grid: [u32; 3] = std::array::from_fn(|axis| n[axis].div_ceil(edge[axis]));
    let chunk_voxels = edge.iter().map(|&n| u64::from(n)).product::<u64>();
    let taken = counts(grid, (most_voxels / chunk_voxels).max(1));
    let box_of = |place: [u32; 3]| {
        let index = |axis: usize| within.of_part(place[axis], taken[axis], grid[axis]);
        let min: [u32; 3] = std::array::from_fn(|axis| index(axis) * edge[axis]);
        let max = std::array::from_fn(|axis| min[axis].saturating_add(edge[axis]).min(n[axis]));
        part(VoxelBox::new(min, max), most_voxels)
    };
    Extent::from_array(taken).full_box().voxels().map(box_of).collect()
}

/// Chunks along each axis, at most `most` together, as like a share of each axis's as can be: chunks a fixed number apart in one order would all lie in the
/// same rows of a grid of powers of two.
fn counts(grid: [u32; 3], most: u64) -> [u32; 3] {
    let of_share = |share: f64| grid.map(|n| ((f64::from(n) * share) as u32).clamp(1, n));
    let fits = |counts: [u32; 3]| counts.iter().map(|&n| u64::from(n)).product::<u64>() <= most;
    let (mut low, mut high) = (0.0, 1.0);
    if fits(grid) {
        return grid;
    }
    for _ in 0..40 {
        let middle = (low + high) / 2.0;
        *(if fits(of_share(middle)) { &mut low } else { &mut high }) = middle;
    }
    let mut counts = of_share(low);
    // Axes with the same share grow at once, which may be too much.
    for axis in [2, 1, 0] {
        let others: u64 = (0..3).filter(|other| *other != axis).map(|other| u64::from(counts[other])).product();
        counts[axis] = (most / others).clamp(1, u64::from((2 * counts[axis]).min(grid[axis]))) as u32;
    }
    counts
}

/// The first slices, rows or voxels of a box with too many.
fn part(region: VoxelBox, most_voxels: u64) -> VoxelBox {
    let (min, mut max) = (region.min.to_array(), region.max.to_array());
    for axis in [2, 1, 0] {
        let others: u64 = (0..3).filter(|a| *a != axis).map(|a| u64::from(max[a] - min[a])).product();
        let fit = (most_voxels / others).max(1).min(u64::from(max[axis] - min[axis]));
        max[axis] = min[axis] + fit as u32;
    }
    VoxelBox::new(min, max)
}

/// A channel's statistics over boxes of its first step, and whether all could be read.
fn channel_of<T: Measure>(
    source: &dyn Source,
    channel: u32,
    boxes: &[VoxelBox],
) -> Result<(ChannelStatistics, bool), ImportError> {
    let (kept, blanked) = no_data::<T>(source.info().sought_nodata());
    let read = |region: &VoxelBox| {
        let mut voxels = vec![T::default(); region.extent().volume() as usize];
        source.read_box(0, channel, *region, bytemuck::cast_slice_mut(&mut voxels))?;
        Ok(voxels)
    };
    let boxes: Vec<Result<Vec<T>, ImportError>> = boxes.par_iter().map(read).collect();
    let (mut totals, mut counter, mut tally) = (ChannelTotals::new(T::TYPE), Counter::new(T::TYPE), Tally::default());
    let (mut read, mut unread) = (0, None);
    for voxels in boxes {
        match voxels {
            Ok(mut voxels) => {
                let invalid = T::from_f64_rounded(f64::NAN);
                voxels.iter_mut().filter(|voxel| Some(**voxel) == blanked).for_each(|voxel| *voxel = invalid);
                totals.add_range(nodata::range(&voxels, kept).to_f64());
                nodata::count(&voxels, kept, &mut counter, &mut tally);
                read += 1;
            }
            Err(error) => unread = unread.or(Some(error)),
        }
    }
    match unread {
        Some(error) if read == 0 => Err(error),
        unread => {
            counter.drain_into(&mut totals);
            totals.add_tally(&tally);
            Ok((totals.finish(), unread.is_none()))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn boxes_are_spread_evenly_and_within_the_limit() {
        let whole = Extent::new(1000, 1000, 1000);
        for (chunk, most, count) in [
            (Extent::new(100, 100, 100), u64::MAX / 4, 1000),
            (Extent::new(100, 100, 100), 8_000_000, 8),
            (Extent::new(1000, 1000, 1), 4_000_000, 4),
            (whole, 1_500_000, 1),
            (Extent::new(4000, 4000, 1), 500, 1),
        ] {
            let boxes = boxes(whole, chunk, most, Place::Middle);
            assert_eq!(boxes.len(), count, "{chunk}");
            assert!(boxes.iter().map(|b| b.extent().volume()).sum::<u64>() <= most, "{chunk}");
            assert!(boxes.iter().all(|b| !b.is_empty() && b.intersect(whole.full_box()) == *b));
        }
        let spread = boxes(whole, Extent::new(1000, 1000, 1), 4_000_000, Place::Middle);
        assert_eq!(spread.iter().map(|b| b.min.z).collect::<Vec<_>>(), [125, 375, 625, 875]);
        let edges = boxes(Extent::new(1024, 1024, 1024), Extent::new(64, 64, 64), MOST_VOXELS, Place::Middle);
        let along = |at: fn(&VoxelBox) -> u32| edges.iter().map(at).collect::<std::collections::BTreeSet<_>>();
        for found in [along(|b| b.min.x), along(|b| b.min.y), along(|b| b.min.z)] {
            assert_eq!(found.into_iter().collect::<Vec<_>>(), [128, 384, 640, 896]);
        }
    }

    #[test]
    fn other_samples_have_other_chunks_of_each_part() {
        for (parts, n) in [(4, 16), (3, 10), (5, 5), (1, 7)] {
            let of = |place: Place| (0..parts).map(|i| place.of_part(i, parts, n)).collect::<Vec<_>>();
            let [middle, first, last] = [Place::Middle, Place::First, Place::Last].map(of);
            assert!(first[0] == 0 && last[parts as usize - 1] == n - 1);
            let is_in_order = |(i, at): (usize, &u32)| first[i] <= *at && *at <= last[i];
            assert!(middle.iter().enumerate().all(is_in_order), "{first:?} {middle:?} {last:?}");
        }
    }

    #[test]
    fn counts_fit_and_use_most_of_the_limit() {
        for grid in [[10, 10, 10], [1, 1, 1000], [3, 700, 20], [16, 16, 16], [1, 40, 2000]] {
            let all = grid.iter().map(|&n| u64::from(n)).product::<u64>();
            for most in (1..100).chain([all / 3, all - 1, all, 2 * all]) {
                let counts = counts(grid, most);
                let product = counts.iter().map(|&n| u64::from(n)).product::<u64>();
                assert!(product <= most && 3 * product >= most.min(all), "{grid:?} {most}: {counts:?}");
                assert!(
                    counts.iter().zip(grid).all(|(count, n)| (1..=n).contains(count)),
                    "{grid:?} {most}: {counts:?}"
                );
            }
        }
    }
}
