//! Voxel statistics: the range of each brick, and per channel the exact range, mean, counts of non-finite voxels, and
//! counts by value, for percentiles and histograms.
//!
//! Types of 8 and 16 bits count 16-bit words in one table of 65,536: 8-bit voxels in pairs (which halves the additions;
//! folded once at the end), 16-bit voxels singly. One table beat two used in turn: it stays in the second-level cache.
//! Costs 0.3 ns a voxel at 8 bits, 0.6 at 16, and 0.8 MiB a thread. Types of 32 bits count values or, if there are too
//! many, classes of them (`value_counts.rs`, with the bound on percentiles). Results are independent of voxel order and
//! number of threads.
//!
//! Occupancy needs no histogram of its own. Neighbouring voxels share a 2x2x2 neighbourhood, which sets all bins
//! between its least and greatest value, and a path of neighbours joins any two voxels of a brick: so the mask is every
//! bin between the least and greatest valid voxel of the brick with its apron. (If non-finite voxels cut a brick in
//! two, this is an equally safe superset.)

use crate::downsample::Reduce;
use crate::metadata::{ChannelStatistics, HISTOGRAM_BINS, Histogram, Percentiles};
use crate::value_counts::{Classes, ValueCounts};
use crate::value_table::ValueTable;
use brickyard_volume::{OccupancyBins, VoxelType};

const WORDS: usize = 1 << 16;

/// Least and greatest valid voxel; `low > high` if there is none.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Range<T> {
    pub(crate) low: T,
    pub(crate) high: T,
}

impl<T: Measure> Range<T> {
    pub(crate) fn is_empty(&self) -> bool {
        self.low > self.high
    }

    #[inline(always)]
    pub(crate) fn join(self, other: Self) -> Self {
        Self {
            low: if other.low < self.low { other.low } else { self.low },
            high: if other.high > self.high { other.high } else { self.high },
        }
    }

    /// The range as data values; `None` if empty.
    pub(crate) fn to_f64(self) -> Option<(f64, f64)> {
        (!self.is_empty()).then(|| (self.low.to_f64(), self.high.to_f64()))
    }
}

/// The range of both ranges' values.
pub(crate) fn join(a: Option<(f64, f64)>, b: Option<(f64, f64)>) -> Option<(f64, f64)> {
    match (a, b) {
        (Some(a), Some(b)) => Some((a.0.min(b.0), a.1.max(b.1))),
        (a, b) => a.or(b),
    }
}

/// A voxel type's arithmetic for statistics.
pub(crate) trait Measure: Reduce {
    /// The range of no voxels, which has `low > high`.
    const EMPTY: Range<Self>;
    /// Range ends in side data without valid voxels: NaN, or crossed ones.
    const NO_ENDS: [Self; 2];
    /// The lesser of `low` and `value`, or `low` if `value` is invalid. `low` may come from an empty range. One vector
    /// operation when inlined.
    fn lower(low: Self, value: Self) -> Self;
    /// The greater of `high` and `value`, or `high` if `value` is invalid. `high` may come from an empty range. One
    /// vector operation when inlined.
    fn upper(high: Self, value: Self) -> Self;
    /// The range of the valid voxels.
    fn range(values: &[Self]) -> Range<Self> {
        values.iter().fold(Self::EMPTY, |range, &v| range.join(Self::range_of(v)))
    }
    /// The range of one voxel; empty if it is invalid.
    #[inline(always)]
    fn range_of(value: Self) -> Range<Self> {
        if value.is_valid() { Range { low: value, high: value } } else { Self::EMPTY }
    }
    /// Counts the valid voxels by value.
    fn count(values: &[Self], counter: &mut Counter);
    /// A whole number with the order of the valid values, 0 for zero; `None` for an invalid value.
    fn ordinal(self) -> Option<i64>;
    /// Adds sums of 32-bit voxels and numbers of non-finite voxels, which counts by value cannot supply to
    /// [`ChannelTotals`].
    fn tally(values: &[Self], tally: &mut Tally);
}

/// Counts 8-bit voxels, in pairs.
#[inline(always)]
fn count_bytes<T: Measure>(values: &[T], counter: &mut Counter) {
    let (bytes, counter): (&[u8], _) = (bytemuck::cast_slice(values), counter.words());
    let pairs = bytes.chunks_exact(2);
    counter.singles(pairs.remainder());
    counter.count(pairs.map(|c| u16::from_le_bytes([c[0], c[1]])));
}

/// Counts 16-bit voxels.
#[inline(always)]
fn count_words<T: Measure>(values: &[T], counter: &mut Counter) {
    counter.words().count(bytemuck::cast_slice(values).iter().copied());
}

/// Counts 32-bit voxels.
#[inline(always)]
fn count_ordinals<T: Measure>(values: &[T], counter: &mut Counter) {
    counter.values().count(values.iter().map(|&v| v.ordinal()));
}

macro_rules! integer_measure {
    ($count:ident: $($t:ty),*) => {$(
        impl Measure for $t {
            const EMPTY: Range<Self> = Range { low: <$t>::MAX, high: <$t>::MIN };
            const NO_ENDS: [Self; 2] = [<$t>::MAX, <$t>::MIN];
            #[inline(always)]
            fn ordinal(self) -> Option<i64> {
                Some(self as i64)
            }
            #[inline(always)]
            fn lower(low: Self, value: Self) -> Self {
                low.min(value)
            }
            #[inline(always)]
            fn upper(high: Self, value: Self) -> Self {
                high.max(value)
            }
            #[inline(always)]
            fn count(values: &[Self], counter: &mut Counter) {
                $count(values, counter);
            }
            #[inline(always)]
            fn tally(values: &[Self], tally: &mut Tally) {
                if size_of::<Self>() == 4 {
                    // Sums of a row of 32-bit integers are exact in i64.
                    tally.sum += values.iter().map(|&v| v as i64).sum::<i64>() as f64;
                }
            }
        }
    )*};
}
integer_measure!(count_bytes: u8, i8);
integer_measure!(count_words: u16, i16);
integer_measure!(count_ordinals: u32, i32);

impl Measure for f32 {
    const EMPTY: Range<f32> = Range { low: f32::INFINITY, high: f32::NEG_INFINITY };
    const NO_ENDS: [f32; 2] = [f32::NAN; 2];

    #[inline(always)]
    fn ordinal(self) -> Option<i64> {
        let size = (self.to_bits() & 0x7fff_ffff) as i64;
        let ordinal = if self.is_sign_negative() { -size } else { size };
        (self.abs() <= f32::MAX).then_some(ordinal)
    }
    #[inline(always)]
    fn lower(low: f32, value: f32) -> f32 {
        if value < low && value.abs() <= f32::MAX { value } else { low }
    }
    #[inline(always)]
    fn upper(high: f32, value: f32) -> f32 {
        if value > high && value.abs() <= f32::MAX { value } else { high }
    }

    #[inline(always)]
    fn count(values: &[f32], counter: &mut Counter) {
        count_ordinals(values, counter);
    }

    #[inline(always)]
    fn tally(values: &[f32], tally: &mut Tally) {
        let mut sums = [0.0f64; 8];
        let mut finite = [0u32; 8];
        let mut add = |i: usize, v: f32| {
            let valid = v.abs() <= f32::MAX;
            sums[i] += if valid { v as f64 } else { 0.0 };
            finite[i] += valid as u32;
        };
        let chunks = values.chunks_exact(8);
        chunks.remainder().iter().enumerate().for_each(|(i, &v)| add(i, v));
        for chunk in chunks {
            (0..8).for_each(|i| add(i, chunk[i]));
        }
        tally.sum += sums.iter().sum::<f64>();
        if finite.iter().sum::<u32>() as usize != values.len() {
            tally.nan += values.iter().filter(|v| v.is_nan()).count() as u64;
            tally.positive_infinite += values.iter().filter(|v| **v == f32::INFINITY).count() as u64;
            tally.negative_infinite += values.iter().filter(|v| **v == f32::NEG_INFINITY).count() as u64;
        }
    }
}

/// A sum of voxels, with counts of non-finite and no-data ones. Added in brick order, so rounding is independent of
/// threads.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Tally {
    pub(crate) sum: f64,
    pub(crate) nan: u64,
    pub(crate) positive_infinite: u64,
    pub(crate) negative_infinite: u64,
    pub(crate) nodata: u64,
}

impl Tally {
    pub(crate) fn add(&mut self, other: &Tally) {
        self.sum += other.sum;
        self.nan += other.nan;
        self.positive_infinite += other.positive_infinite;
        self.negative_infinite += other.negative_infinite;
        self.nodata += other.nodata;
    }
}

/// One thread's counts of one channel's voxels by value.
pub(crate) enum Counter {
    /// 8- and 16-bit values.
    Words(WordTable),
    /// 32-bit values.
    Values(ValueTable),
}

impl Counter {
    pub(crate) fn new(voxel_type: VoxelType) -> Self {
        match voxel_type.bytes() {
            1 | 2 => Self::Words(WordTable::new()),
            _ => Self::Values(ValueTable::new(voxel_type != VoxelType::U32)),
        }
    }

    pub(crate) const fn bytes(voxel_bytes: usize) -> usize {
        if voxel_bytes <= 2 { WORDS * 12 + 2048 } else { ValueTable::BYTES }
    }

    #[inline(always)]
    fn words(&mut self) -> &mut WordTable {
        match self {
            Self::Words(words) => words,
            Self::Values(_) => unreachable!("8 and 16 bits are counted as words"),
        }
    }

    #[inline(always)]
    fn values(&mut self) -> &mut ValueTable {
        match self {
            Self::Values(values) => values,
            Self::Words(_) => unreachable!("32 bits are counted as values"),
        }
    }

    /// Counts `count` voxels of one value.
    pub(crate) fn constant<T: Measure>(&mut self, value: T, count: u64) {
        match self {
            Self::Words(words) => words.constant(value, count),
            Self::Values(values) => value.ordinal().into_iter().for_each(|ordinal| values.constant(ordinal, count)),
        }
    }

    /// Moves all counts to the channel's, leaving zero.
    pub(crate) fn drain_into(&mut self, channel: &mut ChannelTotals) {
        match self {
            Self::Words(words) => words.drain_into(channel),
            Self::Values(values) => channel.values.add(values.take()),
        }
    }
}

/// Counts of 16-bit words.
pub(crate) struct WordTable {
    counts: Box<[u32; WORDS]>,
    /// Single bytes, from rows of an odd number of 8-bit voxels.
    bytes: Box<[u64; 256]>,
    totals: Box<[u64; WORDS]>,
    /// Words counted since `counts` was last emptied; below 2^32, so no entry overflows.
    pending: u64,
}

impl WordTable {
    fn new() -> Self {
        Self { counts: zeroed(), bytes: Box::new([0; 256]), totals: zeroed(), pending: 0 }
    }

    #[inline(always)]
    fn count(&mut self, words: impl ExactSizeIterator<Item = u16>) {
        self.pending += words.len() as u64;
        if self.pending > u32::MAX as u64 {
            self.settle();
            self.pending = words.len() as u64;
        }
        let counts = &mut *self.counts;
        for word in words {
            counts[word as usize] += 1;
        }
    }

    #[inline(always)]
    fn singles(&mut self, bytes: &[u8]) {
        bytes.iter().for_each(|&b| self.bytes[b as usize] += 1);
    }

    fn constant<T: Measure>(&mut self, value: T, count: u64) {
        match *bytemuck::bytes_of(&value) {
            [byte] => self.bytes[byte as usize] += count,
            [low, high] => self.totals[u16::from_le_bytes([low, high]) as usize] += count,
            _ => unreachable!("8 and 16 bits are counted as words"),
        }
    }

    #[cold]
    fn settle(&mut self) {
        for (total, count) in self.totals.iter_mut().zip(self.counts.iter_mut()) {
            *total += std::mem::take(count) as u64;
        }
        self.pending = 0;
    }

    /// Moves all counts to the channel's histogram, in order of value.
    fn drain_into(&mut self, channel: &mut ChannelTotals) {
        self.settle();
        let bins = &mut channel.bins;
        match channel.voxel_type {
            VoxelType::U8 | VoxelType::I8 => {
                let flip = if channel.voxel_type == VoxelType::I8 { 0x80 } else { 0 };
                for (word, count) in self.totals.iter().enumerate().filter(|(_, n)| **n > 0) {
                    bins[word & 0xff ^ flip] += count;
                    bins[word >> 8 ^ flip] += count;
                }
                self.bytes.iter().enumerate().for_each(|(byte, count)| bins[byte ^ flip] += count);
            }
            VoxelType::U16 => bins.iter_mut().zip(self.totals.iter()).for_each(|(bin, count)| *bin += count),
            VoxelType::I16 => self.totals.iter().enumerate().for_each(|(word, count)| bins[word ^ 0x8000] += count),
            VoxelType::U32 | VoxelType::I32 | VoxelType::F32 => {}
        }
        self.totals.fill(0);
        self.bytes.fill(0);
    }
}

/// Allocates a table on the heap without a copy on the stack.
fn zeroed<T: Copy + Default>() -> Box<[T; WORDS]> {
    match vec![T::default(); WORDS].into_boxed_slice().try_into() {
        Ok(table) => table,
        Err(_) => unreachable!("the length is the array's"),
    }
}

/// Statistics of all voxels of one channel, over all time steps, at full resolution.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct ChannelTotals {
    voxel_type: VoxelType,
    /// Least and greatest valid voxel; `None` if there is none.
    range: Option<(f64, f64)>,
    tally: Tally,
    /// Counts of each 8- or 16-bit value, in ascending order.
    bins: Vec<u64>,
    /// Counts of 32-bit values.
    values: ValueCounts,
}

impl ChannelTotals {
    pub(crate) fn new(voxel_type: VoxelType) -> Self {
        Self {
            voxel_type,
            range: None,
            tally: Tally::default(),
            bins: vec![0; Self::bins(voxel_type)],
            values: ValueCounts::new(voxel_type),
        }
    }

    /// Number of 8- or 16-bit values.
    const fn bins(voxel_type: VoxelType) -> usize {
        match voxel_type.bytes() {
            1 => 256,
            2 => WORDS,
            _ => 0,
        }
    }

    /// Most bytes taken by one channel's counts.
    pub(crate) const fn bytes(voxel_type: VoxelType) -> u64 {
        match voxel_type.bytes() {
            1 | 2 => Self::bins(voxel_type) as u64 * 8,
            _ => ValueCounts::BYTES,
        }
    }

    /// Temporary bytes for adding to a channel's counts.
    pub(crate) const fn adding_bytes(voxel_type: VoxelType) -> u64 {
        if voxel_type.bytes() <= 2 { 0 } else { ValueCounts::ADDING_BYTES }
    }

    /// Least and greatest value of each class, with its count, in ascending order.
    fn classes(&self) -> impl Iterator<Item = (f64, f64, u64)> {
        let low = self.voxel_type.limits().0;
        let bins = self.bins.iter().enumerate().filter(|(_, n)| **n > 0);
        bins.map(move |(i, &n)| (low + i as f64, low + i as f64, n)).chain(self.values.classes())
    }

    /// Appends all counts to a list of words, for [`ChannelTotals::from_words`].
    pub(crate) fn to_words(&self, words: &mut Vec<u64>) {
        let (low, high) = self.range.unwrap_or((f64::INFINITY, f64::NEG_INFINITY));
        let Tally { sum, nan, positive_infinite, negative_infinite, nodata } = self.tally;
        words.extend([low, high, sum].map(f64::to_bits));
        words.extend([nan, positive_infinite, negative_infinite, nodata]);
        let bins = (0..).zip(&self.bins).filter(|(_, count)| **count > 0).map(|(bin, count)| (bin, *count));
        let Classes { shift, counts } = self.values.classes_of_ordinals();
        let counts: Vec<(i64, u64)> = bins.chain(counts.iter().copied()).collect();
        words.extend([*shift as u64, counts.len() as u64]);
        words.extend(counts.iter().flat_map(|&(class, count)| [class as u64, count]));
    }

    /// Restores totals from the words of [`ChannelTotals::to_words`]; `None` if the words are invalid.
    pub(crate) fn from_words(voxel_type: VoxelType, words: &mut impl Iterator<Item = u64>) -> Option<Self> {
        let mut next = || words.next();
        let [low, high, sum] = [next()?, next()?, next()?].map(f64::from_bits);
        let [nan, positive_infinite, negative_infinite, nodata, shift, length] =
            [next()?, next()?, next()?, next()?, next()?, next()?];
        let range = (low <= high).then_some((low, high));
        let tally = Tally { sum, nan, positive_infinite, negative_infinite, nodata };
        let mut totals = Self { range, tally, ..Self::new(voxel_type) };
        let mut counts = Vec::new();
        for _ in 0..length {
            counts.push((next()? as i64, next()?));
        }
        if Self::bins(voxel_type) == 0 {
            totals.values = ValueCounts::of_classes(voxel_type, Classes { shift: shift.try_into().ok()?, counts })?;
            return Some(totals);
        }
        for (bin, count) in counts {
            *totals.bins.get_mut(usize::try_from(bin).ok()?)? = count;
        }
        Some(totals)
    }

    /// Whether both are totals of the same voxels, up to the order of summation, which affects a float sum's last
    /// digits.
    pub(crate) fn is_near(&self, other: &Self) -> bool {
        let voxels = (self.valid() + self.non_finite() + self.nodata()).max(1) as f64;
        let largest = self.range.map_or(0.0, |(low, high)| low.abs().max(high.abs()));
        let (sum, others) = (self.tally.sum, other.tally.sum);
        let is_same_but_sum = Self { tally: Tally { sum: others, ..self.tally }, ..self.clone() } == *other;
        is_same_but_sum && (sum - others).abs() <= 1e-9 * largest * voxels
    }

    pub(crate) fn add_tally(&mut self, tally: &Tally) {
        self.tally.add(tally);
    }

    pub(crate) fn add_range(&mut self, range: Option<(f64, f64)>) {
        self.range = join(self.range, range);
    }

    /// Number of NaN and infinite voxels.
    pub(crate) fn non_finite(&self) -> u64 {
        self.tally.nan + self.tally.positive_infinite + self.tally.negative_infinite
    }

    /// Number of no-data voxels.
    pub(crate) fn nodata(&self) -> u64 {
        self.tally.nodata
    }

    fn valid(&self) -> u64 {
        self.classes().map(|(_, _, n)| n).sum()
    }

    /// The mean of the valid voxels; `None` if there are none. Exact to one rounding for 8 and 16 bits.
    fn mean(&self) -> Option<f64> {
        let valid = self.valid();
        let sum = if self.voxel_type.bytes() <= 2 {
            // At most 2^63 voxels of 2^16: exact in i128.
            let low = self.voxel_type.limits().0 as i128;
            self.bins.iter().enumerate().map(|(i, &n)| (low + i as i128) * n as i128).sum::<i128>() as f64
        } else {
            self.tally.sum
        };
        (valid > 0).then(|| sum / valid as f64)
    }

    /// The value not exceeded by `ten_thousandths` / 10,000 of the valid voxels (nearest rank), if any. Exact for 8 and
    /// 16 bits, and for individually counted 32-bit values; otherwise within the bound in `value_counts.rs`.
    pub(crate) fn percentile(&self, ten_thousandths: u64) -> Option<f64> {
        let (low, high) = self.range?;
        let valid = self.valid();
        let rank = (valid as u128 * ten_thousandths as u128).div_ceil(10_000).clamp(1, valid.max(1) as u128) as u64;
        let mut below = 0;
        for (from, to, count) in self.classes() {
            if below + count >= rank {
                let t = (rank - below) as f64 / count as f64;
                return Some((from + t * (to - from)).clamp(low, high));
            }
            below += count;
        }
        Some(high)
    }

    /// The metadata's histogram: one bin per value for 8 bits, otherwise equal bins over the range. A class of values
    /// is split evenly among the bins it spans.
    fn histogram(&self, (low, high): (f64, f64)) -> Histogram {
        let (first, width) = match self.voxel_type.bytes() {
            1 => (self.voxel_type.limits().0, 1.0),
            _ if high > low => (low, (high - low) / HISTOGRAM_BINS as f64),
            _ => (low, 1.0),
        };
        let bin = |value: f64| ((value - first) / width).clamp(0.0, (HISTOGRAM_BINS - 1) as f64) as usize;
        let mut counts = vec![0; HISTOGRAM_BINS];
        for (from, to, count) in self.classes() {
            let (from, to) = (from.clamp(low, high), to.clamp(low, high));
            let mut shared = 0;
            for i in bin(from)..=bin(to) {
                let end = first + (i + 1) as f64 * width;
                let part = if i == bin(to) { 1.0 } else { ((end - from) / (to - from)).clamp(0.0, 1.0) };
                let until = (count as f64 * part) as u64;
                counts[i] += if i == bin(to) { count - shared } else { until.saturating_sub(shared) };
                shared = shared.max(until);
            }
        }
        Histogram { low: first, width, counts }
    }

    /// The channel's statistics in the form of the metadata.
    pub(crate) fn finish(&self) -> ChannelStatistics {
        let range = self.range.unwrap_or_default();
        let at = |ten_thousandths| self.percentile(ten_thousandths).unwrap_or_default();
        let percentiles = Percentiles {
            p0_1: at(10),
            p1: at(100),
            p5: at(500),
            p50: at(5000),
            p95: at(9500),
            p99: at(9900),
            p99_9: at(9990),
        };
        ChannelStatistics {
            range: range.into(),
            count: self.valid(),
            nan: self.tally.nan,
            pos_inf: self.tally.positive_infinite,
            neg_inf: self.tally.negative_infinite,
            nodata: self.tally.nodata,
            mean: self.mean().unwrap_or_default(),
            percentiles,
            histogram: self.histogram(range),
            window: percentiles.usual_window(range.into()),
            bins: self.occupancy_bins(),
            name: None,
            color: None,
            unit: None,
        }
    }

    /// Bins of the channel's occupancy masks: four values each for 8 bits; otherwise over the range of all but the
    /// outermost 0.01 % of voxels, so outliers do not make them coarse.
    fn occupancy_bins(&self) -> OccupancyBins {
        if self.voxel_type.bytes() == 1 {
            return OccupancyBins { low: self.voxel_type.limits().0, width: 256.0 / OccupancyBins::COUNT as f64 };
        }
        let body = self.percentile(1).zip(self.percentile(9999)).filter(|(low, high)| low < high);
        let (low, high) = body.or(self.range).unwrap_or_default();
        OccupancyBins::over(low, high)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn channel<T: Measure>(values: &[T]) -> ChannelTotals {
        let mut statistics = ChannelTotals::new(T::TYPE);
        let mut counter = Counter::new(T::TYPE);
        let mut tally = Tally::default();
        // Odd pieces, for both pairs and single bytes.
        for row in values.chunks(7) {
            T::count(row, &mut counter);
            T::tally(row, &mut tally);
        }
        counter.drain_into(&mut statistics);
        statistics.add_tally(&tally);
        statistics.add_range(T::range(values).to_f64());
        statistics
    }

    #[test]
    fn eight_and_sixteen_bit_statistics_are_exact() {
        let values: Vec<i8> = (-100..=100).chain([-128, 127, 127]).collect();
        let s = channel(&values);
        assert_eq!((s.range, s.valid()), (Some((-128.0, 127.0)), 204));
        assert_eq!(s.mean(), Some(126.0 / 204.0));
        assert_eq!([0, 5000, 10_000].map(|p| s.percentile(p).unwrap()), [-128.0, 0.0, 127.0]);
        let values: Vec<i16> = (-1000..=1000).collect();
        let s = channel(&values);
        assert_eq!((s.mean(), s.percentile(5000)), (Some(0.0), Some(0.0)));
        let h = s.finish().histogram;
        assert_eq!((h.low, h.width, h.counts.iter().sum::<u64>()), (-1000.0, 2000.0 / 256.0, 2001));
        // A bin of 7.8125 values holds 7 or 8 of them; the last one includes its upper edge.
        assert!(h.counts.iter().all(|n| (7..=8).contains(n)), "{h:?}");
    }

    #[test]
    fn float_statistics_leave_out_what_is_not_finite() {
        let (nan, inf) = (f32::NAN, f32::INFINITY);
        let mut values: Vec<f32> = (1..=1000).map(|i| i as f32 - 500.5).collect();
        values.extend([nan, inf, inf, -inf]);
        let s = channel(&values);
        assert_eq!((s.tally.nan, s.tally.positive_infinite, s.tally.negative_infinite, s.valid()), (1, 2, 1, 1000));
        assert_eq!((s.range, s.mean()), (Some((-499.5, 499.5)), Some(0.0)));
        for percent in [1, 25, 60, 99] {
            assert_eq!(s.percentile(100 * percent), Some(percent as f64 * 10.0 - 500.5), "{percent}");
        }
        assert!(<f32 as Measure>::range(&[nan, inf]).is_empty());
    }

    #[test]
    fn wide_integers_keep_their_order() {
        let values: Vec<i32> = (-300..700).collect();
        let s = channel(&values);
        assert_eq!((s.range, s.mean(), s.valid()), (Some((-300.0, 699.0)), Some(199.5), 1000));
        assert_eq!(s.percentile(5000), Some(199.0));
    }

    #[test]
    fn constants_count_like_their_voxels() {
        fn check<T: Measure>(value: T) {
            let plain = channel(&[value; 1000]);
            let mut statistics = ChannelTotals::new(T::TYPE);
            let mut counter = Counter::new(T::TYPE);
            counter.constant(value, 1000);
            counter.drain_into(&mut statistics);
            assert_eq!(statistics.classes().collect::<Vec<_>>(), plain.classes().collect::<Vec<_>>(), "{}", T::TYPE);
            assert_eq!(statistics.valid(), 1000);
        }
        check(200u8);
        check(-3i8);
        check(60000u16);
        check(-7i16);
        check(u32::MAX);
        check(-5i32);
        check(-2.5f32);
    }

    /// The ranks of the metadata's percentiles, and the ends.
    const SHARES: [u64; 9] = [0, 10, 100, 500, 5000, 9500, 9900, 9990, 10_000];

    /// The value of this rank, by sorting.
    fn sorted_rank<T: Measure>(values: &[T], ten_thousandths: u64) -> f64 {
        let mut valid: Vec<f64> = values.iter().filter(|v| v.is_valid()).map(|v| v.to_f64()).collect();
        valid.sort_by(f64::total_cmp);
        let rank = (valid.len() as u64 * ten_thousandths).div_ceil(10_000).max(1);
        valid[rank as usize - 1]
    }

    #[test]
    fn few_values_have_exact_percentiles_wherever_they_lie() {
        fn check<T: Measure>(name: &str, values: impl IntoIterator<Item = T>) {
            let values: Vec<T> = values.into_iter().collect();
            let s = channel(&values);
            for share in SHARES {
                assert_eq!(s.percentile(share), Some(sorted_rank(&values, share)), "{name}: {share}");
            }
            let h = s.finish().histogram;
            let mut expected = vec![0; HISTOGRAM_BINS];
            for value in values.iter().filter(|v| v.is_valid()) {
                let at = ((value.to_f64() - h.low) / h.width) as usize;
                expected[at.min(HISTOGRAM_BINS - 1)] += 1;
            }
            assert_eq!(h.counts, expected, "{name}");
        }
        let mixed = |n: u32| (0..n).map(|i| i.wrapping_mul(2_654_435_761) % 1001);
        check("offset i32", mixed(50_000).map(|i| (1 << 28) + i as i32));
        check("offset u32", mixed(50_000).map(|i| u32::MAX - i));
        check("negative i32", mixed(50_000).map(|i| i32::MIN + i as i32));
        check("offset f32", mixed(50_000).map(|i| 1e6 + i as f32 / 16.0));
        check("zeros", mixed(50_000).map(|i| if i > 20 { 0.0 } else { i as f32 * 1e-3 }));
        check("zeros and denormals", mixed(50_000).map(|i| f32::from_bits(if i > 20 { 0 } else { i })));
        check("all zero", [0.0, -0.0, 0.0f32]);
        check("denormals", mixed(50_000).map(f32::from_bits));
        check("constant", [7.25f32; 100]);
        check("outliers", mixed(50_000).map(|i| if i < 3 { 1e9 * (i as f32 - 1.0) } else { 37.0 + i as f32 * 1e-4 }));
        check("two clusters", mixed(50_000).map(|i| if i % 2 == 0 { -1e6 - i as f32 } else { 1e-6 * i as f32 }));
        check("not finite", mixed(50_000).map(|i| if i % 3 == 0 { f32::NAN } else { i as f32 - 500.0 }));
        check("limits", [f32::MIN, f32::MAX, 0.0, f32::INFINITY, f32::MIN_POSITIVE, -f32::MIN_POSITIVE]);
    }

    #[test]
    fn many_values_have_percentiles_within_the_bound() {
        // 400,000 values, most of them distinct.
        let noise = || (0..400_000u32).map(|i| i.wrapping_mul(2_654_435_761) ^ i >> 5);
        let integers: Vec<i32> = noise().map(|i| i as i32).collect();
        let s = channel(&integers);
        for share in SHARES {
            let off = (s.percentile(share).unwrap() - sorted_rank(&integers, share)).abs();
            assert!(off < 2f64.powi(32) / 32_766.0, "{share}: {off}");
        }
        // Scattered outliers do not make the values in between coarse.
        let outliers: Vec<i32> =
            noise().enumerate().map(|(i, n)| if i < 20_000 { n as i32 } else { (n % 1_000_000) as i32 }).collect();
        let s = channel(&outliers);
        for share in [500, 5000, 9000] {
            let off = (s.percentile(share).unwrap() - sorted_rank(&outliers, share)).abs();
            assert!(off < 2e6 / (65_533.0 - 20_000.0), "{share}: {off}");
        }
        let floats: Vec<f32> = noise().map(f32::from_bits).collect();
        let s = channel(&floats);
        for share in SHARES {
            let exact = sorted_rank(&floats, share);
            let off = (s.percentile(share).unwrap() - exact).abs();
            assert!(off <= exact.abs() / 128.0 + 2f64.powi(-133), "{share}: {off}");
        }
        let narrow: Vec<f32> = noise().map(|i| 300.0 + (i as f64 / 2f64.powi(32)) as f32 * 10.0).collect();
        let s = channel(&narrow);
        for share in SHARES {
            let off = (s.percentile(share).unwrap() - sorted_rank(&narrow, share)).abs();
            assert!(off < 10.0 / 16_000.0, "{share}: {off}");
        }
        let h = s.finish().histogram;
        let even = narrow.len() as f64 / HISTOGRAM_BINS as f64;
        assert!(h.counts.iter().all(|&n| (n as f64 - even).abs() < 0.1 * even), "{h:?}");
    }

    #[test]
    fn ranks_are_not_rounded() {
        // 99.9 % of 1000 is the 999th; as a product of doubles it is slightly more.
        let s = channel(&(1..=1000u16).collect::<Vec<_>>());
        assert_eq!((s.percentile(9990), s.percentile(10), s.percentile(2900)), (Some(999.0), Some(1.0), Some(290.0)));
    }
}
