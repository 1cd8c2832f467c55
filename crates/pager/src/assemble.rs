//! Padded bricks for slots: a core and an apron, stored or copied from up to 26 neighbours of its level, followed by gradients if needed.
//!
//! With stored aprons, a brick takes one core and one apron. Otherwise its parts (see [`Part`]) are boxes copied row by row from a core and
//! shells in the RAM cache: first all cached ones, then one by one those to decode, starting with any that no other thread is decoding. At
//! the faces of the level (its own extent, which may end inside a brick) and towards an unreadable neighbour the last voxel is repeated.
//! For an unreadable stored apron, voxels come from the neighbours' cores. All of this happens on voxels; the last step encodes slot codes.
//! Costs the copy of one padded brick, its encoding, and decoding of uncached cores.

use crate::apron_copy::{Block, paste, paste_apron};
use crate::layout::Layout;
use crate::neighbourhood::{Part, Span, spans};
use crate::ram_cache::{RamCache, Wanted, Whole};
use crate::retry::Failure;
use crate::slot_contents::Encoder;
use crate::source::BrickError;
use brickyard_volume::{BrickId, PaddedCodes, SlotEncoding};
use std::ops::Range;
use std::sync::Arc;
use std::time::Instant;

/// Reader of one source's padded bricks through a RAM cache. Each thread needs its own.
pub struct PaddedReader {
    pub(crate) cache: Arc<RamCache>,
    encoder: Encoder,
}

impl PaddedReader {
    /// Creates a reader through `cache`, which determines the width of the aprons.
    pub fn new(cache: Arc<RamCache>) -> Self {
        let encoder = Encoder::new(&**cache.source(), &cache.contents, cache.layout.scratch_bytes(&**cache.source()));
        Self { cache, encoder }
    }

    /// Bytes of a padded brick: `(edge + 2 * apron)^3` codes, then any gradients.
    pub fn padded_bytes(&self) -> usize {
        self.cache.layout.padded_bytes()
    }

    /// Fills `out`, of [`PaddedReader::padded_bytes`] bytes, with the brick and its apron, x fastest, then gradients. Waits and retries a
    /// few times after passing failures. In place of an unreadable neighbour the brick's own edge is repeated.
    ///
    /// # Errors
    /// If the brick itself cannot be read.
    pub fn read(&mut self, id: BrickId, out: &mut [u8]) -> Result<(), BrickError> {
        loop {
            match self.try_read(id, out) {
                Err(Failure { again: Some(again), .. }) => {
                    std::thread::sleep(again.saturating_duration_since(Instant::now()));
                }
                Err(failure) => return Err(failure.error),
                Ok(_) => return Ok(()),
            }
        }
    }

    /// Like [`PaddedReader::read`], but without waiting: the failure has the time of the next try. While a neighbour may yet be read, the
    /// brick is not assembled without it. Returns whether all voxels are the volume's own, with none repeated for an unreadable neighbour.
    pub(crate) fn try_read(&mut self, id: BrickId, out: &mut [u8]) -> Result<bool, Failure> {
        let pyramid = self.cache.source().pyramid();
        let extent = pyramid.level(id.level).extent.to_array();
        let index = id.index.to_array();
        let layout = self.cache.layout;
        let spans = std::array::from_fn(|a| spans(&layout, index[a] as usize, extent[a] as usize));
        let (codes, gradients) = out.split_at_mut(layout.padded_code_bytes());
        let Self { cache, encoder } = self;
        let mut is_whole = true;
        encoder.encode(id.channel, codes, |voxels| {
            is_whole = match layout.has_stored() {
                true => paste_whole(cache, id, spans, voxels)?,
                false => gather(cache, id, spans, voxels)?,
            };
            repeat_level_faces(&layout, spans.map(|[before, _, after]| before.to..after.target().end), voxels);
            Ok(())
        })?;
        if !gradients.is_empty() {
            let first = index.map(|i| i as i64 * layout.edge as i64);
            let inside = std::array::from_fn(|a| -first[a]..extent[a] as i64 - first[a]);
            let SlotEncoding { format, has_invalid, floats, .. } = encoder.encoding(id.channel);
            let unit = floats.map_or(format.max_code() as f32, |floats| floats.unit as f32);
            let brick = PaddedCodes { codes, format, has_invalid, unit, apron: layout.apron as u32 };
            layout.gradients.fill(brick, &inside, gradients);
        }
        Ok(is_whole)
    }
}

/// Assembles a padded brick from its core and its neighbours' shells. Returns whether all could be read.
fn gather(cache: &RamCache, id: BrickId, spans: [[Span; 3]; 3], out: &mut [u8]) -> Result<bool, Failure> {
    let layout = cache.layout;
    let place = |part: Part| place(&spans, part);
    let parts = Part::all().filter(|&part| place(part).iter().all(|span| span.len > 0));
    let wanted = parts.map(|part| cache.wanted(part, BrickId { index: part.lender(id.index), ..id }));
    let mut wanted: Vec<Wanted> = wanted.collect();
    let cached = cache.cached(&wanted);
    for bar in Part::bars() {
        let block = |part: Part| Some(Block::new(&layout, part, cached[part.number()].as_ref()?, place(part)));
        paste(&layout, bar.map(block), out);
    }
    let is_missing = cached.map(|voxels| voxels.is_none());
    wanted.retain(|wanted| is_missing[wanted.part.number()]);
    let mut unreadable = Vec::new();
    while !wanted.is_empty() {
        let (i, voxels) = cache.one_of(&wanted);
        let Wanted { part, .. } = wanted.remove(i);
        match voxels {
            Ok(codes) => paste(&layout, [None, Some(Block::new(&layout, part, &codes, place(part))), None], out),
            Err(failure) if part == Part::OWN || failure.again.is_some() => return Err(failure),
            Err(_) => unreadable.push(part),
        }
    }
    // By now the brick's own voxels are there.
    unreadable.iter().for_each(|&part| repeat_own_edge(&layout, place(part), place(Part::OWN), out));
    Ok(unreadable.is_empty())
}

/// Assembles a padded brick from its core and its stored apron, or its neighbours' cores if the apron is unreadable. Returns whether all
/// voxels could be read.
fn paste_whole(cache: &RamCache, id: BrickId, spans: [[Span; 3]; 3], out: &mut [u8]) -> Result<bool, Failure> {
    let layout = cache.layout;
    let own = place(&spans, Part::OWN);
    let Whole { voxels, has_apron } = cache.whole(id)?;
    let (core, apron) = voxels.split_at(layout.core_bytes());
    if has_apron {
        paste_apron(&layout, apron, out);
    }
    paste(&layout, [None, Some(Block::new(&layout, Part::OWN, core, own)), None], out);
    // To be dropped before another is requested.
    drop(voxels);
    let missing = Part::all().filter(|&part| part != Part::OWN && !has_apron);
    let mut is_whole = true;
    for part in missing {
        let region = place(&spans, part);
        if region.iter().any(|span| span.len == 0) {
            continue;
        }
        let lender = BrickId { index: part.lender(id.index), ..id };
        match cache.whole(lender) {
            Ok(whole) => copy_of_core(&layout, &whole.voxels, region, out),
            Err(failure) if failure.again.is_some() => return Err(failure),
            Err(_) => {
                repeat_own_edge(&layout, region, own, out);
                is_whole = false;
            }
        }
    }
    Ok(is_whole)
}

/// Copies a box of a neighbour's core into the apron, row by row.
fn copy_of_core(layout: &Layout, core: &[u8], region: [Span; 3], out: &mut [u8]) {
    let (edge, padded, bytes) = (layout.edge, layout.padded(), layout.voxel_bytes);
    for (z, to_z) in (region[2].from..).zip(region[2].target()) {
        for (y, to_y) in (region[1].from..).zip(region[1].target()) {
            let (from, to) = ((z * edge + y) * edge + region[0].from, (to_z * padded + to_y) * padded + region[0].to);
            let row = region[0].len * bytes;
            out[to * bytes..][..row].copy_from_slice(&core[from * bytes..][..row]);
        }
    }
}

fn place(spans: &[[Span; 3]; 3], part: Part) -> [Span; 3] {
    [0, 1, 2].map(|a| spans[a][part.side[a]])
}

/// Fills a box of the apron with the nearest voxels of the brick's own core.
fn repeat_own_edge(layout: &Layout, region: [Span; 3], own: [Span; 3], out: &mut [u8]) {
    let (padded, bytes) = (layout.padded(), layout.voxel_bytes);
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

/// Repeats the outermost voxels of the filled box up to the padded brick's faces: first along x, then rows along y, then slices along z.
fn repeat_level_faces(layout: &Layout, [x, y, z]: [Range<usize>; 3], out: &mut [u8]) {
    let row = layout.padded() * layout.voxel_bytes;
    let slice = layout.padded() * row;
    if x != (0..layout.padded()) {
        let lines = z.clone().flat_map(|z| y.clone().map(move |y| z * slice + y * row)).map(|line| line..line + row);
        match layout.voxel_bytes {
            1 => lines.for_each(|line| repeat_end_voxels::<1>(&mut out[line], &x)),
            2 => lines.for_each(|line| repeat_end_voxels::<2>(&mut out[line], &x)),
            4 => lines.for_each(|line| repeat_end_voxels::<4>(&mut out[line], &x)),
            bytes => lines.for_each(|line| repeat_ends(&mut out[line], bytes, &x)),
        }
    }
    for z in z.clone() {
        repeat_ends(&mut out[z * slice..(z + 1) * slice], row, &y);
    }
    repeat_ends(out, slice, &z);
}

/// Copies the first and last `filled` voxels of a line over all voxels before and after.
fn repeat_end_voxels<const BYTES: usize>(line: &mut [u8], filled: &Range<usize>) {
    let voxels = line.as_chunks_mut::<BYTES>().0;
    let (first, last) = (voxels[filled.start], voxels[filled.end - 1]);
    voxels[..filled.start].fill(first);
    voxels[filled.end..].fill(last);
}

/// Copies the first and last `filled` items over all items before and after.
fn repeat_ends(bytes: &mut [u8], item: usize, filled: &Range<usize>) {
    for i in 0..filled.start {
        bytes.copy_within(filled.start * item..(filled.start + 1) * item, i * item);
    }
    for i in filled.end..bytes.len() / item {
        bytes.copy_within((filled.end - 1) * item..filled.end * item, i * item);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::budget::Meter;
    use crate::ram_cache::DecodeCounters;
    use crate::slot_contents::SlotContents;
    use crate::source::BrickSource;
    use crate::test_source::TestSource;
    use brickyard_volume::{BrickIndex, Extent, Level, Pyramid, VoxelType};
    use proptest::prelude::*;
    use std::collections::HashMap;
    use std::sync::{Condvar, Mutex};
    use std::time::Duration;

    fn padded(source: TestSource, id: BrickId, apron: u32) -> Vec<u8> {
        let cache = RamCache::new(Arc::new(source), apron, 1 << 16).unwrap();
        let mut reader = PaddedReader::new(Arc::new(cache));
        let mut out = vec![0xEE; reader.padded_bytes()];
        reader.read(id, &mut out).unwrap();
        out
    }

    /// All bricks of a level in rows, in the order of a sweep.
    fn rows(source: &TestSource) -> Vec<BrickId> {
        let [x, y, z] = source.pyramid().level(Level(0)).bricks.to_array();
        let index = |i| BrickIndex::new(i % x, i / x % y, i / x / y);
        (0..x * y * z).map(|i| BrickId { time: 0, channel: 0, level: Level(0), index: index(i) }).collect()
    }

    fn cache(source: TestSource, apron: u32, cores: usize) -> (Arc<RamCache>, Arc<Meter>) {
        let layout = Layout::new(&source, apron, 0, &SlotContents::Codes).unwrap();
        let meter = Arc::new(Meter::new((cores * layout.cached_bytes()) as u64));
        (
            Arc::new(RamCache::with_meter(Arc::new(source), layout, SlotContents::Codes, cores, true, meter.clone())),
            meter,
        )
    }

    #[test]
    fn a_sweep_with_room_for_its_front_decodes_each_brick_once() {
        let bricks = rows(&TestSource::cube(64));
        // 8^3 bricks in rows: neighbours up to a slice, a row and a brick ahead are met before their own turn.
        let front = 8 * 8 + 8 + 1;
        let (cache, meter) = cache(TestSource::cube(64), 1, front);
        let mut reader = PaddedReader::new(cache.clone());
        let mut out = vec![0; reader.padded_bytes()];
        for &id in &bricks {
            reader.read(id, &mut out).unwrap();
        }
        assert_eq!(cache.counters().decoded, bricks.len() as u64);
        assert!(meter.peak() <= (front * cache.layout.cached_bytes()) as u64);
    }

    /// More threads than buffers neither wait for each other for good nor spoil each other's bricks.
    #[test]
    fn threads_share_the_smallest_caches() {
        let bricks = rows(&TestSource::cube(24));
        let expected: Vec<_> = bricks.iter().map(|&id| padded(TestSource::cube(24), id, 1)).collect();
        for cores in [1, 2, 5] {
            let (cache, meter) = cache(TestSource::cube(24), 1, cores);
            std::thread::scope(|scope| {
                for thread in 0..6 {
                    let (cache, bricks, expected) = (cache.clone(), &bricks, &expected);
                    scope.spawn(move || {
                        let mut reader = PaddedReader::new(cache);
                        for i in (0..bricks.len()).map(|i| (i + 5 * thread) % bricks.len()) {
                            let mut out = vec![0xEE; reader.padded_bytes()];
                            reader.read(bricks[i], &mut out).unwrap();
                            assert!(out == expected[i], "{} with {cores} cores", bricks[i]);
                        }
                    });
                }
            });
            assert_eq!(meter.peak(), (cores * cache.layout.cached_bytes()) as u64);
        }
    }

    /// Two threads in need of the same eight cores decode two at a time: each read of this source waits for another.
    #[test]
    fn threads_that_want_the_same_neighbours_share_the_work() {
        static READS: (Mutex<u32>, Condvar) = (Mutex::new(0), Condvar::new());
        let mut source = TestSource::cube(16);
        source.voxel_at = |id, at, out| {
            if at.map(|v| v % 8) == [0; 3] {
                let mut reads = READS.0.lock().unwrap();
                *reads += 1;
                let pair = reads.div_ceil(2) * 2;
                READS.1.notify_all();
                let wait = READS.1.wait_timeout_while(reads, Duration::from_secs(20), |reads| *reads < pair).unwrap();
                assert!(!wait.1.timed_out(), "{id} is read while the other thread waits");
            }
            out.fill(id.index.x as u8);
        };
        let cache = Arc::new(RamCache::new(Arc::new(source), 1, 1 << 16).unwrap());
        std::thread::scope(|scope| {
            for x in 0..2 {
                let mut reader = PaddedReader::new(cache.clone());
                let id = BrickId { time: 0, channel: 0, level: Level(0), index: BrickIndex::new(x, 0, 0) };
                scope.spawn(move || reader.read(id, &mut vec![0; reader.padded_bytes()]).unwrap());
            }
        });
        assert_eq!(cache.counters(), DecodeCounters { decoded: 8, bytes_decoded: 8 * 512, failed: 0 });
    }

    #[test]
    fn with_stored_aprons_nothing_is_decoded_for_a_neighbour() {
        let source = || TestSource::cube(64).with_aprons(1);
        let bricks = rows(&source());
        // Room for one brick, and a sweep backwards: nothing is met again.
        let (cache, meter) = cache(source(), 1, 1);
        let mut reader = PaddedReader::new(cache.clone());
        let mut out = vec![0; reader.padded_bytes()];
        for &id in bricks.iter().rev() {
            reader.read(id, &mut out).unwrap();
        }
        let decoded = bricks.len() as u64;
        // 10^3 codes for each: its core, and its apron.
        let expected = DecodeCounters { decoded, bytes_decoded: 1000 * decoded, failed: 0 };
        assert_eq!((cache.counters(), meter.peak()), (expected, 1000));
        assert_eq!(cache.source().bytes_read(), 1000 * decoded);
    }

    #[test]
    fn a_brick_whose_apron_cannot_be_read_takes_its_neighbours_voxels() {
        // In the middle, and at a corner.
        for (width, i) in [(1, 13), (2, 13), (2, 26)] {
            let id = rows(&TestSource::cube(24))[i];
            let mut source = TestSource::cube(24).with_aprons(width);
            source.failing_aprons.insert(id);
            let expected = padded(TestSource::cube(24), id, width);
            let (cache, _) = cache(source, width, 1);
            let mut reader = PaddedReader::new(cache.clone());
            let mut out = vec![0xEE; reader.padded_bytes()];
            for other in rows(&TestSource::cube(24)).into_iter().chain([id]) {
                reader.read(other, &mut out).unwrap();
                assert!(other != id || out == expected, "apron of {width}, brick {i}");
            }
            assert_eq!(cache.counters().failed, 1, "each is counted once");
        }
    }

    #[test]
    fn a_brick_whose_neighbours_cannot_be_read_either_repeats_its_own_edge() {
        let id = rows(&TestSource::cube(24))[13];
        let others = || rows(&TestSource::cube(24)).into_iter().filter(|other| *other != id);
        let (mut source, mut alone) = (TestSource::cube(24).with_aprons(1), TestSource::cube(24));
        source.failing_aprons.insert(id);
        source.failing.extend(others());
        alone.failing.extend(others());
        assert!(padded(source, id, 1) == padded(alone, id, 1));
    }

    /// Bricks side by side share their common gradients, with stored aprons or without, at the level's faces too.
    #[test]
    fn neighbours_agree_on_their_gradients() {
        for (n, layers, stored) in [([24, 17, 9], 1, 0), ([24, 17, 9], 1, 2), ([13, 20, 16], 2, 0)] {
            let pyramid = Pyramid::new(Extent::from_array(n), [1.0; 3], 8);
            let source = TestSource::new(pyramid, [1.0; 3], VoxelType::U16).with_aprons(stored);
            let bricks = rows(&source);
            let layout = Layout::new(&source, 2 * layers, layers, &SlotContents::Codes).unwrap();
            let meter = Arc::new(Meter::new((4 * layout.cached_bytes()) as u64));
            let cache = Arc::new(RamCache::with_meter(Arc::new(source), layout, SlotContents::Codes, 4, true, meter));
            let mut reader = PaddedReader::new(cache);
            let mut out = vec![0xEE; reader.padded_bytes()];
            let (mut known, mut met_again) = (HashMap::new(), 0);
            for id in bricks {
                reader.read(id, &mut out).unwrap();
                let along = layout.gradients.along();
                for (i, node) in out[layout.padded_code_bytes()..].chunks_exact(8).enumerate() {
                    let at = [1, along, along * along].map(|stride| i as u32 / stride % along);
                    let index = id.index.to_array();
                    let place: [u32; 3] = std::array::from_fn(|a| index[a] * 4 + at[a]);
                    match known.insert(place, node.to_vec()) {
                        Some(before) => {
                            assert_eq!(before, node, "{id} {at:?}");
                            met_again += 1;
                        }
                        None => assert!(node[..6] != [0xEE; 6]),
                    }
                }
            }
            assert!(met_again > 500, "{met_again}");
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(400))]

        /// A padded brick is the same, bit for bit, whether its apron was stored or comes from its neighbours.
        #[test]
        fn stored_aprons_are_those_from_neighbours(
            n in prop::array::uniform3(1u32..30), pick in prop::array::uniform3(0u32..8), level in 0u8..3,
            (apron, stored) in prop::sample::select(vec![(1, 1), (1, 2), (2, 2)]),
            edge in prop::sample::select(vec![4u32, 8]), voxel_type in prop::sample::select(VoxelType::ALL.to_vec()),
        ) {
            let pyramid = Pyramid::new(Extent::from_array(n), [1.0, 1.3, 1.9], edge);
            let level = Level(level.min(pyramid.coarsest().0));
            let bricks = pyramid.level(level).bricks.to_array();
            let index = BrickIndex::from_array(std::array::from_fn(|a| pick[a] % bricks[a]));
            let id = BrickId { time: 0, channel: 0, level, index };
            let source = |stored| TestSource::new(pyramid.clone(), [1.0; 3], voxel_type).with_aprons(stored);
            prop_assert!(padded(source(stored), id, apron) == padded(source(0), id, apron));
        }

        /// Every code is that of the voxel at its place, clamped to the level; towards an unreadable brick, clamped to the core.
        #[test]
        fn aprons_are_the_neighbours_voxels(
            n in prop::array::uniform3(1u32..30), pick in prop::array::uniform3(0u32..8), level in 0u8..3, apron in 1u32..5,
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
            let encoding = crate::slot_contents::encoding_of(&source, 0);
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
