//! What one whole step through a medium does: colour gained and light passed, by code, for each zone of the lattice.
//!
//! Nearly all samples of a zone weigh the same, so their opacity correction is a look-up instead of a power. Between codes
//! there are [`SUBSTEPS`] entries: where the table jumps from one code to the next, opacity is not linear in between, and
//! 16 pieces keep the error of a sample below a tenth of a picture's step. For 8-bit codes only: 64 KiB a zone, made for
//! every frame in a third of a millisecond; for 16 bits it would be 1 MiB a zone, and slower than the power.

use crate::sample::{LANES, Packet};
use brickyard_volume::{Lattice, SlotFormat, TransferTable};
use glam::Vec4;

/// Entries from one code to the next.
const SUBSTEPS: usize = 16;

/// Entries of a zone: from code 0 to code 255, and one more to interpolate towards.
const ENTRIES: usize = 255 * SUBSTEPS + 2;

/// The tables of a frame.
pub(crate) struct StepTables {
    zones: Vec<Box<[Vec4]>>,
}

/// One zone's.
#[derive(Clone, Copy)]
pub(crate) struct StepTable<'a>(&'a [Vec4; ENTRIES]);

/// Bytes that the tables take at most.
pub(crate) const fn bytes(format: SlotFormat, zones: usize) -> usize {
    match format {
        SlotFormat::U8 => zones * ENTRIES * size_of::<Vec4>(),
        SlotFormat::U16 => 0,
    }
}

impl StepTables {
    /// Those of the lattice's first `zones`; none for codes wider than 8 bits.
    pub(crate) fn new(table: &TransferTable, lattice: &Lattice, format: SlotFormat, zones: usize) -> Self {
        let entry = |zone: usize, i: usize| {
            let [r, g, b, alpha] = table.lookup(i as f32 / (255 * SUBSTEPS) as f32);
            let weight = lattice.step * (1u64 << zone) as f64 / table.unit_distance as f64;
            let passed = (1.0 - alpha as f64).powf(weight);
            (Vec4::new(r, g, b, 0.0) * (1.0 - passed) as f32).with_w(passed as f32)
        };
        let zones = if format == SlotFormat::U8 { zones } else { 0 };
        Self { zones: (0..zones).map(|zone| (0..ENTRIES).map(|i| entry(zone, i)).collect()).collect() }
    }

    /// The table of a zone, if there is one.
    #[inline(always)]
    pub(crate) fn zone(&self, zone: usize) -> Option<StepTable<'_>> {
        self.zones.get(zone)?.as_array().map(StepTable)
    }
}

impl StepTable<'_> {
    /// Colour gained and light passed at codes from 0 to 255.
    #[inline(always)]
    pub(crate) fn lookup(&self, codes: &Packet) -> [Vec4; LANES] {
        const LAST: f32 = (255 * SUBSTEPS) as f32;
        let (mut offset, mut fraction) = ([0i32; LANES], [0.0f32; LANES]);
        for i in 0..LANES {
            let position = codes[i] * SUBSTEPS as f32;
            // Written so that NaN, too, ends up inside.
            let position = if position > 0.0 { position } else { 0.0 };
            let position = if position < LAST { position } else { LAST };
            // SAFETY: 0 <= position <= LAST.
            let index = unsafe { position.to_int_unchecked::<i32>() };
            fraction[i] = position - index as f32;
            offset[i] = index * size_of::<Vec4>() as i32;
        }
        let mut steps = [Vec4::ZERO; LANES];
        for i in 0..LANES {
            // SAFETY: the index is at most LAST, and there are two entries more than that.
            let (a, b) = unsafe {
                let at = self.0.as_ptr().byte_add(offset[i] as usize);
                (*at, *at.add(1))
            };
            steps[i] = a + (b - a) * fraction[i];
        }
        steps
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
            opacity: vec![[0.0, 0.0], [100.0, 0.02], [101.0, 0.3], [255.0, 0.9]],
            unit_distance: 1.5,
        };
        let encoding = SlotEncoding::new(VoxelType::U8, (0.0, 255.0), false);
        let table = TransferTable::new(&transfer, &encoding);
        let tables = StepTables::new(&table, &Lattice::uniform(0.7, 0), SlotFormat::U8, 3);
        for zone in 0..3 {
            for i in 0..=255 * 7 {
                let code = i as f32 / 7.0;
                let found = tables.zone(zone).unwrap().lookup(&[code; LANES])[3];
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
