//! The table that renderers look samples up in.

use super::{TransferFunction, TransferGrid};
use crate::labels::{Coded, LabelCodes};
use crate::preintegration::Integrals;
use crate::sampling::ADAPTIVE_SHARE;
use crate::slot_encoding::SlotEncoding;
use std::sync::{Arc, OnceLock};

/// A transfer function sampled at equidistant codes, `[r, g, b, alpha]` straight; renderers interpolate linearly between
/// neighbouring entries. There are 256 entries for 8-bit codes and 65,536 for 16-bit ones, so every code has its own entry.
#[derive(Clone, Debug)]
pub struct TransferTable {
    /// The entries; entry `i` belongs to code `i`. Where there is a grid, alpha is the greatest that a value next to the code has at
    /// any gradient: what is clear here is clear in the grid.
    pub entries: Vec<[f32; 4]>,
    /// World distance over which the entries' alpha is collected.
    pub unit_distance: f32,
    /// The table of value and gradient magnitude, for a function that depends on both; `None` for a function of the value alone. It
    /// is shared, as copies of a table are made for every frame.
    pub grid: Option<Arc<TransferGrid>>,
    /// Made when they are first asked for.
    integrals: OnceLock<Integrals>,
    adaptive_step: OnceLock<f64>,
}

impl PartialEq for TransferTable {
    fn eq(&self, other: &Self) -> bool {
        // What is made of these follows from them.
        self.unit_distance == other.unit_distance && self.entries == other.entries && self.grid == other.grid
    }
}

impl TransferTable {
    /// Samples the function at every code of the encoding.
    pub fn new(transfer: &TransferFunction, encoding: &SlotEncoding) -> Self {
        let max = encoding.format.max_code();
        // A frame whose codes do not suffice for its look's labels is refused before.
        let codes = transfer.labels.as_ref().and_then(LabelCodes::of).unwrap_or_default();
        let at = |value: f64| {
            let [r, g, b] = transfer.rgb(value);
            [r, g, b, transfer.alpha(value)]
        };
        let entry = |code: u32| {
            let entry = match codes.coded(code) {
                _ if !encoding.is_hashed => at(encoding.value(code as f64 / max as f64)),
                Coded::Label(label) => at(label as f64),
                Coded::Color(color) => transfer.of_other_labels(color),
                Coded::Nothing => [0.0; 4],
            };
            entry.map(|v| v as f32)
        };
        let mut entries: Vec<_> = (0..=max).map(entry).collect();
        let grid = transfer.is_by_gradient().then(|| TransferGrid::new(transfer, encoding));
        if let Some(grid) = &grid {
            entries.iter_mut().zip(grid.most(max + 1)).for_each(|(entry, most)| entry[3] = most);
        }
        Self { grid: grid.map(Arc::new), ..Self::from_entries(entries, transfer.unit_distance as f32) }
    }

    /// A table with these entries, at least two, of a function of the value alone.
    pub fn from_entries(entries: Vec<[f32; 4]>, unit_distance: f32) -> Self {
        Self { entries, unit_distance, grid: None, integrals: OnceLock::new(), adaptive_step: OnceLock::new() }
    }

    /// The function's running integrals. They are made when first asked for, which takes 2 ms for 65,536 entries.
    pub fn integrals(&self) -> &Integrals {
        self.integrals.get_or_init(|| Integrals::new(&self.entries))
    }

    /// How far from a value, in codes, other values may change what is seen there: as far as the next entry.
    pub fn reach_codes(&self) -> f64 {
        self.grid.as_ref().map_or(1.0, |grid| 1.0 / grid.rows_per_code as f64)
    }

    /// Adaptive sampling ([`Method::Asm`](crate::Method::Asm)): the largest difference between the values at a part's ends, as a
    /// share of the range of codes. It is [`ADAPTIVE_SHARE`] of the codes from the first to the last at which what is seen changes.
    pub fn adaptive_step(&self) -> f64 {
        *self.adaptive_step.get_or_init(|| {
            // What colour is clear does not matter.
            let same = |[a, b]: [&[f32; 4]; 2]| a[3] == b[3] && (a[3] == 0.0 || a == b);
            let pairs = || self.entries.windows(2).map(|pair| same([&pair[0], &pair[1]]));
            let (before, behind) =
                (pairs().take_while(|&same| same).count(), pairs().rev().take_while(|&same| same).count());
            let codes = self.entries.len() - 1;
            ADAPTIVE_SHARE * codes.saturating_sub(before + behind).max(1) as f64 / codes as f64
        })
    }

    /// Straight colour and opacity at a normalised code, clamped to 0..=1: interpolated between the two nearest entries.
    #[inline]
    pub fn lookup(&self, unorm: f32) -> [f32; 4] {
        let last = self.entries.len() - 1;
        let position = unorm.clamp(0.0, 1.0) * last as f32;
        let i = (position as usize).min(last - 1);
        let t = position - i as f32;
        let (a, b) = (&self.entries[i], &self.entries[i + 1]);
        std::array::from_fn(|k| a[k] + t * (b[k] - a[k]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
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
}
