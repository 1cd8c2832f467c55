//! What one whole step through a medium does, by code, for each zone of the lattice: colour gained and light passed, or of one of several
//! layers what it has of the medium that all are together.
//!
//! Nearly all samples of a zone weigh the same, so their opacity correction is a look-up instead of a power. Between codes
//! there are [`SUBSTEPS`] entries: where the table jumps from one code to the next, opacity is not linear in between, and
//! 16 pieces keep the error of a sample below a tenth of a picture's step. One more entry is that of no sample at all. For 8-bit
//! codes only: 64 KiB a zone, made for
//! every frame in a third of a millisecond; for 16 bits it would be 1 MiB a zone, and slower than the power.

use crate::mixture::OPAQUE;
use crate::packet::{LANES, Packet};
use brickyard_volume::{Blend, Lattice, SlotFormat, TransferTable};
use glam::Vec4;

/// Entries from one code to the next.
const SUBSTEPS: usize = 16;

/// The entry of code 255; one more follows to interpolate towards.
const LAST: usize = 255 * SUBSTEPS;

/// The entry of no sample, twice.
const NOTHING: usize = LAST + 2;

/// Entries of a zone.
const ENTRIES: usize = NOTHING + 2;

/// The most by which light passed may be wrong where it is not linear from one entry to the next: a tenth of a picture's step.
const TOLERANCE: f64 = 4e-4;

/// What tables say of a step.
#[derive(Clone, Copy)]
pub(crate) enum Effect {
    /// Colour gained and light passed.
    Seen,
    /// Colour times depth, and depth; or colour that is added.
    Share(Blend),
}

impl Effect {
    const fn nothing(self) -> Vec4 {
        match self {
            Self::Seen => Vec4::W,
            Self::Share(_) => Vec4::ZERO,
        }
    }

    /// What a straight colour and opacity do in so many unit distances.
    fn of(self, [r, g, b, alpha]: [f32; 4], length: f64) -> Vec4 {
        let color = Vec4::new(r, g, b, 0.0);
        match self {
            Self::Seen => {
                let passed = (1.0 - alpha as f64).powf(length);
                (color * (1.0 - passed) as f32).with_w(passed as f32)
            }
            Self::Share(Blend::Mix) => {
                color.with_w(1.0) * ((-(1.0 - alpha as f64).log2()).min(OPAQUE as f64) * length) as f32
            }
            Self::Share(Blend::Add) => color * (alpha as f64 * length) as f32,
        }
    }

    /// The light that passes.
    fn passed(self, entry: Vec4) -> f64 {
        match self {
            Self::Seen => entry.w as f64,
            Self::Share(_) => (-entry.w as f64).exp2(),
        }
    }
}

/// The tables of a frame.
pub(crate) struct StepTables {
    zones: Vec<Zone>,
}

struct Zone {
    entries: Box<[Vec4]>,
    /// The first and the last place that shows anything; the first is greater if none does.
    visible: [i32; 2],
    /// The first and the last place whose samples must be computed, likewise.
    steep: [i32; 2],
}

/// One zone's.
#[derive(Clone, Copy)]
pub(crate) struct StepTable<'a> {
    entries: &'a [Vec4; ENTRIES],
    visible: [i32; 2],
    steep: [i32; 2],
}

/// Where a packet's samples are in a table: the entries' distances from the first, in bytes, and the fractions towards the next.
#[derive(Clone, Copy)]
pub(crate) struct Places {
    at: [i32; LANES],
    fraction: Packet,
}

impl Places {
    pub(crate) const EMPTY: Self = Self { at: [0; LANES], fraction: [0.0; LANES] };
}

/// Bytes that the tables take at most.
pub(crate) const fn bytes(format: SlotFormat, zones: usize) -> usize {
    match format {
        SlotFormat::U8 => zones * ENTRIES * size_of::<Vec4>(),
        SlotFormat::U16 => 0,
    }
}

impl StepTables {
    /// Those of the lattice's first `zones`; none for codes wider than 8 bits.
    pub(crate) fn new(
        table: &TransferTable,
        lattice: &Lattice,
        format: SlotFormat,
        zones: usize,
        effect: Effect,
    ) -> Self {
        let zones = if format == SlotFormat::U8 { zones } else { 0 };
        let length = |zone: usize| lattice.step * (1u64 << zone) as f64 / table.unit_distance as f64;
        Self { zones: (0..zones).map(|zone| Zone::new(table, effect, length(zone))).collect() }
    }

    /// The table of a zone, if there is one.
    #[inline(always)]
    pub(crate) fn zone(&self, zone: usize) -> Option<StepTable<'_>> {
        let Zone { entries, visible, steep } = self.zones.get(zone)?;
        entries.as_array().map(|entries| StepTable { entries, visible: *visible, steep: *steep })
    }
}

impl Zone {
    /// The table of steps of so many unit distances.
    fn new(table: &TransferTable, effect: Effect, length: f64) -> Self {
        let at = |place: f32| effect.of(table.lookup(place / LAST as f32), length);
        let entry = |i: usize| if i < NOTHING { at(i as f32) } else { effect.nothing() };
        let entries: Box<[Vec4]> = (0..ENTRIES).map(entry).collect();
        let shows = |i: usize| entries[i..i + 2].iter().any(|entry| *entry != effect.nothing());
        let is_steep = |i: usize| {
            let between = effect.passed((entries[i] + entries[i + 1]) * 0.5);
            (between - effect.passed(at(i as f32 + 0.5))).abs() > TOLERANCE
        };
        let range = |is_in: &dyn Fn(usize) -> bool| {
            let mut places = (0..=LAST).filter(|&i| is_in(i));
            let first = places.next();
            let last = places.next_back().or(first);
            [first.unwrap_or(NOTHING), last.unwrap_or(0)].map(|i| (i * size_of::<Vec4>()) as i32)
        };
        let (visible, steep) = (range(&shows), range(&is_steep));
        Self { visible, steep, entries }
    }
}

impl StepTable<'_> {
    /// Finds the places of the first `count` codes of a packet, from 0 to 255; the others become no samples. Returns whether
    /// any shows anything.
    #[inline(always)]
    pub(crate) fn find(&self, codes: &Packet, count: i32, places: &mut Places) -> bool {
        const LANE: [i32; LANES] = [0, 1, 2, 3, 4, 5, 6, 7];
        let mut shows = 0;
        for i in 0..LANES {
            let position = codes[i] * SUBSTEPS as f32;
            // Written so that NaN, too, ends up inside.
            let position = if position > 0.0 { position } else { 0.0 };
            let position = if position < LAST as f32 { position } else { LAST as f32 };
            // SAFETY: 0 <= position <= LAST.
            let index = unsafe { position.to_int_unchecked::<i32>() };
            places.fraction[i] = position - index as f32;
            let at = index * size_of::<Vec4>() as i32;
            places.at[i] = if LANE[i] < count { at } else { (NOTHING * size_of::<Vec4>()) as i32 };
            shows |= ((at >= self.visible[0]) & (at <= self.visible[1])) as i32;
        }
        shows != 0
    }

    /// Whether any of the places is where what a step does is not linear from one entry to the next.
    #[inline(always)]
    pub(crate) fn is_steep(&self, places: &Places) -> bool {
        let mut steep = 0;
        for i in 0..LANES {
            steep |= ((places.at[i] >= self.steep[0]) & (places.at[i] <= self.steep[1])) as i32;
        }
        steep != 0
    }

    /// What a sample's step does.
    ///
    /// # Safety
    /// [`StepTable::find`] has found the places.
    #[inline(always)]
    pub(crate) unsafe fn step(&self, places: &Places, i: usize) -> Vec4 {
        // SAFETY: the place is at most that of NOTHING, and after that there is another entry.
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
        let tables = StepTables::new(&table, &Lattice::uniform(0.7, 0), SlotFormat::U8, 3, Effect::Seen);
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
        assert!(StepTables::new(&table, &Lattice::uniform(0.7, 0), SlotFormat::U16, 3, Effect::Seen).zone(0).is_none());
    }

    #[test]
    fn shares_are_computed_where_they_are_not_linear() {
        let transfer = TransferFunction {
            color: vec![[0.0, 1.0, 0.5, 0.25]],
            opacity: vec![[0.0, 0.0], [200.0, 0.7], [255.0, 1.0]],
            unit_distance: 5.0,
            ..TransferFunction::default()
        };
        let encoding = SlotEncoding::new(VoxelType::U8, (0.0, 255.0), false);
        let table = TransferTable::new(&transfer, &encoding);
        let lattice = Lattice::uniform(1.0, 0);
        let tables = Blend::ALL.map(|blend| StepTables::new(&table, &lattice, SlotFormat::U8, 1, Effect::Share(blend)));
        let [mix, add] = tables.each_ref().map(|tables| tables.zone(0).unwrap());
        let (mut places, mut steep) = (Places::EMPTY, 0);
        for i in 0..=255 * 7 {
            let code = i as f32 / 7.0;
            let alpha = table.lookup(code / 255.0)[3] as f64;
            add.find(&[code; LANES], 8, &mut places);
            // SAFETY: the places have been found.
            let glow = unsafe { add.step(&places, 7) };
            assert!((glow.x as f64 - alpha / 5.0).abs() < 1e-6 && glow.w == 0.0, "{code}: {glow}");
            mix.find(&[code; LANES], 8, &mut places);
            if mix.is_steep(&places) {
                steep += 1;
                continue;
            }
            // SAFETY: the places have been found.
            let share = unsafe { mix.step(&places, 7) };
            let passed = (-share.w as f64).exp2();
            assert!((passed - (1.0 - alpha).powf(0.2)).abs() < 2.0 * TOLERANCE, "{code}: {passed}");
            assert!((share.y - 0.5 * share.w).abs() <= 1e-6 * share.w, "{code}: {share}");
        }
        assert!((1..30).contains(&steep), "{steep} codes are computed");
    }
}
