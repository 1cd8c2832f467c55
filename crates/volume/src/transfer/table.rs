//! The renderers' look-up table for samples.

use super::{Region, Shape, TransferFunction, TransferGrid};
use crate::labels::{Coded, LabelCodes};
use crate::preintegration::Integrals;
use crate::sampling::ADAPTIVE_SHARE;
use crate::slot_encoding::{SlotEncoding, SlotFormat};
use std::iter::successors;
use std::sync::{Arc, OnceLock};

/// A transfer function sampled at equidistant values, `[r, g, b, alpha]` straight; renderers interpolate linearly between neighbouring
/// entries. Every code of the encoding's table has its own entry, with more between two codes where the function bends between them.
#[derive(Clone, Debug)]
pub struct TransferTable {
    /// The entries, from the first of the encoding's table codes to the last. With a grid, alpha is the greatest near the entry's value at
    /// any gradient: clear entries are clear in the grid.
    pub entries: Vec<[f32; 4]>,
    /// Entries from one code to the next.
    pub entries_per_code: usize,
    /// The code of the first entry.
    pub first_code: u16,
    /// World distance for collecting the entries' alpha.
    pub unit_distance: f32,
    /// The table of value and gradient magnitude, for a function of both; `None` for a function of the value alone. It is shared, as tables
    /// are copied for every frame.
    pub grid: Option<Arc<TransferGrid>>,
    /// Made on first use.
    integrals: OnceLock<Integrals>,
    adaptive_step: OnceLock<f64>,
}

impl PartialEq for TransferTable {
    fn eq(&self, other: &Self) -> bool {
        // The cached fields follow from these.
        let place = |table: &Self| (table.first_code, table.entries_per_code, table.unit_distance);
        place(self) == place(other) && self.entries == other.entries && self.grid == other.grid
    }
}

impl TransferTable {
    /// The most entries of a table for slots of a format.
    pub const fn most_entries(format: SlotFormat) -> usize {
        match format {
            // 16 per code of the full range: then it stays in the first-level cache, or nearly.
            SlotFormat::U8 => 255 * 16 + 1,
            SlotFormat::U16 | SlotFormat::F32 => 65536,
        }
    }

    /// Samples the function at every code of the encoding's table, and between codes as densely as needed to match it.
    pub fn new(transfer: &TransferFunction, encoding: &SlotEncoding) -> Self {
        let per_code = entries_per_code(transfer, encoding);
        let last = encoding.span_codes() as usize * per_code;
        // Frames without enough codes for the labels of a look are refused earlier.
        let codes = transfer.labels.as_ref().and_then(LabelCodes::of).unwrap_or_default();
        let entry = |i: usize| {
            let entry = match codes.coded(i as u32) {
                _ if !encoding.is_hashed => transfer.rgba(encoding.value_of_code(i as f64 / per_code as f64)),
                Coded::Label(label) => transfer.rgba(label as f64),
                Coded::Color(color) => transfer.of_other_labels(color),
                Coded::Nothing => [0.0; 4],
            };
            entry.map(|v| v as f32)
        };
        let mut entries: Vec<_> = (0..=last).map(entry).collect();
        let grid = transfer.is_by_gradient().then(|| TransferGrid::new(transfer, encoding));
        if let Some(grid) = &grid {
            entries.iter_mut().zip(grid.most(last + 1, per_code)).for_each(|(entry, most)| entry[3] = most);
        }
        Self {
            grid: grid.map(Arc::new),
            entries_per_code: per_code,
            first_code: encoding.table_codes[0],
            ..Self::from_entries(entries, transfer.unit_distance as f32)
        }
    }

    /// Creates the table of a function of the value alone, with these entries, at least two, one per code from code 0 on.
    pub fn from_entries(entries: Vec<[f32; 4]>, unit_distance: f32) -> Self {
        Self {
            entries,
            entries_per_code: 1,
            first_code: 0,
            unit_distance,
            grid: None,
            integrals: OnceLock::new(),
            adaptive_step: OnceLock::new(),
        }
    }

    /// Index of the last entry.
    pub fn last_entry(&self) -> usize {
        self.entries.len() - 1
    }

    /// The function's running integrals, made on first use, in 2 ms for 65,536 entries.
    pub fn integrals(&self) -> &Integrals {
        self.integrals.get_or_init(|| Integrals::new(&self.entries))
    }

    /// Greatest distance from a value, in codes, of other values with an effect on its look: as far as the next entry.
    pub fn reach_codes(&self) -> f64 {
        let entry = 1.0 / self.entries_per_code as f64;
        self.grid.as_ref().map_or(entry, |grid| entry.max(1.0 / grid.rows_per_code as f64))
    }

    /// Adaptive sampling ([`Method::Asm`](crate::Method::Asm)): the largest difference between the values at a part's ends, as a share of
    /// the table. It is [`ADAPTIVE_SHARE`] of the entries between the first and the last visible change.
    pub fn adaptive_step(&self) -> f64 {
        *self.adaptive_step.get_or_init(|| {
            // Colours of clear entries do not matter.
            let same = |[a, b]: [&[f32; 4]; 2]| a[3] == b[3] && (a[3] == 0.0 || a == b);
            let pairs = || self.entries.windows(2).map(|pair| same([&pair[0], &pair[1]]));
            let (before, behind) =
                (pairs().take_while(|&same| same).count(), pairs().rev().take_while(|&same| same).count());
            let entries = self.last_entry();
            ADAPTIVE_SHARE * entries.saturating_sub(before + behind).max(1) as f64 / entries as f64
        })
    }

    /// Straight colour and opacity at a place of the table, 0 at the first entry and 1 at the last, clamped: interpolated between the two
    /// nearest entries.
    #[inline]
    pub fn lookup(&self, place: f32) -> [f32; 4] {
        let last = self.last_entry();
        let position = place.clamp(0.0, 1.0) * last as f32;
        let i = (position as usize).min(last - 1);
        let t = position - i as f32;
        let (a, b) = (&self.entries[i], &self.entries[i + 1]);
        std::array::from_fn(|k| a[k] + t * (b[k] - a[k]))
    }
}

/// Fewest entries per code, a power of two, for a match at all the function's bends, or else the most possible.
pub(super) fn entries_per_code(transfer: &TransferFunction, encoding: &SlotEncoding) -> usize {
    let most = (TransferTable::most_entries(encoding.format) - 1) / encoding.span_codes() as usize;
    let steps = || successors(Some(1), |step| Some(2 * step)).take_while(|step| *step <= most);
    match encoding.is_labels {
        true => 1,
        false => steps().find(|step| meets(transfer, encoding, *step)).or(steps().last()).unwrap_or(1),
    }
}

/// Whether `per_code` entries per code, with lines between them, match a function: to a quarter of a display code in colour, and to a share
/// of the opacity. A jump is never matched; regions have their edges at entries, or many entries.
fn meets(transfer: &TransferFunction, encoding: &SlotEncoding, per_code: usize) -> bool {
    const SHARE: f64 = 1.0 / 256.0;
    let last = encoding.span_codes() * per_code as f64;
    let value_at = |entry: f64| encoding.value_of_code(entry / per_code as f64);
    // The table's colour and opacity at a value in it, on the line between two entries.
    let on_line = |value: f64| {
        let place = Some(encoding.code(value) * per_code as f64).filter(|place| (0.0..=last).contains(place))?;
        let [a, b] = [place.floor(), place.ceil()].map(|entry| transfer.rgba(value_at(entry)));
        Some::<[f64; 4]>(std::array::from_fn(|k| a[k] + place.fract() * (b[k] - a[k])))
    };
    let is_color = |&[value, r, g, b]: &[f64; 4]| {
        let is_near = |line: [f64; 4]| [r, g, b].iter().zip(line).all(|(c, found)| (found - c).abs() <= 0.25 * SHARE);
        on_line(value).is_none_or(is_near)
    };
    let is_opacity = |&[value, alpha]: &[f64; 2]| {
        on_line(value).is_none_or(|line| (line[3] - alpha).abs() <= SHARE * (alpha + 1.0 / 64.0))
    };
    let is_region = |region: &Region| match region.value.map(|value| encoding.code(value) * per_code as f64) {
        edges if region.shape == Shape::Rectangle => edges.iter().all(|edge| (edge - edge.round()).abs() < 1e-6),
        [low, high] => high - low >= 16.0,
    };
    let has_points = transfer.color.iter().all(is_color) && transfer.opacity.iter().all(is_opacity);
    has_points && transfer.regions.iter().all(is_region)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::float_slots::{KeptSlots, Window};
    use crate::mode::Mode;
    use crate::voxel_type::VoxelType;

    #[test]
    fn adaptive_steps_are_of_what_changes() {
        let step = |entry: &dyn Fn(usize) -> [f32; 4]| {
            let entries = (0..256).map(entry).collect();
            (TransferTable::from_entries(entries, 1.0).adaptive_step() * 255.0 / ADAPTIVE_SHARE).round()
        };
        assert_eq!(step(&|code| [0.0, 0.0, 0.0, code as f32]), 255.0);
        assert_eq!(step(&|code| [0.0, 0.0, 0.0, code.clamp(100, 130) as f32]), 30.0);
        let shown = |code: usize| [code as f32, 0.0, 0.0, (100..130).contains(&code) as u8 as f32];
        assert_eq!(step(&shown), 31.0, "from the last that is clear to the first");
        assert_eq!(step(&|_| [0.5; 4]), 1.0, "what is the same everywhere");
    }

    #[test]
    fn every_code_has_its_own_entry() {
        let transfer = TransferFunction {
            color: vec![[0.0, 0.0, 0.0, 0.0], [10.0, 1.0, 0.5, 0.0]],
            opacity: vec![[2.0, 0.0], [4.0, 0.2], [4.0, 0.9]],
            unit_distance: 1.0,
            ..TransferFunction::default()
        };
        for t in [VoxelType::U8, VoxelType::I8, VoxelType::U16, VoxelType::I16] {
            let encoding = SlotEncoding::new(t, (0.0, 1.0), false);
            let table = TransferTable::new(&transfer, &encoding);
            let max = encoding.format.max_code();
            for code in 0..=max {
                let unorm = code as f64 / max as f64;
                let looked_up = table.lookup(unorm as f32)[3] as f64;
                // f32 positions are good to 2^-8 of an entry at 16 bits; the steepest jump here is 0.7 within one.
                assert!((looked_up - transfer.alpha(encoding.value(unorm))).abs() < 0.7 / 256.0 * 2.0, "{t} {code}");
            }
        }
    }

    /// A shell between two codes, at many places, for each type with its values as codes.
    #[test]
    fn tables_over_few_codes_meet_what_is_between_them() {
        for (voxel_type, first) in
            [(VoxelType::U8, 0.0), (VoxelType::I8, -3.0), (VoxelType::U16, 65533.0), (VoxelType::I16, -7.0)]
        {
            let transfer = TransferFunction {
                color: vec![[first, 0.0, 0.0, 1.0], [first + 0.5, 0.0, 1.0, 0.0], [first + 1.0, 1.0, 0.0, 0.0]],
                opacity: vec![[first + 0.2, 0.0], [first + 0.3, 0.9], [first + 0.4, 0.0]],
                ..TransferFunction::default()
            };
            let window = Window::new(&transfer, &[], Mode::Dvr);
            let encoding = SlotEncoding::new(voxel_type, (first, first + 1.0), false);
            let encoding = encoding.for_window(window, KeptSlots::default());
            let table = TransferTable::new(&transfer, &encoding);
            for i in 0..=1000 {
                let value = first + f64::from(i) / 1000.0;
                let [.., found] = table.lookup(encoding.place(value) as f32);
                // Slopes of 9 a code, and 512 entries or more a code.
                assert!(
                    (f64::from(found) - transfer.alpha(value)).abs() < 9.0 / 512.0,
                    "{voxel_type} {value}: {found}"
                );
            }
            let middle = table.lookup(encoding.place(first + 0.3) as f32);
            assert!((middle[1] - 0.6).abs() < 0.01 && middle[3] > 0.88, "{voxel_type}: {middle:?}");
        }
    }

    #[test]
    fn there_are_more_entries_than_codes_only_where_that_changes_something() {
        let per_code = |opacity: Vec<[f64; 2]>, encoding: &SlotEncoding| {
            let transfer = TransferFunction { opacity, ..TransferFunction::default() };
            TransferTable::new(&transfer, encoding).entries_per_code
        };
        let bytes = SlotEncoding::new(VoxelType::U8, (0.0, 255.0), false);
        assert_eq!(per_code(vec![[0.0, 0.0], [255.0, 1.0]], &bytes), 1);
        assert_eq!(per_code(vec![[10.0, 0.0], [200.0, 1.0]], &bytes), 1, "bends at codes");
        assert_eq!(per_code(vec![[10.25, 0.0], [20.75, 1.0]], &bytes), 4, "bends between codes");
        assert_eq!(per_code(vec![[10.0, 0.0], [10.0, 1.0]], &bytes), 16, "a jump: as many as there may be");
        let wide = SlotEncoding::new(VoxelType::U16, (0.0, 65535.0), false);
        assert_eq!(
            per_code(vec![[10.0, 0.0], [10.0, 1.0]], &wide),
            1,
            "every code has an entry, and there is no room for more"
        );
    }
}
