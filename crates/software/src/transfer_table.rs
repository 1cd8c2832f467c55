//! The transfer table, for quick look-up.

use crate::frame::Frame;
use glam::Vec4;

/// A frame's transfer table, for quick look-up.
pub(crate) struct Entries<'a> {
    entries: &'a [[f32; 4]],
    /// The greatest position: short of the last entry, so that there is one to its right.
    limit: f32,
}

impl<'a> Entries<'a> {
    #[inline(always)]
    pub(crate) fn of(frame: &Frame<'a>) -> Self {
        let entries = &frame.settings.table.entries[..];
        assert!(entries.len() >= 2 && entries.len() <= 1 << 24);
        Self { entries, limit: ((entries.len() - 1) as i32 as f32).next_down() }
    }

    /// The interpolated entry at a position in entries: the twin of [`brickyard_volume::TransferTable::lookup`].
    #[inline(always)]
    pub(crate) fn lookup(&self, position: f32) -> Vec4 {
        // Written so that NaN ends up inside, too.
        let position = if position > 0.0 { position } else { 0.0 };
        let position = if position < self.limit { position } else { self.limit };
        // SAFETY: 0 <= position <= limit < 2^24.
        let index = unsafe { position.to_int_unchecked::<i32>() };
        // SAFETY: limit is less than the last index, so its whole part is at most the last but one.
        let [a, b] =
            unsafe { [self.entries.get_unchecked(index as usize), self.entries.get_unchecked(index as usize + 1)] };
        let (a, b) = (Vec4::from_array(*a), Vec4::from_array(*b));
        a + (b - a) * (position - index as f32)
    }
}
