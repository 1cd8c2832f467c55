//! How often each 32-bit value occurs: exactly while there are at most [`MOST_CLASSES`] different ones, else by classes that
//! follow from the values alone, whatever their order and however they were shared out among threads.
//!
//! A value's *ordinal* is a whole number that orders like it and keeps zero: an integer itself; a float's bits without the sign,
//! then the sign. A class of *shift* `s` is what has the same ordinal after division by 2^s, rounded away from zero. So
//! zero is always a class by itself, shift 0 has one value a class, and classes of one shift are unions of those of the last. The
//! shift is the least at which no more than [`MOST_CLASSES`] classes have values. This depends on the set of values alone: a thread
//! that saw some of them has that shift or a lesser one, and merging goes on from the greatest.
//!
//! How far a percentile can be off: less than 2^s ordinals, for that is a class's width, and one shift less had more than
//! `MOST_CLASSES` classes. Values from ordinal `a` to `b`, and any `k` others, have at most (b - a) / 2^(s-1) + 3 + k of those.
//! So 2^s < 2 (b - a) / (MOST_CLASSES - 3 - k): integers are off by less than 1/32,766 of their range, and by less than 1/16,000 of
//! what they span but for 32,000 outliers, wherever those are. The same holds of floats' ordinals, of which there are 2^32 in all:
//! `s` is at most 16, and that is 1/128 of a value, or 2^-133 of those below the least normal one.

use brickyard_volume::VoxelType;

/// The most classes that are told apart.
pub(crate) const MOST_CLASSES: usize = 1 << 16;

/// The class of an ordinal at a shift. Given a class in place of the ordinal, its class `shift` shifts further up.
#[inline(always)]
pub(crate) fn class(ordinal: i64, shift: u32) -> i64 {
    let size = ordinal.abs();
    let class = (size >> shift) + (size & ((1 << shift) - 1) != 0) as i64;
    if ordinal < 0 { -class } else { class }
}

/// The value of an ordinal; of a float beyond the greatest, the greatest.
fn value(voxel_type: VoxelType, ordinal: i64) -> f64 {
    if !voxel_type.is_float() {
        return ordinal as f64;
    }
    let size = ordinal.unsigned_abs().min(f32::MAX.to_bits() as u64);
    let value = f32::from_bits(size as u32) as f64;
    if ordinal < 0 { -value } else { value }
}

/// How often values occur, by class, in ascending order.
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
    /// Makes classes from counts in any order, in which a class may occur more than once.
    pub(crate) fn of(shift: u32, mut counts: Vec<(i64, u64)>) -> Self {
        counts.sort_unstable();
        let mut classes = Self { shift, counts };
        classes.sum_equals();
        classes
    }

    /// Joins classes to those of a greater shift.
    fn raise_to(&mut self, shift: u32) {
        let by = shift - self.shift;
        self.shift = shift;
        if by > 0 {
            self.counts.iter_mut().for_each(|(c, _)| *c = class(*c, by));
            self.sum_equals();
        }
    }

    /// Takes classes of the same shift in.
    fn join(&mut self, other: Self) {
        self.counts.extend(other.counts);
        // Two ascending runs, which a stable sort merges.
        self.counts.sort_by_key(|(class, _)| *class);
        self.sum_equals();
    }

    /// Adds up neighbours of one class.
    fn sum_equals(&mut self) {
        self.counts.dedup_by(|next, kept| {
            let same = next.0 == kept.0;
            kept.1 += if same { next.1 } else { 0 };
            same
        });
    }
}

impl ValueCounts {
    /// The most bytes that the counts of one channel take.
    pub(crate) const BYTES: u64 = (MOST_CLASSES * size_of::<(i64, u64)>()) as u64;
    /// Bytes that adding to the counts of one channel takes for a while.
    pub(crate) const ADDING_BYTES: u64 = 4 * Self::BYTES;

    pub(crate) fn new(voxel_type: VoxelType) -> Self {
        Self::with_at_most(voxel_type, MOST_CLASSES)
    }

    /// Makes empty counts that tell at most `most` classes apart.
    pub(crate) fn with_at_most(voxel_type: VoxelType, most: usize) -> Self {
        Self { voxel_type, most, classes: Classes::default() }
    }

    /// Makes counts of these classes; `None` if there can be none such.
    pub(crate) fn of_classes(voxel_type: VoxelType, classes: Classes) -> Option<Self> {
        let Classes { shift, counts } = &classes;
        let is_ordinal = |class: i64| class.unsigned_abs() <= (1 << 32 >> shift) + 1;
        let is_sound = *shift <= 32
            && counts.len() <= MOST_CLASSES
            && counts.is_sorted_by(|a, b| a.0 < b.0)
            && counts.iter().all(|&(class, count)| is_ordinal(class) && count > 0);
        is_sound.then_some(Self { voxel_type, most: MOST_CLASSES, classes })
    }

    /// The classes and their counts, ascending.
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

    /// For each class, ascending: its least value, its greatest value, and how many voxels it has.
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
