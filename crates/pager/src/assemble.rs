//! Padded bricks: a core and an apron copied from its up to 26 neighbours of the same level.
//!
//! Along every axis a padded brick is the end of one neighbour, the core, and the beginning of the other; the 27
//! combinations are boxes copied row by row from cores in the RAM cache, one core at a time. At the faces of the level (its
//! own extent, which may end inside a brick) the last voxel is repeated; so it is towards a neighbour that cannot be read.
//! Cost: the copy of one padded brick, plus decoding what the cache does not hold.

use crate::layout::{Layout, copy_run};
use crate::ram_cache::RamCache;
use crate::source::BrickError;
use brickyard_volume::{BrickId, BrickIndex};
use std::ops::Range;
use std::sync::Arc;

/// Reads padded bricks of one source through a RAM cache: one reader per thread.
pub struct PaddedReader {
    cache: Arc<RamCache>,
    layout: Layout,
    scratch: Vec<u8>,
}

impl PaddedReader {
    /// A reader through `cache`, which sets the apron.
    pub fn new(cache: Arc<RamCache>) -> Self {
        let (layout, scratch) = (cache.layout(), vec![0; cache.scratch_bytes()]);
        Self { cache, layout, scratch }
    }

    /// Bytes of a padded brick: `(edge + 2 * apron)^3` codes.
    pub fn padded_bytes(&self) -> usize {
        self.layout.padded_bytes()
    }

    /// Fills `out` with the brick and its apron, x fastest.
    ///
    /// # Errors
    /// If the brick itself cannot be read. A neighbour that cannot be read leaves the brick's own edge repeated there.
    pub fn read(&mut self, id: BrickId, out: &mut [u8]) -> Result<(), BrickError> {
        let pyramid = self.cache.source().pyramid();
        let extent = pyramid.level(id.level).extent.to_array();
        let index = id.index.to_array();
        let mut spans: [[Span; 3]; 3] =
            std::array::from_fn(|a| spans(&self.layout, index[a] as usize, extent[a] as usize));
        // Along x the neighbour before is read from its last columns alone.
        spans[0][0].from = 0;
        let own = [1; 3];
        let place = |d: [usize; 3]| [spans[0][d[0]], spans[1][d[1]], spans[2][d[2]]];
        let core = self.cache.core(id, &mut self.scratch)?;
        paste(&self.layout, self.layout.part(&core, 1), place(own), out);
        drop(core);
        for d in (0..27).map(|i| [i % 3, i / 3 % 3, i / 9]).filter(|&d| d != own) {
            let span = place(d);
            if span.iter().any(|s| s.len == 0) {
                continue;
            }
            let neighbour = BrickIndex::from_array(std::array::from_fn(|a| index[a] + d[a] as u32 - 1));
            match self.cache.core(BrickId { index: neighbour, ..id }, &mut self.scratch) {
                Ok(core) => paste(&self.layout, self.layout.part(&core, d[0]), span, out),
                Err(_) => repeat_own_edge(&self.layout, span, place(own), out),
            }
        }
        repeat_level_faces(&self.layout, spans.map(|[before, _, after]| before.to..after.target().end), out);
        Ok(())
    }
}

/// Copies a box of a core (or of its columns), given with the length of its rows, to its place in the padded brick.
fn paste(layout: &Layout, (from, row): (&[u8], usize), [x, y, z]: [Span; 3], out: &mut [u8]) {
    let (edge, padded, bytes) = (layout.edge, layout.padded(), layout.code_bytes);
    let run = x.len * bytes;
    for slice in 0..z.len {
        let from_slice = (z.from + slice) * edge + y.from;
        let to_slice = (z.to + slice) * padded + y.to;
        for line in 0..y.len {
            let from_run = ((from_slice + line) * row + x.from) * bytes;
            let to_run = ((to_slice + line) * padded + x.to) * bytes;
            copy_run(&from[from_run..from_run + run], &mut out[to_run..to_run + run]);
        }
    }
}

/// Fills a box of the apron with the nearest voxels of the brick's own core.
fn repeat_own_edge(layout: &Layout, region: [Span; 3], own: [Span; 3], out: &mut [u8]) {
    let (padded, bytes) = (layout.padded(), layout.code_bytes);
    let nearest = |a: usize, at: usize| at.clamp(own[a].to, own[a].to + own[a].len - 1);
    let place = |x: usize, y: usize, z: usize| ((z * padded + y) * padded + x) * bytes;
    for z in region[2].target() {
        for y in region[1].target() {
            for x in region[0].target() {
                let from = place(nearest(0, x), nearest(1, y), nearest(2, z));
                out.copy_within(from..from + bytes, place(x, y, z));
            }
        }
    }
}

/// Repeats the outermost voxels of the filled box up to the padded brick's faces: first along x, then whole rows along y,
/// then whole slices along z.
fn repeat_level_faces(layout: &Layout, [x, y, z]: [Range<usize>; 3], out: &mut [u8]) {
    let row = layout.padded() * layout.code_bytes;
    let slice = layout.padded() * row;
    if x != (0..layout.padded()) {
        for line in z.clone().flat_map(|z| y.clone().map(move |y| z * slice + y * row)) {
            repeat_ends(&mut out[line..line + row], layout.code_bytes, &x);
        }
    }
    for z in z.clone() {
        repeat_ends(&mut out[z * slice..(z + 1) * slice], row, &y);
    }
    repeat_ends(out, slice, &z);
}

/// Copies the first and last of the `filled` items of `bytes` over all items before and after.
fn repeat_ends(bytes: &mut [u8], item: usize, filled: &Range<usize>) {
    for i in 0..filled.start {
        bytes.copy_within(filled.start * item..(filled.start + 1) * item, i * item);
    }
    for i in filled.end..bytes.len() / item {
        bytes.copy_within((filled.end - 1) * item..filled.end * item, i * item);
    }
}

/// Along one axis, which voxels of a core go where in the padded brick.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Span {
    from: usize,
    to: usize,
    len: usize,
}

impl Span {
    fn target(self) -> Range<usize> {
        self.to..self.to + self.len
    }
}

/// Along one axis of `extent` voxels: the parts of brick `index`'s padded row from the brick before, itself and the brick
/// after.
fn spans(layout: &Layout, index: usize, extent: usize) -> [Span; 3] {
    let Layout { edge, apron, .. } = *layout;
    let start = index * edge;
    let before = if index > 0 { apron } else { 0 };
    let own = edge.min(extent - start);
    let after = apron.min(extent - start - own);
    [
        Span { from: edge - before, to: apron - before, len: before },
        Span { from: 0, to: apron, len: own },
        Span { from: 0, to: apron + own, len: after },
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_source::TestSource;
    use brickyard_volume::{Extent, Level, Pyramid, VoxelType};
    use proptest::prelude::*;

    fn padded(source: TestSource, id: BrickId, apron: u32) -> Vec<u8> {
        let cache = RamCache::new(Arc::new(source), apron, 1 << 16).unwrap();
        let mut reader = PaddedReader::new(Arc::new(cache));
        let mut out = vec![0xEE; reader.padded_bytes()];
        reader.read(id, &mut out).unwrap();
        out
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(400))]

        /// Every code of a padded brick is the voxel at its place, clamped to the level; towards a brick that cannot be
        /// read, clamped to the core.
        #[test]
        fn aprons_are_the_neighbours_voxels(
            n in prop::array::uniform3(1u32..30), pick in prop::array::uniform3(0u32..8), level in 0u8..3, apron in 1u32..3,
            edge in prop::sample::select(vec![4u32, 8]), damaged in prop::option::of(0usize..27),
            voxel_type in prop::sample::select(VoxelType::ALL.to_vec()),
        ) {
            let pyramid = Pyramid::new(Extent::from_array(n), [1.0, 1.3, 1.9], edge);
            let level = Level(level.min(pyramid.coarsest().0));
            let (extent, bricks) = (pyramid.level(level).extent.to_array(), pyramid.level(level).bricks.to_array());
            let index: [u32; 3] = std::array::from_fn(|a| pick[a] % bricks[a]);
            let id = BrickId { time: 0, channel: 0, level, index: BrickIndex::from_array(index) };
            let mut source = TestSource::new(pyramid, [1.0; 3], voxel_type);
            let damaged = damaged.filter(|&i| i != 13).map(|i| [i % 3, i / 3 % 3, i / 9]);
            let damaged = damaged.map(|d| std::array::from_fn(|a| (index[a] + d[a] as u32).wrapping_sub(1)));
            if let Some(index) = damaged {
                source.failing.insert(BrickId { index: BrickIndex::from_array(index), ..id });
            }
            let encoding = crate::ram_cache::encoding_of(&source);
            let voxel_at = source.voxel_at;
            let out = padded(source, id, apron);
            let side = (edge + 2 * apron) as usize;
            let code_bytes = encoding.format.bytes();
            for (i, code) in out.chunks_exact(code_bytes).enumerate() {
                let at = [i % side, i / side % side, i / side / side];
                let mut v: [u32; 3] = std::array::from_fn(|a| {
                    (index[a] * edge + at[a] as u32).saturating_sub(apron).min(extent[a] - 1)
                });
                if Some(v.map(|v| v / edge)) == damaged {
                    v = std::array::from_fn(|a| v[a].clamp(index[a] * edge, ((index[a] + 1) * edge).min(extent[a]) - 1));
                }
                let mut bytes = vec![0; voxel_type.bytes()];
                voxel_at(id, v, &mut bytes);
                let mut expected = vec![0; code_bytes];
                encoding.encode(&bytes, &mut expected);
                prop_assert_eq!(code, &expected[..], "at {:?}, voxel {:?}", at, v);
            }
        }
    }
}
