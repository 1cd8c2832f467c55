//! One thread's counts of 32-bit values by class (`value_counts.rs`), in a hash table of fixed size: when too many
//! classes are in use, the shift rises by one. Takes 1 MiB, which fits a second-level cache, and about 8 ns a voxel for
//! noise, where nearly all values differ.

use crate::value_counts::{Classes, MOST_CLASSES, class};

/// A class and its count; free if the count is 0.
#[derive(Clone, Copy, Default)]
struct Slot {
    /// The class's lower 32 bits, unique among the classes of one type.
    key: u32,
    count: u32,
}

/// The least count moved out of its slot to make room.
const LARGE: u32 = 1 << 31;

pub(crate) struct ValueTable {
    /// Whether keys are of a signed type.
    signed: bool,
    most: usize,
    shift: u32,
    used: usize,
    /// A power of two, at least twice `most`.
    slots: Box<[Slot]>,
    /// Counts moved out of slots, by key: one per 2^31 values counted.
    moved: Vec<(u32, u64)>,
    /// Each slot holds less than `LARGE` plus this.
    pending: u64,
}

impl ValueTable {
    /// Bytes of a table, including the space for raising its shift.
    pub(crate) const BYTES: usize = 3 * MOST_CLASSES * size_of::<Slot>();

    pub(crate) fn new(signed: bool) -> Self {
        Self::with_at_most(signed, MOST_CLASSES)
    }

    /// Creates an empty table with at most `most` classes.
    pub(crate) fn with_at_most(signed: bool, most: usize) -> Self {
        let slots = vec![Slot::default(); 2 * most.next_power_of_two()].into_boxed_slice();
        Self { signed, most, shift: 0, used: 0, slots, moved: Vec::new(), pending: 0 }
    }

    /// Counts ordinals, fewer than 2^31 at a time, ignoring `None`.
    #[inline(always)]
    pub(crate) fn count(&mut self, ordinals: impl ExactSizeIterator<Item = Option<i64>>) {
        self.make_room(ordinals.len() as u64);
        for ordinal in ordinals.flatten() {
            self.add(class(ordinal, self.shift) as u32, 1);
        }
    }

    /// Counts one ordinal `count` times.
    pub(crate) fn constant(&mut self, ordinal: i64, mut count: u64) {
        while count > 0 {
            let part = count.min(LARGE as u64 - 1);
            self.make_room(part);
            self.add(class(ordinal, self.shift) as u32, part as u32);
            count -= part;
        }
    }

    /// Ensures that `more` values overflow no slot.
    #[inline(always)]
    fn make_room(&mut self, more: u64) {
        self.pending += more;
        if self.pending > (u32::MAX - LARGE) as u64 {
            self.relieve();
            self.pending = more;
        }
    }

    /// Moves large counts out of their slots, which stay in use.
    #[cold]
    fn relieve(&mut self) {
        for slot in self.slots.iter_mut().filter(|slot| slot.count >= LARGE) {
            self.moved.push((slot.key, slot.count as u64 - 1));
            slot.count = 1;
        }
    }

    #[inline(always)]
    fn add(&mut self, key: u32, count: u32) {
        let slot = self.slot(key);
        self.slots[slot] = Slot { key, count: self.slots[slot].count + count };
        if self.slots[slot].count == count {
            self.used += 1;
            if self.used > self.most {
                self.raise();
            }
        }
    }

    /// The slot of a key, or the free slot for it.
    #[inline(always)]
    fn slot(&self, key: u32) -> usize {
        let last = self.slots.len() - 1;
        // Fibonacci hashing: the product's upper bits.
        let mut slot = (key.wrapping_mul(0x9e37_79b1) as usize) >> (32 - self.slots.len().trailing_zeros());
        while self.slots[slot].key != key && self.slots[slot].count > 0 {
            slot = (slot + 1) & last;
        }
        slot
    }

    /// Raises the shift until few enough classes are in use.
    #[cold]
    fn raise(&mut self) {
        while self.used > self.most {
            // Merging pairs of classes must not overflow.
            self.relieve();
            self.shift += 1;
            let next = |key| class(class_of_key(key, self.signed), 1) as u32;
            let counted = |slot: &Slot| (slot.count > 0).then(|| Slot { key: next(slot.key), count: slot.count });
            let old: Vec<Slot> = self.slots.iter().filter_map(counted).collect();
            self.moved.iter_mut().for_each(|(key, _)| *key = next(*key));
            self.slots.fill(Slot::default());
            self.used = 0;
            for Slot { key, count } in old {
                let slot = self.slot(key);
                self.used += (self.slots[slot].count == 0) as usize;
                self.slots[slot] = Slot { key, count: self.slots[slot].count + count };
            }
            self.relieve();
        }
    }

    /// Returns all counts and resets to zero.
    pub(crate) fn take(&mut self) -> Classes {
        let counted = self.slots.iter().filter(|slot| slot.count > 0).map(|slot| (slot.key, slot.count as u64));
        let mut counts = Vec::with_capacity(self.used + self.moved.len());
        counts.extend(counted.chain(self.moved.drain(..)).map(|(key, count)| (class_of_key(key, self.signed), count)));
        let classes = Classes::of(self.shift, counts);
        self.slots.fill(Slot::default());
        (self.shift, self.used, self.pending) = (0, 0, 0);
        classes
    }
}

fn class_of_key(key: u32, signed: bool) -> i64 {
    if signed { key as i32 as i64 } else { key as i64 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::value_counts::ValueCounts;
    use brickyard_volume::VoxelType;
    use proptest::prelude::*;
    use std::collections::{BTreeMap, BTreeSet};

    /// The least shift with at most `most` classes for the ordinals, and the class counts, computed naively.
    fn plain(ordinals: &[i64], most: usize) -> (u32, BTreeMap<i64, u64>) {
        let classes = |shift| ordinals.iter().map(|&o| class(o, shift)).collect::<BTreeSet<i64>>();
        let shift = (0..).find(|&shift| classes(shift).len() <= most).unwrap();
        let mut counts = BTreeMap::new();
        ordinals.iter().for_each(|&o| *counts.entry(class(o, shift)).or_default() += 1);
        (shift, counts)
    }

    fn ordinals() -> impl Strategy<Value = Vec<i64>> {
        let any = i32::MIN as i64..=i32::MAX as i64;
        let near = prop_oneof![Just(0i64), Just(1 << 28), Just(i32::MIN as i64), Just(i32::MAX as i64 - 300)];
        let cluster =
            (near, 1i64..300).prop_flat_map(|(from, width)| prop::collection::vec(from..from + width, 0..200));
        (prop::collection::vec(any, 0..60), cluster, prop::collection::vec(-2i64..3, 0..20))
            .prop_map(|(a, b, c)| [a, b, c].concat())
    }

    proptest! {
        #[test]
        fn counts_depend_on_neither_order_nor_threads(
            values in ordinals(), most in 4usize..100, threads in 1usize..5, turn in any::<prop::sample::Index>(),
        ) {
            let (shift, expected) = plain(&values, most);
            let mut turned = values.clone();
            if !values.is_empty() {
                turned.rotate_left(turn.index(values.len()));
            }
            let mut counts = ValueCounts::with_at_most(VoxelType::I32, most);
            let mut table = ValueTable::with_at_most(true, most);
            for part in turned.chunks(values.len().div_ceil(threads).max(1)) {
                table.count(part.iter().map(|&o| Some(o)));
                counts.add(table.take());
            }
            let found: Vec<_> = counts.classes().collect();
            prop_assert_eq!(found.iter().map(|c| c.2).collect::<Vec<_>>(), expected.values().copied().collect::<Vec<_>>());
            for ((from, to, _), &class) in found.iter().zip(expected.keys()) {
                let inside = |o: &&i64| (*from as i64..=*to as i64).contains(*o);
                let own: Vec<_> = values.iter().filter(|&&o| crate::value_counts::class(o, shift) == class).collect();
                prop_assert_eq!(own, values.iter().filter(inside).collect::<Vec<_>>());
            }
        }

        /// The module's bound: classes are narrow relative to the span of all but `k` values.
        #[test]
        fn classes_are_as_narrow_as_is_said(values in ordinals(), most in 8usize..100, k in 0usize..4) {
            let (shift, _) = plain(&values, most);
            let distinct: Vec<i64> = values.iter().copied().collect::<BTreeSet<_>>().into_iter().collect();
            if shift > 0 {
                let span = distinct[distinct.len() - 1 - k] - distinct[0];
                prop_assert!((1i64 << shift) < (2 * span) / (most as i64 - 3 - k as i64) + 1);
            }
        }
    }

    #[test]
    fn counts_pass_what_a_slot_holds() {
        let mut table = ValueTable::with_at_most(true, 4);
        let mut counts = ValueCounts::with_at_most(VoxelType::I32, 4);
        let many = 3 * (1 << 32) + 5;
        table.constant(7, many);
        table.constant(8, many);
        table.constant(-7, 1 << 31);
        (100..104).for_each(|o| table.constant(o, 1));
        counts.add(table.take());
        let found: Vec<_> = counts.classes().collect();
        // Shift 1 has -8..-7, 7..8, 99..100, 101..102, 103..104; shift 2 one less.
        assert_eq!(found, [(-8.0, -5.0, 1 << 31), (5.0, 8.0, 2 * many), (97.0, 100.0, 1), (101.0, 104.0, 3)]);
    }
}
