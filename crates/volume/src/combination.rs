//! An expression over several volumes as one picture: its value in each segment goes through one transfer function.
//!
//! In each segment every volume is read in the middle of its part, as when it is shown by itself; one that has no part there, or no
//! value, has none. Where the expression has a value, the segment has its medium, over the longest of the parts with a value.

use crate::code::{SlotEncoding, SlotFormat};
use crate::expression::Expression;
use crate::transfer::{TransferFunction, TransferTable};
use crate::voxel_type::VoxelType;

/// An expression and how its values look.
#[derive(Clone, Debug)]
pub struct Combination {
    /// Over the volumes of a frame, by their places in it.
    pub expression: Expression,
    /// How its values look.
    pub transfer: TransferFunction,
    /// The same as a table, over the values from its first point to its last.
    pub table: TransferTable,
    /// What the table's entries stand for.
    pub encoding: SlotEncoding,
}

impl Combination {
    /// Of an expression over the volumes that it reads, and a transfer function that has been found valid.
    pub fn new(expression: Expression, transfer: TransferFunction) -> Self {
        let points = || transfer.color.iter().map(|p| p[0]).chain(transfer.opacity.iter().map(|p| p[0]));
        let (low, high) = (points().fold(f64::INFINITY, f64::min), points().fold(f64::NEG_INFINITY, f64::max));
        // Of one point, or of none, all is alike.
        let (low, high) = if low < high { (low, high) } else { (low.min(0.0), low.min(0.0) + 1.0) };
        let encoding =
            SlotEncoding { voxel_type: VoxelType::F32, format: SlotFormat::U16, low, high, has_invalid: false };
        let table = TransferTable::new(&transfer, &encoding);
        Self { expression, transfer, table, encoding }
    }

    /// Straight colour and opacity where volumes have these values; `None` where there is nothing.
    pub fn look(&self, values: &[f64]) -> Option<[f32; 4]> {
        let value = self.expression.value(values);
        let look = || self.table.lookup(self.encoding.unorm(value).clamp(0.0, 1.0) as f32);
        (!value.is_nan()).then(look).filter(|look| look[3] > 0.0)
    }

    /// How each of its volumes is shown to a renderer: as if all of it could be seen, for that decides what is read.
    pub fn of_each(&self) -> TransferFunction {
        let unit_distance = self.transfer.unit_distance;
        TransferFunction {
            color: vec![[0.0, 1.0, 1.0, 1.0]],
            opacity: vec![[0.0, 1.0]],
            unit_distance,
            ..TransferFunction::default()
        }
    }
}
