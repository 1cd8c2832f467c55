//! Transfer functions: piecewise linear colour and opacity over data values, their JSON file, their presets, and the
//! table that every renderer looks up after interpolation.

use crate::code::SlotEncoding;
use serde::{Deserialize, Serialize};

/// Colour and opacity as functions of the data value: linear between points, constant outside. Two points at one value make
/// a step.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TransferFunction {
    /// `[value, r, g, b]`, sorted by value; colours in 0..=1, display-referred, not premultiplied.
    pub color: Vec<[f64; 4]>,
    /// `[value, alpha]`, sorted by value; alpha is the opacity collected over `unit_distance`.
    pub opacity: Vec<[f64; 2]>,
    /// World distance over which alpha is collected; positive.
    #[serde(default = "unit")]
    pub unit_distance: f64,
}

fn unit() -> f64 {
    1.0
}

/// Why a transfer function cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum TransferError {
    /// Not the JSON this type expects.
    #[error("not a transfer function: {0}")]
    Json(#[from] serde_json::Error),
    /// A list without points.
    #[error("'{0}' has no points")]
    Empty(&'static str),
    /// A number out of its range, not finite, or out of order.
    #[error("'{list}' point {index}: {problem}")]
    Point {
        /// `color` or `opacity`.
        list: &'static str,
        /// Position in the list, from 0.
        index: usize,
        /// What is wrong, in words.
        problem: String,
    },
    /// `unit_distance` is not a positive number.
    #[error("'unit_distance' is {0}: expected a positive number of world units")]
    UnitDistance(f64),
    /// No preset of this name.
    #[error("unknown transfer function '{name}': not a file, and not one of {known}")]
    UnknownPreset {
        /// What was asked for.
        name: String,
        /// The names there are.
        known: String,
    },
}

impl TransferFunction {
    /// Reads and checks the JSON form.
    ///
    /// # Errors
    /// If the text is not JSON of this shape, or [`TransferFunction::validate`] fails.
    pub fn from_json(text: &str) -> Result<Self, TransferError> {
        let transfer: Self = serde_json::from_str(text)?;
        transfer.validate()?;
        Ok(transfer)
    }

    /// Checks that both lists are sorted, finite, in range and not empty.
    ///
    /// # Errors
    /// Names the first offending point.
    pub fn validate(&self) -> Result<(), TransferError> {
        fn check<const N: usize>(list: &'static str, points: &[[f64; N]]) -> Result<(), TransferError> {
            if points.is_empty() {
                return Err(TransferError::Empty(list));
            }
            for (index, p) in points.iter().enumerate() {
                let problem = if p.iter().any(|v| !v.is_finite()) {
                    "not a finite number".to_string()
                } else if p[1..].iter().any(|v| !(0.0..=1.0).contains(v)) {
                    format!("{:?} is outside 0..1", &p[1..])
                } else if index > 0 && p[0] < points[index - 1][0] {
                    format!("value {} comes after {}: sort the points by value", p[0], points[index - 1][0])
                } else {
                    continue;
                };
                return Err(TransferError::Point { list, index, problem });
            }
            Ok(())
        }
        check("color", &self.color)?;
        check("opacity", &self.opacity)?;
        if !(self.unit_distance.is_finite() && self.unit_distance > 0.0) {
            return Err(TransferError::UnitDistance(self.unit_distance));
        }
        Ok(())
    }

    /// Straight colour at a value.
    pub fn rgb(&self, value: f64) -> [f64; 3] {
        let [_, r, g, b] = interpolate(&self.color, value);
        [r, g, b]
    }

    /// Opacity over `unit_distance` at a value.
    pub fn alpha(&self, value: f64) -> f64 {
        interpolate(&self.opacity, value)[1]
    }

    /// The greatest opacity over the closed interval `[low, high]` (which may be infinite).
    pub fn max_alpha(&self, low: f64, high: f64) -> f64 {
        let inside = self.opacity.iter().filter(|p| low <= p[0] && p[0] <= high).map(|p| p[1]);
        inside.fold(self.alpha(low).max(self.alpha(high)), f64::max)
    }

    /// A named function. Those for CT are absolute (Hounsfield units, millimetres); the others span `window` (data units)
    /// and collect their opacity over `unit_distance` (world units).
    ///
    /// # Errors
    /// [`TransferError::UnknownPreset`] names the presets there are.
    pub fn preset(name: &str, window: (f64, f64), unit_distance: f64) -> Result<Self, TransferError> {
        let (low, high) = if window.1 > window.0 { window } else { (window.0, window.0 + 1.0) };
        let at = |t: f64| low + t * (high - low);
        let ramp = |colors: &[[f64; 3]]| {
            let last = (colors.len() - 1) as f64;
            Self {
                color: colors.iter().enumerate().map(|(i, c)| [at(i as f64 / last), c[0], c[1], c[2]]).collect(),
                opacity: vec![[at(0.0), 0.0], [at(1.0), 0.5]],
                unit_distance,
            }
        };
        Ok(match name {
            "gray" => ramp(&[[0.0; 3], [1.0; 3]]),
            "viridis" => ramp(&[
                [0.267, 0.005, 0.329],
                [0.254, 0.265, 0.530],
                [0.164, 0.471, 0.558],
                [0.135, 0.659, 0.518],
                [0.478, 0.821, 0.319],
                [0.993, 0.906, 0.144],
            ]),
            "fire" => ramp(&[[0.0; 3], [0.55, 0.05, 0.0], [0.95, 0.45, 0.05], [1.0, 0.85, 0.35], [1.0, 1.0, 0.95]]),
            "ct-skin" => Self {
                color: vec![[-500.0, 0.62, 0.36, 0.28], [-100.0, 0.86, 0.62, 0.50], [300.0, 0.98, 0.86, 0.76]],
                opacity: vec![[-500.0, 0.0], [-250.0, 0.35], [0.0, 0.45], [3000.0, 0.6]],
                unit_distance: 2.0,
            },
            "ct-bone" => Self {
                color: vec![[150.0, 0.55, 0.25, 0.15], [400.0, 0.88, 0.72, 0.50], [1200.0, 1.0, 0.97, 0.90]],
                opacity: vec![[180.0, 0.0], [350.0, 0.12], [900.0, 0.7], [1600.0, 0.95]],
                unit_distance: 2.0,
            },
            _ => {
                let known = Self::PRESETS.join(", ");
                return Err(TransferError::UnknownPreset { name: name.to_string(), known });
            }
        })
    }

    /// The names that [`TransferFunction::preset`] knows.
    pub const PRESETS: [&str; 5] = ["gray", "viridis", "fire", "ct-skin", "ct-bone"];
}

/// Piecewise linear in the first component, constant outside.
fn interpolate<const N: usize>(points: &[[f64; N]], value: f64) -> [f64; N] {
    let after = points.partition_point(|p| p[0] <= value);
    let (Some(b), Some(a)) = (points.get(after), after.checked_sub(1).map(|i| &points[i])) else {
        return if after == 0 { points[0] } else { points[points.len() - 1] };
    };
    let t = (value - a[0]) / (b[0] - a[0]);
    std::array::from_fn(|i| a[i] + t * (b[i] - a[i]))
}

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

    fn step() -> TransferFunction {
        TransferFunction {
            color: vec![[0.0, 0.0, 0.0, 0.0], [10.0, 1.0, 0.5, 0.0]],
            opacity: vec![[2.0, 0.0], [4.0, 0.2], [4.0, 0.9]],
            unit_distance: 1.0,
        }
    }

    #[test]
    fn linear_between_points_and_clamped_outside() {
        let tf = step();
        assert_eq!([tf.alpha(1.0), tf.alpha(3.0), tf.alpha(4.0), tf.alpha(99.0)], [0.0, 0.1, 0.9, 0.9]);
        assert_eq!(tf.rgb(5.0), [0.5, 0.25, 0.0]);
        assert_eq!(tf.rgb(f64::NEG_INFINITY), [0.0; 3]);
        assert_eq!([tf.max_alpha(0.0, 2.0), tf.max_alpha(3.0, 5.0), tf.max_alpha(2.0, 3.0)], [0.0, 0.9, 0.1]);
    }

    #[test]
    fn table_is_exact_at_every_code() {
        let tf = step();
        for t in [VoxelType::U8, VoxelType::I8, VoxelType::U16, VoxelType::I16] {
            let encoding = SlotEncoding::new(t, (0.0, 1.0), false);
            let table = TransferTable::new(&tf, &encoding);
            let max = encoding.format.max_code();
            for code in 0..=max {
                let unorm = code as f64 / max as f64;
                let looked_up = table.lookup(unorm as f32)[3] as f64;
                // f32 positions are good to 2^-8 of an entry at 16 bits; the steepest jump here is 0.7 within one.
                assert!((looked_up - tf.alpha(encoding.value(unorm))).abs() < 0.7 / 256.0 * 2.0, "{t} {code}");
            }
        }
    }

    #[test]
    fn bad_files_name_the_place() {
        let bad = |text: &str| TransferFunction::from_json(text).unwrap_err().to_string();
        assert!(bad("{").contains("not a transfer function"));
        assert!(bad(r#"{"color": [], "opacity": [[0,1]]}"#).contains("'color' has no points"));
        assert!(bad(r#"{"color": [[0,1,1,1]], "opacity": [[5,0],[1,1]]}"#).contains("'opacity' point 1"));
        assert!(bad(r#"{"color": [[0,1,1,2]], "opacity": [[5,0]]}"#).contains("outside 0..1"));
        assert!(bad(r#"{"color": [[0,1,1,1]], "opacity": [[5,0]], "unit_distance": 0}"#).contains("unit_distance"));
        assert!(TransferFunction::preset("grey", (0.0, 1.0), 1.0).unwrap_err().to_string().contains("viridis"));
    }

    #[test]
    fn presets_are_valid_whatever_the_window() {
        for name in TransferFunction::PRESETS {
            for window in [(0.0, 255.0), (3.0, 3.0), (-1e30, 1e30)] {
                TransferFunction::preset(name, window, 1.0).unwrap().validate().unwrap();
            }
        }
    }
}
