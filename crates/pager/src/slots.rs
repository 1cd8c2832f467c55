//! The slot table: which volume's brick is in which slot, who may not be evicted, and who goes next.
//!
//! *Pinned* bricks stay, and so do those *claimed* in the current frame for the view; those claimed for a tier ahead of it are evicted
//! for earlier tiers alone; all others go first, least recently used first. Claiming a brick moves it to the recent end. Later tiers
//! are claimed first, so that the first brick met from the old end that may not go ends the search, and equal histories give
//! equal tables.

use crate::draw_list::Slot;
use crate::tier::Tier;
use brickyard_volume::BrickId;
use lru::LruCache;

/// A brick of one of the volumes that share the slots, with the volume's index among them.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(crate) struct VolumeBrick {
    pub(crate) volume: usize,
    pub(crate) id: BrickId,
}

struct Entry {
    slot: Slot,
    /// The last frame that claimed the brick, and what for.
    frame: u64,
    tier: Tier,
}

pub(crate) struct SlotTable {
    entries: LruCache<VolumeBrick, Entry>,
    /// Slots never used so far are `next..count`; none is ever free again.
    next: u32,
    count: u32,
    frame: u64,
    /// Sorted.
    pinned: Vec<VolumeBrick>,
    /// The bricks evicted last, to tell a brick that comes back from a new one.
    evicted: LruCache<VolumeBrick, ()>,
}

/// A slot given to a brick.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Acquired {
    pub(crate) slot: Slot,
    /// Whether the brick is among the last evicted ones, of which as many are remembered as there are slots.
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

    pub(crate) fn count(&self) -> usize {
        self.count as usize
    }

    /// Begins a frame: the last frame's claims end.
    pub(crate) fn begin_frame(&mut self) {
        self.frame += 1;
    }

    /// Replaces the set of pinned bricks. A pin takes effect once the brick has a slot.
    pub(crate) fn set_pins(&mut self, mut pins: Vec<VolumeBrick>) {
        pins.sort_unstable();
        self.pinned = pins;
    }

    pub(crate) fn get(&self, brick: VolumeBrick) -> Option<Slot> {
        self.entries.peek(&brick).map(|entry| entry.slot)
    }

    /// Moves a resident brick to the recent end, so that it is evicted after the unused ones. To be called before any brick is claimed.
    pub(crate) fn touch(&mut self, brick: VolumeBrick) {
        self.entries.promote(&brick);
    }

    /// Claims a resident brick for this frame, so that it stays. Bricks of later tiers are to be claimed first.
    pub(crate) fn claim(&mut self, brick: VolumeBrick, tier: Tier) {
        let frame = self.frame;
        if let Some(entry) = self.entries.get_mut(&brick) {
            (entry.frame, entry.tier) = (frame, tier);
        }
    }

    /// Gives a slot to a brick that has none, and claims it for this frame. `None` if all slots are pinned, or claimed for the view, for this
    /// tier or for an earlier one. (Even a brick that covers a hole takes no slot from a brick that the view shows at its own level: the next
    /// frame no longer claims the bricks whose cells have been covered.)
    pub(crate) fn acquire(&mut self, brick: VolumeBrick, tier: Tier) -> Option<Acquired> {
        debug_assert!(!self.entries.contains(&brick), "{brick:?} has a slot");
        let (slot, victim) = if self.next < self.count {
            self.next += 1;
            (Slot(self.next - 1), None)
        } else {
            let victim = self.victim(tier)?;
            (self.entries.pop(&victim)?.slot, Some(victim))
        };
        let again = self.evicted.pop(&brick).is_some();
        victim.map(|victim| self.evicted.put(victim, ()));
        self.entries.put(brick, Entry { slot, frame: self.frame, tier });
        Some(Acquired { slot, again })
    }

    fn victim(&self, tier: Tier) -> Option<VolumeBrick> {
        let may_go = |entry: &Entry| entry.frame != self.frame || (entry.tier.is_ahead() && entry.tier > tier);
        let old_first = self.entries.iter().rev();
        let mut may_go = old_first.take_while(|(_, entry)| may_go(entry)).map(|(brick, _)| *brick);
        may_go.find(|brick| self.pinned.binary_search(brick).is_err())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use brickyard_volume::{BrickIndex, Level};

    fn brick(x: u32) -> VolumeBrick {
        let id = BrickId { time: 0, channel: 0, level: Level(0), index: BrickIndex::new(x, 0, 0) };
        VolumeBrick { volume: 0, id }
    }

    fn slot(table: &mut SlotTable, x: u32) -> Option<u32> {
        table.acquire(brick(x), Tier::Visible).map(|a| a.slot.0)
    }

    #[test]
    fn the_oldest_unclaimed_unpinned_brick_goes() {
        let mut table = SlotTable::new(3);
        table.set_pins(vec![brick(0)]);
        assert_eq!([0, 1, 2].map(|x| slot(&mut table, x)), [Some(0), Some(1), Some(2)]);
        assert_eq!(slot(&mut table, 3), None, "all are this frame's");
        table.begin_frame();
        table.claim(brick(1), Tier::Visible);
        assert_eq!(slot(&mut table, 3), Some(2), "0 is pinned, 1 claimed");
        assert_eq!(slot(&mut table, 4), None);
        assert_eq!(table.get(brick(2)), None);
        table.begin_frame();
        assert_eq!(slot(&mut table, 4), Some(1), "1 was used before 3");
    }

    #[test]
    fn a_touched_brick_outlives_one_that_is_not() {
        let mut table = SlotTable::new(2);
        assert_eq!([0, 1].map(|x| slot(&mut table, x)), [Some(0), Some(1)]);
        table.begin_frame();
        table.touch(brick(0));
        assert_eq!(slot(&mut table, 2), Some(1));
    }

    #[test]
    fn only_later_tiers_are_evicted() {
        let mut table = SlotTable::new(4);
        (0..4).for_each(|x| assert_eq!(slot(&mut table, x), Some(x)));
        table.begin_frame();
        for (x, tier) in [(3, Tier::Ring), (2, Tier::Predicted), (1, Tier::Visible)] {
            table.claim(brick(x), tier);
        }
        let mut evicts = |x, tier| table.acquire(brick(x), tier).map(|a| a.slot.0);
        assert_eq!(evicts(4, Tier::Ring), Some(0), "nobody claims 0");
        assert_eq!(evicts(5, Tier::Ring), None);
        assert_eq!(evicts(6, Tier::Predicted), Some(3));
        assert_eq!(evicts(7, Tier::Predicted), None, "brick 4 is of the ring, but a predicted one is older");
        assert_eq!(evicts(8, Tier::Visible), Some(2));
        assert_eq!(evicts(9, Tier::Cover), None, "brick 1 is claimed for the view");
    }

    #[test]
    fn a_brick_that_comes_back_is_told() {
        let mut table = SlotTable::new(1);
        for (x, again) in [(0, false), (1, false), (0, true)] {
            table.begin_frame();
            assert_eq!(table.acquire(brick(x), Tier::Visible).map(|a| a.again), Some(again));
        }
    }
}
