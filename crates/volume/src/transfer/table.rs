//! The table that renderers look samples up in.

use super::TransferFunction;
use crate::code::SlotEncoding;

/// The transfer function sampled at equidistant codes, `[r, g, b, alpha]` straight; renderers interpolate linearly between
/// neighbouring entries. 256 entries for 8-bit codes and 65,536 for 16-bit ones, so every code has its own entry.
#[derive(Clone, Debug, PartialEq)]
pub struct TransferTable {
    /// The entries; entry `i` belongs to code `i`.
    pub entries: Vec<[f32; 4]>,
    /// World distance over which the entries' alpha is collected.
    pub unit_distance: f32,
}

impl TransferTable {
    /// Samples the function at every code of the encoding.
    pub fn new(transfer: &TransferFunction, encoding: &SlotEncoding) -> Self {
        let max = encoding.format.max_code();
        let entry = |code: u32| {
            let value = encoding.value(code as f64 / max as f64);
            let [r, g, b] = transfer.rgb(value);
            [r, g, b, transfer.alpha(value)].map(|v| v as f32)
        };
        Self { entries: (0..=max).map(entry).collect(), unit_distance: transfer.unit_distance as f32 }
    }

    /// The entry at a normalised code, interpolated.
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
    fn every_code_has_its_own_entry() {
        let transfer = TransferFunction {
            color: vec![[0.0, 0.0, 0.0, 0.0], [10.0, 1.0, 0.5, 0.0]],
            opacity: vec![[2.0, 0.0], [4.0, 0.2], [4.0, 0.9]],
            unit_distance: 1.0,
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
