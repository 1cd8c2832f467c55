//! Ranges of an object that are read as one.

use std::ops::Range;

/// Most bytes of a joined range.
const JOINED_MOST_BYTES: u64 = 2 << 20;

/// Ranges read as one, and their numbers.
pub(super) struct Joined {
    pub(super) bytes: Range<u64>,
    pub(super) numbers: Vec<usize>,
}

/// Joins ranges without gaps, in the order of their first bytes.
pub(super) fn join(ranges: &[Range<u64>]) -> Vec<Joined> {
    let mut order: Vec<usize> = (0..ranges.len()).collect();
    order.sort_by_key(|number| (ranges[*number].start, ranges[*number].end));
    let mut joined: Vec<Joined> = Vec::new();
    for number in order {
        let Range { start, end } = ranges[number];
        match joined.last_mut() {
            Some(last)
                if start <= last.bytes.end && end.max(last.bytes.end) - last.bytes.start <= JOINED_MOST_BYTES =>
            {
                last.bytes.end = last.bytes.end.max(end);
                last.numbers.push(number);
            }
            _ => joined.push(Joined { bytes: start..end, numbers: vec![number] }),
        }
    }
    joined
}
