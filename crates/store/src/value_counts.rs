//! Counts of 32-bit values: exact up to [`MOST_CLASSES`] different ones, otherwise by classes that depend on the values
//! alone, not on order or threads.
//!
//! A value's *ordinal* is a whole number with the same order and zero: an integer itself; for a float the bits without
//! the sign, then the sign. A class of *shift* `s` comprises ordinals that agree after division by 2^s, rounded away
//! from zero. So zero is always a class of its own, shift 0 has one value per class, and each shift's classes are
//! unions of the previous one's. The shift is the least with at most [`MOST_CLASSES`] non-empty classes. It depends
//! only on the set of values: a thread with some of them has this shift or a lower one, and merging continues from the
//! greatest.
//!
//! A percentile's error is less than 2^s ordinals, the width of a class, and the shift below had more than
//! `MOST_CLASSES` classes. Values from ordinal `a` to `b`, and any `k` others, have at most (b - a) / 2^(s-1) + 3 + k
//! of those. So 2^s < 2 (b - a) / (MOST_CLASSES - 3 - k): integers are off by less than 1/32,766 of their range, and by
//! less than 1/16,000 of the range without any 32,000 outliers. The same holds for floats' ordinals, 2^32 in all: `s`
//! is at most 16, which is 1/128 of a value, or 2^-133 below the least normal one.

use brickyard_volume::VoxelType;

/// Most classes counted separately.
pub(crate) const MOST_CLASSES: usize = 1 << 16;

/// The class of an ordinal at a shift. Given a class instead of an ordinal, its class `shift` shifts higher.
#[inline(always)]
pub(crate) fn class(ordinal: i64, shift: u32) -> i64 {
    let size = ordinal.abs();
    let class = (size >> shift) + (size & ((1 << shift) - 1) != 0) as i64;
    if ordinal < 0 { -class } else { class }
}

/// The value of an ordinal; float ordinals past the greatest value are clamped to it.
fn value(voxel_type: VoxelType, ordinal: i64) -> f64 {
    if !voxel_type.is_float() {
        return ordinal as f64;
    }
    let size = ordinal.unsigned_abs().min(f32::MAX.to_bits() as u64);
    let value = f32::from_bits(size as u32) as f64;
    if ordinal < 0 { -value } else { value }
}

/// Counts of values by class, in ascending order.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct ValueCounts {
    voxel_type: VoxelType,
    most: usize,
    classes: Classes,
}

/// The classes of one shift and their counts, ascending.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Classes {
    pub(crate) shift: u32,
    pub(crate) counts: Vec<(i64, u64)>,
}

impl Classes {
    /// Builds classes from counts in any order, with repeated classes allowed.
    pub(crate) fn of(shift: u32, mut counts: Vec<(i64, u64)>) -> Self {
        counts.sort_unstable();
        let mut classes = Self { shift, counts };
        classes.sum_equals();
        classes
    }

    /// Merges classes up to a greater shift.
    fn raise_to(&mut self, shift: u32) {
        let by = shift - self.shift;
        self.shift = shift;
        if by > 0 {
            self.counts.iter_mut().for_each(|(c, _)| *c = class(*c, by));
            self.sum_equals();
        }
    }

    /// Adds classes of the same shift.
    fn join(&mut self, other: Self) {
        self.counts.extend(other.counts);
        // Two ascending runs, merged by a stable sort.
        self.counts.sort_by_key(|(class, _)| *class);
        self.sum_equals();
    }

    /// Adds up neighbours of the same class.
    fn sum_equals(&mut self) {
        self.counts.dedup_by(|next, kept| {
            let same = next.0 == kept.0;
            kept.1 += if same { next.1 } else { 0 };
            same
        });
    }
}

impl ValueCounts {
    /// Most bytes taken by one channel's counts.
    pub(crate) const BYTES: u64 = (MOST_CLASSES * size_of::<(i64, u64)>()) as u64;
    /// Temporary bytes for adding to one channel's counts.
    pub(crate) const ADDING_BYTES: u64 = 4 * Self::BYTES;

    pub(crate) fn new(voxel_type: VoxelType) -> Self {
        Self::with_at_most(voxel_type, MOST_CLASSES)
    }

    /// Creates empty counts with at most `most` classes.
    pub(crate) fn with_at_most(voxel_type: VoxelType, most: usize) -> Self {
        Self { voxel_type, most, classes: Classes::default() }
    }

    /// Wraps these classes; `None` if they are impossible.
    pub(crate) fn of_classes(voxel_type: VoxelType, classes: Classes) -> Option<Self> {
        let Classes { shift, counts } = &classes;
        let is_ordinal = |class: i64| class.unsigned_abs() <= (1 << 32 >> shift) + 1;
        let is_sound = *shift <= 32
            && counts.len() <= MOST_CLASSES
            && counts.is_sorted_by(|a, b| a.0 < b.0)
            && counts.iter().all(|&(class, count)| is_ordinal(class) && count > 0);
        is_sound.then_some(Self { voxel_type, most: MOST_CLASSES, classes })
    }

    pub(crate) fn classes_of_ordinals(&self) -> &Classes {
        &self.classes
    }

    pub(crate) fn add(&mut self, mut other: Classes) {
        let shift = self.classes.shift.max(other.shift);
        self.classes.raise_to(shift);
        other.raise_to(shift);
        self.classes.join(other);
        while self.classes.counts.len() > self.most {
            self.classes.raise_to(self.classes.shift + 1);
        }
        self.classes.counts.shrink_to_fit();
    }

    /// The classes in ascending order: least value, greatest value and number of voxels.
    pub(crate) fn classes(&self) -> impl Iterator<Item = (f64, f64, u64)> {
        let shift = self.classes.shift;
        self.classes.counts.iter().map(move |&(class, count)| {
            let far = class << shift;
            let near = if class == 0 { 0 } else { far - class.signum() * ((1 << shift) - 1) };
            let [from, to] = [near.min(far), near.max(far)].map(|ordinal| value(self.voxel_type, ordinal));
            (from, to, count)
        })
    }
}
