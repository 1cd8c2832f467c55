//! Slot table: the brick of each slot, and the eviction order. Equal bricks of several time steps share a slot, freed with the last of
//! them.
//!
//! *Pinned* bricks stay, and so do those *claimed* for the view in the current frame. Prefetched bricks are evicted only for earlier tiers;
//! all others go first, the least recently used first. Claiming a brick moves it to the recent end. Later tiers are claimed first, so the
//! search from the old end can stop at the first claimed brick that must stay, and equal histories give equal tables.

use crate::changes::Changes;
use crate::draw_list::Slot;
use crate::goal::VolumeBrick;
use crate::sameness::{Content, SlotsByContent};
use crate::tier::Tier;
use lru::LruCache;
use std::sync::Arc;

struct Entry {
    slot: Slot,
    /// The last frame that claimed the brick, and the tier.
    frame: u64,
    tier: Tier,
}

/// State of a used slot: the number of bricks sharing it, and their content.
#[derive(Default)]
struct Holding {
    bricks: u32,
    /// Volume and content, if known.
    content: Option<(usize, Content)>,
}

const BRICKS_PER_SLOT: usize = 2;

pub(crate) struct SlotTable {
    entries: LruCache<VolumeBrick, Entry>,
    /// Slots past the end of `holdings` are unused so far.
    holdings: Vec<Holding>,
    /// Slots left by all bricks.
    free: Vec<Slot>,
    /// Each volume's slots by content.
    held: Vec<Arc<SlotsByContent>>,
    count: u32,
    frame: u64,
    /// Sorted.
    pinned: Vec<VolumeBrick>,
    /// Last evictions, to recognise returning bricks.
    evicted: LruCache<VolumeBrick, ()>,
    /// Arrivals and evictions.
    pub(crate) changes: Changes,
}

/// A slot given to a brick.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Acquired {
    pub(crate) slot: Slot,
    /// Whether the brick is among the last evicted ones, remembered for as many as there are slots.
    pub(crate) again: bool,
}

impl SlotTable {
    pub(crate) fn new(count: u32, held: Vec<Arc<SlotsByContent>>) -> Self {
        held.iter().for_each(|held| held.lock().clear());
        let remembered = std::num::NonZeroUsize::new(count as usize).unwrap_or(std::num::NonZeroUsize::MIN);
        Self {
            entries: LruCache::unbounded(),
            holdings: Vec::new(),
            free: Vec::new(),
            held,
            count,
            frame: 0,
            pinned: Vec::new(),
            evicted: LruCache::sparse(remembered),
            changes: Changes::default(),
        }
    }

    /// Forgets all contents and sets the number of slots.
    pub(crate) fn forget(&mut self, count: u32) {
        *self = Self::new(count, std::mem::take(&mut self.held));
    }

    pub(crate) fn count(&self) -> usize {
        self.count as usize
    }

    /// Begins a frame; the last frame's claims end.
    pub(crate) fn begin_frame(&mut self) {
        self.frame += 1;
    }

    /// Replaces the set of pinned bricks. Pins take effect once their brick has a slot.
    pub(crate) fn set_pins(&mut self, mut pins: Vec<VolumeBrick>) {
        pins.sort_unstable();
        self.pinned = pins;
    }

    pub(crate) fn get(&self, brick: VolumeBrick) -> Option<Slot> {
        self.entries.peek(&brick).map(|entry| entry.slot)
    }

    /// Moves a resident brick to the recent end, behind unused ones. To be called before any claim.
    pub(crate) fn touch(&mut self, brick: VolumeBrick) {
        self.entries.promote(&brick);
    }

    /// Claims a resident brick for this frame, so it stays. Claim later tiers first.
    pub(crate) fn claim(&mut self, brick: VolumeBrick, tier: Tier) {
        let frame = self.frame;
        if let Some(entry) = self.entries.get_mut(&brick) {
            (entry.frame, entry.tier) = (frame, tier);
        }
    }

    /// Gives a slot to a brick without one, and claims it for this frame. `None` if all slots are pinned, or claimed for the view, for this
    /// tier or for an earlier one. (Not even a brick covering a hole takes a slot from one shown at its own level: once covered, cells
    /// release their former bricks in the next frame.)
    pub(crate) fn acquire(&mut self, brick: VolumeBrick, content: Option<Content>, tier: Tier) -> Option<Acquired> {
        debug_assert!(!self.entries.contains(&brick), "{brick:?} has a slot");
        // This frame's evictions may push it out.
        let again = self.evicted.contains(&brick);
        while self.free.is_empty() && self.holdings.len() == self.count as usize {
            self.evict(self.victim(tier)?);
        }
        let slot = self.free.pop().unwrap_or(Slot(self.holdings.len() as u32));
        if slot.0 as usize == self.holdings.len() {
            self.holdings.push(Holding::default());
        }
        let content = content.map(|content| (brick.volume, content));
        if let Some((volume, content)) = content {
            self.held[volume].lock().insert(content, slot);
        }
        self.holdings[slot.0 as usize] = Holding { bricks: 1, content };
        self.evicted.pop(&brick);
        self.entries.put(brick, Entry { slot, frame: self.frame, tier });
        self.changes.note(brick);
        Some(Acquired { slot, again })
    }

    /// Gives a brick the slot with its content, if there is one, and claims it for this frame. Returns whether there is.
    pub(crate) fn share(&mut self, brick: VolumeBrick, content: Content, tier: Tier) -> bool {
        let Some(slot) = self.held[brick.volume].lock().get(&content).copied() else { return false };
        if self.entries.contains(&brick) {
            return true;
        }
        self.holdings[slot.0 as usize].bricks += 1;
        self.entries.put(brick, Entry { slot, frame: self.frame, tier });
        self.changes.note(brick);
        // Otherwise bricks no longer drawn would pile up.
        while self.entries.len() > BRICKS_PER_SLOT * self.count as usize
            && let Some(victim) = self.victim(Tier::Ring)
        {
            self.evict(victim);
        }
        true
    }

    fn evict(&mut self, brick: VolumeBrick) {
        let Some(Entry { slot, .. }) = self.entries.pop(&brick) else { return };
        self.evicted.put(brick, ());
        self.changes.note(brick);
        let holding = &mut self.holdings[slot.0 as usize];
        holding.bricks -= 1;
        if holding.bricks == 0 {
            if let Some((volume, content)) = holding.content.take() {
                self.held[volume].lock().remove(&content);
            }
            self.free.push(slot);
        }
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
    use brickyard_volume::{BrickId, BrickIndex, Level};

    fn brick(x: u32) -> VolumeBrick {
        let id = BrickId { time: 0, channel: 0, level: Level(0), index: BrickIndex::new(x, 0, 0) };
        VolumeBrick { volume: 0, id }
    }

    fn table(count: u32) -> SlotTable {
        SlotTable::new(count, vec![Arc::default()])
    }

    fn slot(table: &mut SlotTable, x: u32) -> Option<u32> {
        table.acquire(brick(x), None, Tier::Visible).map(|a| a.slot.0)
    }

    #[test]
    fn the_oldest_unclaimed_unpinned_brick_goes() {
        let mut table = table(3);
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
        let mut table = table(2);
        assert_eq!([0, 1].map(|x| slot(&mut table, x)), [Some(0), Some(1)]);
        table.begin_frame();
        table.touch(brick(0));
        assert_eq!(slot(&mut table, 2), Some(1));
    }

    #[test]
    fn only_later_tiers_are_evicted() {
        let mut table = table(4);
        (0..4).for_each(|x| assert_eq!(slot(&mut table, x), Some(x)));
        table.begin_frame();
        for (x, tier) in [(3, Tier::Ring), (2, Tier::Predicted), (1, Tier::Visible)] {
            table.claim(brick(x), tier);
        }
        let mut evicts = |x, tier| table.acquire(brick(x), None, tier).map(|a| a.slot.0);
        assert_eq!(evicts(4, Tier::Ring), Some(0), "nobody claims 0");
        assert_eq!(evicts(5, Tier::Ring), None);
        assert_eq!(evicts(6, Tier::Predicted), Some(3));
        assert_eq!(evicts(7, Tier::Predicted), None, "brick 4 is of the ring, but a predicted one is older");
        assert_eq!(evicts(8, Tier::Visible), Some(2));
        assert_eq!(evicts(9, Tier::Cover), None, "brick 1 is claimed for the view");
    }

    #[test]
    fn a_shared_slot_is_free_after_the_last_of_its_bricks() {
        let same = |time| VolumeBrick { volume: 0, id: BrickId { time, ..brick(0).id } };
        let content = Content { id: brick(0).id, hash: 7 };
        let mut table = table(2);
        assert!(!table.share(same(0), content, Tier::Visible), "no slot holds it");
        assert_eq!(table.acquire(same(0), Some(content), Tier::Visible).map(|a| a.slot.0), Some(0));
        assert!(table.share(same(1), content, Tier::Visible));
        assert_eq!(table.get(same(1)), Some(Slot(0)));
        table.begin_frame();
        table.claim(same(1), Tier::Visible);
        assert_eq!(slot(&mut table, 1), Some(1));
        assert_eq!(slot(&mut table, 2), None, "step 0 gives up its share, and step 1 needs the slot");
        assert_eq!(table.get(same(0)), None);
        table.begin_frame();
        assert_eq!(slot(&mut table, 2), Some(0), "brick 1 came later");
        assert_eq!(slot(&mut table, 3), Some(1));
        assert!(!table.share(same(2), content, Tier::Visible), "the slot holds something else");
    }

    #[test]
    fn no_slot_is_shared_by_ever_more_bricks() {
        let same = |time| VolumeBrick { volume: 0, id: BrickId { time, ..brick(0).id } };
        let content = Content { id: brick(0).id, hash: 7 };
        let mut table = table(2);
        table.acquire(same(0), Some(content), Tier::Visible).unwrap();
        for time in 1..100 {
            table.begin_frame();
            assert!(table.share(same(time), content, Tier::Visible));
        }
        let held: Vec<u32> = (0..100).filter(|&time| table.get(same(time)).is_some()).collect();
        assert_eq!(held, [96, 97, 98, 99]);
        assert_eq!([1, 2].map(|x| slot(&mut table, x)), [Some(1), None], "the slot is the frame's");
    }

    #[test]
    fn a_brick_that_comes_back_is_told() {
        let mut table = table(1);
        for (x, again) in [(0, false), (1, false), (0, true)] {
            table.begin_frame();
            assert_eq!(table.acquire(brick(x), None, Tier::Visible).map(|a| a.again), Some(again));
        }
    }
}
