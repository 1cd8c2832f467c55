//! An expression over several volumes as one picture: its value in each segment goes through one transfer function.
//!
//! Every volume is read in the middle of its own part of each segment, as when shown alone. A volume without a part or a value there has no
//! value for the expression. Where the expression has a value, the segment has this value's medium, over the longest of the parts with a
//! value. In a lit scene the medium is lit in the middle of the segment, by the expression's gradient: by the chain rule from the volumes'
//! own gradients in the scene's world, each taken where its volume is read. A volume with a flat field there counts as constant.

use crate::expression::{Expression, Range};
use crate::slot_encoding::SlotEncoding;
use crate::transfer::{TransferFunction, TransferTable};
use crate::voxel_type::VoxelType;
use glam::{DVec3, Vec3};

/// An expression over the volumes of a frame, and the look of its values.
#[derive(Clone, Debug)]
pub struct Combination {
    /// The expression. It names volumes by their places in the frame.
    pub expression: Expression,
    /// The transfer function of the expression's values.
    pub transfer: TransferFunction,
    /// The transfer function as a table, over the values from its first point to its last.
    pub table: TransferTable,
    /// Mapping between the table's codes and the expression's values.
    pub encoding: SlotEncoding,
}

impl Combination {
    /// Combines an expression over its volumes with a validated transfer function.
    pub fn new(expression: Expression, transfer: TransferFunction) -> Self {
        let (low, high) = transfer.span();
        // With one point or none, all values look alike.
        let (low, high) = if low < high { (low, high) } else { (low.min(0.0), low.min(0.0) + 1.0) };
        let encoding = SlotEncoding::new(VoxelType::F32, (low, high), false);
        let table = TransferTable::new(&transfer, &encoding);
        Self { expression, transfer, table, encoding }
    }

    /// Returns straight colour and opacity, `[r, g, b, alpha]`, for these values of the volumes (NaN is no value). `None` where nothing is
    /// shown.
    pub fn look(&self, values: &[f64]) -> Option<[f32; 4]> {
        self.look_of(self.expression.value(values))
    }

    /// Returns lit colour and opacity, `[r, g, b, alpha]`, for these values and gradients of the volumes. `None` where nothing is shown.
    /// `shade` lights a straight colour, with the unit vector along the expression's gradient or `None` without one.
    pub fn look_lit(
        &self,
        values: &[f64],
        gradients: &[DVec3],
        shade: impl FnOnce(DVec3, Option<DVec3>) -> DVec3,
    ) -> Option<[f32; 4]> {
        let (value, gradient) = self.expression.value_and_gradient(values, gradients);
        let [r, g, b, alpha] = self.look_of(value)?;
        let lit = shade(Vec3::new(r, g, b).as_dvec3(), gradient.map(DVec3::normalize)).as_vec3();
        Some([lit.x, lit.y, lit.z, alpha])
    }

    fn look_of(&self, value: f64) -> Option<[f32; 4]> {
        let look = || self.table.lookup(self.encoding.unorm(value).clamp(0.0, 1.0) as f32);
        (!value.is_nan()).then(look).filter(|look| look[3] > 0.0)
    }

    /// Returns one volume's transfer function for pagers and renderers: opaque where the expression may show something, clear elsewhere, so
    /// bricks of clear values are neither read nor sampled. Each volume has values in its window of `windows`, or none. A clear value is as
    /// good as none: with either, the expression shows nothing there.
    pub fn of_volume(&self, volume: usize, windows: &[[f64; 2]]) -> TransferFunction {
        let [low, high] = windows[volume];
        let width = (high - low) / PARTS as f64;
        let has_parts = width > 0.0 && width.is_finite();
        let parts: Vec<bool> = match has_parts {
            true => (0..PARTS).map(|part| self.may_show(volume, part as f64, windows)).collect(),
            false => vec![true; PARTS],
        };
        let is_shown = |edge: usize| edge > 0 && parts[edge - 1] || edge < PARTS && parts[edge];
        let point = |edge: usize| [low + width * edge as f64, is_shown(edge) as u8 as f64];
        let opacity = if has_parts { (0..=PARTS).map(point).collect() } else { vec![[0.0, 1.0]] };
        TransferFunction::new(vec![[0.0, 1.0, 1.0, 1.0]], opacity, self.transfer.unit_distance)
    }

    /// Whether the expression may show anything with a volume's values in one part of its window, widened by one part to each side: by more
    /// than rounding moves a value.
    fn may_show(&self, volume: usize, part: f64, windows: &[[f64; 2]]) -> bool {
        let [low, high] = windows[volume];
        let width = (high - low) / PARTS as f64;
        let mut ranges: Vec<Range> = windows.iter().map(|window| Some(*window)).collect();
        ranges[volume] = Some([low + (part - 1.0) * width, low + (part + 2.0) * width]);
        let is_clear = |[low, high]: [f64; 2]| low <= high && self.transfer.max_alpha(low, high) <= 0.0;
        !self.expression.range(&ranges).is_none_or(is_clear)
    }
}

/// Number of parts of a volume's window, each of which is shown or clear as a whole.
const PARTS: usize = 256;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_clear_shows_nothing_with_its_values_or_without() {
        let transfer = TransferFunction {
            color: vec![[0.0, 1.0, 1.0, 1.0]],
            opacity: vec![[0.2, 0.0], [0.3, 0.5], [0.6, 0.5], [0.7, 0.0]],
            ..TransferFunction::default()
        };
        let windows = [[0.0, 1.0], [-0.5, 2.0], [0.0, 0.1]];
        let values = |i: usize| {
            let [low, high] = windows[i];
            (0..=40).map(move |k| low + (high - low) * k as f64 / 40.0).chain([f64::NAN])
        };
        for (text, shown) in [
            ("a", 0.2..0.8),
            ("a + c", 0.2..0.9),
            ("a > 0.5 ? a + c : -1", 0.1..0.4),
            ("default(a, 0) * b", 0.5..1.1),
            ("valid(a) ? 9 : c", 0.9..1.1),
            ("a * 0 - 1", -0.1..0.1),
        ] {
            let combination = Combination::new(Expression::parse(text, 3).expect("an expression"), transfer.clone());
            let of_a = combination.of_volume(0, &windows);
            let count = values(0).filter(|a| !a.is_nan() && of_a.alpha(*a) > 0.0).count();
            assert!(shown.contains(&(count as f64 / 41.0)), "{text}: {count} of 41");
            for a in values(0).filter(|a| !a.is_nan() && of_a.alpha(*a) == 0.0) {
                for b in values(1) {
                    for (a, c) in [a, f64::NAN].into_iter().flat_map(|a| values(2).map(move |c| (a, c))) {
                        assert_eq!(combination.look(&[a, b, c]), None, "{text} of {a}, {b} and {c}");
                    }
                }
            }
        }
    }
}
