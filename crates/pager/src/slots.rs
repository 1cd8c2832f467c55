//! The slot table: which brick is in which slot, who may not be evicted, and who goes next.
//!
//! Three ranks: *pinned* bricks stay, bricks *protected* in the current frame (its draw list and its uploads) stay until the
//! next, and all others are evicted least recently used first. Protecting a brick moves it to the recent end, so the
//! first protected brick met from the old end ends the search, and equal histories give equal tables.

use crate::draw_list::Slot;
use brickyard_volume::BrickId;
use lru::LruCache;

struct Entry {
    slot: Slot,
    /// The last frame that drew or uploaded the brick.
    frame: u64,
}

pub(crate) struct SlotTable {
    entries: LruCache<BrickId, Entry>,
    /// Slots never used so far are `next..count`; none is ever free again.
    next: u32,
    count: u32,
    frame: u64,
    /// Sorted.
    pinned: Vec<BrickId>,
    /// The bricks evicted last, to tell a brick that comes back from a new one.
    evicted: LruCache<BrickId, ()>,
}

/// A slot given to a brick.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Acquired {
    pub(crate) slot: Slot,
    /// Whether the brick had been evicted not long ago.
    pub(crate) again: bool,
}

impl SlotTable {
    pub(crate) fn new(count: u32) -> Self {
        let remembered = std::num::NonZeroUsize::new(count as usize).unwrap_or(std::num::NonZeroUsize::MIN);
        Self {
            entries: LruCache::unbounded(),
            next: 0,
            count,
            frame: 0,
            pinned: Vec::new(),
            evicted: LruCache::sparse(remembered),
        }
    }

    /// Ends the protection of the last frame's bricks.
    pub(crate) fn begin_frame(&mut self) {
        self.frame += 1;
    }

    /// Replaces the pinned bricks. A pin holds from when the brick has a slot.
    pub(crate) fn set_pins(&mut self, mut pins: Vec<BrickId>) {
        pins.sort_unstable();
        self.pinned = pins;
    }

    pub(crate) fn get(&self, id: BrickId) -> Option<Slot> {
        self.entries.peek(&id).map(|entry| entry.slot)
    }

    /// Moves a resident brick to the recent end: it goes after those that are not used. Before any is protected.
    pub(crate) fn touch(&mut self, id: BrickId) {
        self.entries.promote(&id);
    }

    /// Keeps a resident brick for this frame.
    pub(crate) fn protect(&mut self, id: BrickId) {
        let frame = self.frame;
        if let Some(entry) = self.entries.get_mut(&id) {
            entry.frame = frame;
        }
    }

    /// Gives a brick that has none a slot, protected for this frame; `None` if all slots are pinned or protected.
    pub(crate) fn acquire(&mut self, id: BrickId) -> Option<Acquired> {
        debug_assert!(!self.entries.contains(&id), "{id} has a slot");
        let (slot, victim) = if self.next < self.count {
            self.next += 1;
            (Slot(self.next - 1), None)
        } else {
            let victim = self.victim()?;
            (self.entries.pop(&victim)?.slot, Some(victim))
        };
        let again = self.evicted.pop(&id).is_some();
        victim.map(|victim| self.evicted.put(victim, ()));
        self.entries.put(id, Entry { slot, frame: self.frame });
        Some(Acquired { slot, again })
    }

    fn victim(&self) -> Option<BrickId> {
        let old_first = self.entries.iter().rev();
        let mut unprotected = old_first.take_while(|(_, entry)| entry.frame != self.frame).map(|(id, _)| *id);
        unprotected.find(|id| self.pinned.binary_search(id).is_err())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use brickyard_volume::{BrickIndex, Level};

    fn brick(x: u32) -> BrickId {
        BrickId { time: 0, channel: 0, level: Level(0), index: BrickIndex::new(x, 0, 0) }
    }

    fn slot(table: &mut SlotTable, x: u32) -> Option<u32> {
        table.acquire(brick(x)).map(|a| a.slot.0)
    }

    #[test]
    fn the_oldest_unprotected_unpinned_brick_goes() {
        let mut table = SlotTable::new(3);
        table.set_pins(vec![brick(0)]);
        assert_eq!([0, 1, 2].map(|x| slot(&mut table, x)), [Some(0), Some(1), Some(2)]);
        assert_eq!(slot(&mut table, 3), None, "all are this frame's");
        table.begin_frame();
        table.protect(brick(1));
        assert_eq!(slot(&mut table, 3), Some(2), "0 is pinned, 1 protected");
        assert_eq!(slot(&mut table, 4), None);
        assert_eq!(table.get(brick(2)), None);
        table.begin_frame();
        assert_eq!(slot(&mut table, 4), Some(1), "1 was used before 3");
    }

    #[test]
    fn a_brick_that_comes_back_is_told() {
        let mut table = SlotTable::new(1);
        for (x, again) in [(0, false), (1, false), (0, true)] {
            table.begin_frame();
            assert_eq!(table.acquire(brick(x)).map(|a| a.again), Some(again));
        }
    }
}
