//! Fades: a brick arriving while its cell is drawn with an ancestor does not pop up, but replaces the ancestor pixel by pixel.
//! For moving cameras: without a fade time, bricks are drawn at once.
//!
//! Bricks already resident when they come into view, prefetched or seen before, do not fade; nor do bricks where nothing was
//! drawn. A fade cut short, because the ancestor loses its slot or the list has no room for both, is over for good: drawn
//! content does not get coarser.
//!
//! Costs a map entry per brick of the last fifth of a second or so; nothing while no brick arrives.

use crate::dither::PixelShare;
use brickyard_volume::BrickId;
use std::collections::BTreeMap;
use std::time::Duration;

/// Progress of a brick's fade, and the replaced brick.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Fading {
    pub(crate) before: BrickId,
    /// Pixels with a lower threshold show the new brick, the others the one before. Each of the two has some pixels.
    pub(crate) share: u8,
}

/// A volume's bricks that fade in.
pub(crate) struct Fades {
    time: Option<Duration>,
    now: Duration,
    /// Arrival of each brick, and the brick drawn in its place before.
    since: BTreeMap<BrickId, (Duration, BrickId)>,
}

impl Fades {
    pub(crate) fn new(time: Option<Duration>) -> Self {
        Self { time, now: Duration::ZERO, since: BTreeMap::new() }
    }

    pub(crate) fn are_wanted(&self) -> bool {
        self.time.is_some()
    }

    /// Begins the frame at the time `now`, and ends the fades finished by then.
    pub(crate) fn advance(&mut self, now: Duration) {
        self.now = now;
        let time = self.time.unwrap_or_default();
        self.since.retain(|_, (since, _)| now.saturating_sub(*since) < time);
    }

    pub(crate) fn begin(&mut self, brick: BrickId, before: BrickId) {
        self.since.insert(brick, (self.now, before));
    }

    pub(crate) fn end(&mut self, brick: BrickId) {
        self.since.remove(&brick);
    }

    /// Bricks still drawn because their replacements fade in.
    pub(crate) fn before(&self) -> impl Iterator<Item = BrickId> {
        self.since.values().map(|(_, before)| *before)
    }

    /// Progress of a brick's fade; `None` if it does not fade.
    pub(crate) fn of(&self, brick: BrickId) -> Option<Fading> {
        let &(since, before) = self.since.get(&brick)?;
        let done = self.now.saturating_sub(since).as_secs_f64() / self.time?.as_secs_f64();
        let last = PixelShare::THRESHOLDS - 1;
        // Some of it from the first frame on, and not all before its time.
        Some(Fading { before, share: ((1.0 + done * last as f64) as u8).min(last) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cut::{Cut, View};
    use crate::goal::Goal;
    use crate::residency::{Arrival, Arrived, Residency, Wants};
    use crate::source::BrickSource;
    use crate::test_source::{TestSource, box_view};
    use crate::visible_cells::VisibleCells;
    use brickyard_volume::{BrickIndex, Extent, Level, LevelPolicy, Projection, Pyramid, VoxelType};
    use std::sync::Arc;

    /// Bricks in a row: the root, two, four.
    struct Row {
        source: TestSource,
        residency: Residency,
    }

    const ROOT: (u8, u32) = (2, 0);

    fn brick((level, x): (u8, u32)) -> BrickId {
        BrickId { time: 0, channel: 0, level: Level(level), index: BrickIndex::new(x, 0, 0) }
    }

    impl Row {
        fn new(slots: u32, fade_ms: Option<u64>) -> Self {
            let pyramid = Pyramid::new(Extent::new(32, 8, 8), [1.0; 3], 8);
            let residency = Residency::new(vec![Arc::default()], slots, fade_ms.map(Duration::from_millis));
            Self { source: TestSource::new(pyramid, [1.0; 3], VoxelType::U8), residency }
        }

        /// Runs a frame that wants all bricks of a level, seen or not, and receives `bricks`. Returns each cell's entries from
        /// left to right: the brick with its upper threshold, or its lower one if another brick comes before it.
        fn frame(&mut self, level: u8, is_seen: bool, bricks: &[(u8, u32)], at_ms: u64) -> Vec<Vec<((u8, u32), u8)>> {
            let Self { source, residency } = self;
            for &id in bricks {
                residency.arrive(
                    0,
                    Arrival { id: brick(id), result: Ok(Arrived::Read { codes: Arc::from([0; 9]), content: None }) },
                );
            }
            let view = box_view(source, Projection::Orthographic { height: 99.0 });
            let view = View { level: LevelPolicy::Locked(level), ..view };
            let cut = Cut::new(source, &view, 99);
            let mut sight = VisibleCells::new(source, &cut, &view);
            sight.cells.retain(|_| is_seen);
            let wants = Wants { goal: Goal { pyramid: source.pyramid(), cut: &cut }, sight: &sight };
            let step = residency.step(&[wants], Default::default(), Default::default(), Duration::from_millis(at_ms));
            let draw = &step.volumes[0].draw;
            assert!(!(step.settled && draw.is_fading()));
            let mut cells: Vec<Vec<_>> = draw.cells.chunk_by(|a, b| a.cell == b.cell).map(<[_]>::to_vec).collect();
            cells.sort_by_key(|entries| entries[0].cell.index.x);
            let entry = |pixels: PixelShare| if pixels.from > 0 { pixels.from } else { pixels.to };
            let named = |id: BrickId| (id.level.0, id.index.x);
            cells.iter().map(|c| c.iter().map(|e| (named(e.brick), entry(e.pixels))).collect()).collect()
        }
    }

    /// A cell drawn with one brick.
    fn whole(brick: (u8, u32)) -> Vec<((u8, u32), u8)> {
        vec![(brick, 64)]
    }

    fn pair(before: (u8, u32), brick: (u8, u32), share: u8) -> Vec<((u8, u32), u8)> {
        vec![(before, share), (brick, share)]
    }

    #[test]
    fn what_comes_where_an_ancestor_was_drawn_fades_in() {
        let mut row = Row::new(20, Some(200));
        assert_eq!(row.frame(1, true, &[ROOT], 0), [whole(ROOT), whole(ROOT)], "nothing was there before");
        assert_eq!(row.frame(1, true, &[(1, 0)], 1000), [pair(ROOT, (1, 0), 1), whole(ROOT)]);
        assert_eq!(row.frame(1, true, &[(1, 1)], 1100), [pair(ROOT, (1, 0), 32), pair(ROOT, (1, 1), 1)]);
        assert_eq!(row.frame(1, true, &[], 1199)[0], pair(ROOT, (1, 0), 63));
        assert_eq!(row.frame(1, true, &[], 1200), [whole((1, 0)), pair(ROOT, (1, 1), 32)]);
        assert_eq!(row.frame(1, true, &[], 9000), [whole((1, 0)), whole((1, 1))]);
        // Finer bricks replace the last drawn ones.
        let mixed = [whole((1, 0)), pair((1, 0), (0, 1), 1), whole((1, 1)), whole((1, 1))];
        assert_eq!(row.frame(0, true, &[(0, 1)], 9000), mixed);
        // A brick arriving in its time but out of sight does not fade.
        row.frame(0, false, &[(0, 2)], 9010);
        let cells = row.frame(0, true, &[], 9020);
        assert_eq!((&cells[1], &cells[2]), (&pair((1, 0), (0, 1), 7), &whole((0, 2))));
    }

    #[test]
    fn without_a_time_nothing_fades() {
        let mut row = Row::new(20, None);
        row.frame(1, true, &[ROOT], 0);
        assert_eq!(row.frame(1, true, &[(1, 0)], 0), [whole((1, 0)), whole(ROOT)]);
    }

    #[test]
    fn a_fade_that_is_cut_short_is_over() {
        let mut row = Row::new(6, Some(200));
        row.frame(1, true, &[ROOT], 0);
        row.frame(1, true, &[(1, 0), (1, 1)], 1000);
        let half = [pair((1, 0), (0, 0), 1), pair((1, 0), (0, 1), 1), whole((1, 1)), whole((1, 1))];
        assert_eq!(row.frame(0, true, &[(0, 0), (0, 1)], 2000), half);
        // One of these takes the last slot, the other that of the brick from which the first two fade.
        let other = [whole((0, 0)), whole((0, 1)), pair((1, 1), (0, 2), 1), pair((1, 1), (0, 3), 1)];
        assert_eq!(row.frame(0, true, &[(0, 2), (0, 3)], 2050), other);
    }

    #[test]
    fn a_list_has_no_more_entries_than_there_are_slots() {
        let mut row = Row::new(5, Some(200));
        row.frame(1, true, &[ROOT], 0);
        row.frame(1, true, &[(1, 0), (1, 1)], 1000);
        let entries = |cells: Vec<Vec<_>>| cells[..2].iter().map(Vec::len).sum::<usize>();
        assert_eq!(entries(row.frame(0, true, &[(0, 0), (0, 1)], 2000)), 3);
        assert_eq!(entries(row.frame(0, true, &[], 2100)), 3, "the same one goes on");
    }
}
