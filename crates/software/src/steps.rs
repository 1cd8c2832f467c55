//! The effect of one whole step through a medium: colour gained and light passed, by code, for each zone of the
//! lattice.
//!
//! Nearly all samples of a zone weigh the same, so their opacity correction is a look-up instead of a power. The table
//! has as many entries as fit, a whole number for each of the transfer table's: where that jumps from one code to the
//! next, opacity is not linear in between, and 16 pieces keep the error of a sample below a tenth of a picture's step.
//! One more entry stands for no sample at all. For 8-bit codes only: 64 KiB a zone, computed for every frame in a third
//! of a millisecond; for 16 bits it would be 1 MiB a zone, and slower than the power.

use crate::packet::{LANES, Packet};
use brickyard_volume::{Lattice, SlotFormat, TransferTable};
use glam::Vec4;

/// The last entry of a code; one more follows to interpolate towards.
const LAST: usize = TransferTable::most_entries(SlotFormat::U8) - 1;

/// The entry of no sample, stored twice.
const NOTHING: usize = LAST + 2;

const ENTRIES: usize = NOTHING + 2;

/// A table for each zone of the lattice.
pub(crate) struct StepTables {
    zones: Vec<Zone>,
    /// Entries per code, and the last code's.
    per_code: f32,
    last: f32,
}

struct Zone {
    entries: Box<[Vec4]>,
    /// The first and the last visible place; the first is greater if none is.
    visible: [i32; 2],
}

/// Effect of one whole step through the medium in one zone, by code.
#[derive(Clone, Copy)]
pub(crate) struct StepTable<'a> {
    entries: &'a [Vec4; ENTRIES],
    visible: [i32; 2],
    per_code: f32,
    last: f32,
}

/// The places of a packet's samples in a table: distances of the entries from the first one, in bytes for a
/// [`StepTable`], and the fractions towards the next entries.
#[derive(Clone, Copy)]
pub(crate) struct Places {
    pub(crate) at: [i32; LANES],
    pub(crate) fraction: Packet,
}

impl Places {
    pub(crate) const EMPTY: Self = Self { at: [0; LANES], fraction: [0.0; LANES] };
}

/// The most bytes of the tables of `zones` zones; 0 for codes wider than 8 bits.
pub(crate) const fn bytes(format: SlotFormat, zones: usize) -> usize {
    match format {
        SlotFormat::U8 => zones * ENTRIES * size_of::<Vec4>(),
        SlotFormat::U16 | SlotFormat::F32 => 0,
    }
}

impl StepTables {
    /// Builds the tables of the lattice's first `zones` zones; none for codes wider than 8 bits.
    pub(crate) fn new(table: &TransferTable, lattice: &Lattice, format: SlotFormat, zones: usize) -> Self {
        let pieces = (LAST / table.last_entry()).max(1);
        let last = table.last_entry() * pieces;
        let entry = |zone: usize, i: usize| {
            if i > last + 1 {
                return Vec4::W;
            }
            let [r, g, b, alpha] = table.lookup(i as f32 / last as f32);
            let weight = lattice.step * (1u64 << zone) as f64 / table.unit_distance as f64;
            let passed = (1.0 - alpha as f64).powf(weight);
            (Vec4::new(r, g, b, 0.0) * (1.0 - passed) as f32).with_w(passed as f32)
        };
        let zones = if format == SlotFormat::U8 { zones } else { 0 };
        let zones = (0..zones).map(|zone| Zone::new((0..ENTRIES).map(|i| entry(zone, i)).collect())).collect();
        Self { zones, per_code: (table.entries_per_code * pieces) as f32, last: last as f32 }
    }

    #[inline(always)]
    pub(crate) fn zone(&self, zone: usize) -> Option<StepTable<'_>> {
        let Zone { entries, visible } = self.zones.get(zone)?;
        let (per_code, last) = (self.per_code, self.last);
        entries.as_array().map(|entries| StepTable { entries, visible: *visible, per_code, last })
    }
}

impl Zone {
    fn new(entries: Box<[Vec4]>) -> Self {
        let shows = |pair: &[Vec4]| pair[0] != Vec4::W || pair[1] != Vec4::W;
        let first = entries.windows(2).position(shows).unwrap_or(NOTHING);
        let last = entries.windows(2).rposition(shows).unwrap_or(0);
        Self { entries, visible: [first, last].map(|i| (i * size_of::<Vec4>()) as i32) }
    }
}

impl StepTable<'_> {
    /// Finds the places in the table of the first `count` codes of a packet. The other codes get the place of no
    /// sample. Returns whether any code is visible.
    #[inline(always)]
    pub(crate) fn find(&self, codes: &Packet, count: i32, places: &mut Places) -> bool {
        const LANE: [i32; LANES] = [0, 1, 2, 3, 4, 5, 6, 7];
        let mut shows = 0;
        for i in 0..LANES {
            let position = codes[i] * self.per_code;
            // Written so that NaN ends up inside, too.
            let position = if position > 0.0 { position } else { 0.0 };
            let position = if position < self.last { position } else { self.last };
            // SAFETY: 0 <= position <= last <= LAST.
            let index = unsafe { position.to_int_unchecked::<i32>() };
            places.fraction[i] = position - index as f32;
            let at = index * size_of::<Vec4>() as i32;
            places.at[i] = if LANE[i] < count { at } else { (NOTHING * size_of::<Vec4>()) as i32 };
            shows |= ((at >= self.visible[0]) & (at <= self.visible[1])) as i32;
        }
        shows != 0
    }

    /// The effect of the step of the packet's sample `i`: colour gained and light passed.
    ///
    /// # Safety
    /// [`StepTable::find`] has found the places.
    #[inline(always)]
    pub(crate) unsafe fn step(&self, places: &Places, i: usize) -> Vec4 {
        // SAFETY: the place is at most that of NOTHING, followed by another entry.
        let (a, b) = unsafe {
            let at = self.entries.as_ptr().byte_add(places.at[i] as usize);
            (*at, *at.add(1))
        };
        a + (b - a) * places.fraction[i]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use brickyard_volume::{SlotEncoding, TransferFunction, VoxelType};

    #[test]
    fn entries_are_what_a_step_does() {
        let transfer = TransferFunction {
            color: vec![[0.0, 1.0, 0.5, 0.0], [255.0, 0.0, 1.0, 0.25]],
            opacity: vec![[50.0, 0.0], [100.0, 0.02], [101.0, 0.3], [255.0, 0.9]],
            unit_distance: 1.5,
            ..TransferFunction::default()
        };
        let encoding = SlotEncoding::new(VoxelType::U8, (0.0, 255.0), false);
        let table = TransferTable::new(&transfer, &encoding);
        let tables = StepTables::new(&table, &Lattice::uniform(0.7, 0), SlotFormat::U8, 3);
        for zone in 0..3 {
            for i in 0..=255 * 7 {
                let code = i as f32 / 7.0;
                let (zone_table, mut places) = (tables.zone(zone).unwrap(), Places::EMPTY);
                assert_eq!(zone_table.find(&[code; LANES], 4, &mut places), code >= 50.0);
                // SAFETY: the places have been found.
                let [found, none] = unsafe { [zone_table.step(&places, 3), zone_table.step(&places, 4)] };
                assert_eq!(none, Vec4::W);
                let [r, g, b, alpha] = table.lookup(code / 255.0).map(f64::from);
                let passed = (1.0 - alpha).powf(0.7 * (1 << zone) as f64 / 1.5);
                let expected = [r * (1.0 - passed), g * (1.0 - passed), b * (1.0 - passed), passed];
                for k in 0..4 {
                    // A tenth of a picture's step.
                    assert!(
                        (found[k] as f64 - expected[k]).abs() < 4e-4,
                        "zone {zone} code {code}: {found} {expected:?}"
                    );
                }
            }
        }
        assert!(tables.zone(3).is_none());
        assert!(StepTables::new(&table, &Lattice::uniform(0.7, 0), SlotFormat::U16, 3).zone(0).is_none());
    }
}
