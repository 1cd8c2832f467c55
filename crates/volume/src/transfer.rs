//! Transfer functions: piecewise linear colour and opacity over data values, and the table that every renderer looks up after
//! interpolation.
//!
//! They come from a name ([`presets`](TransferFunction::preset)) or from a file ([`mod@file`]): the JSON of [`TransferFunction`]
//! itself, ParaView's colour maps, 3D Slicer's volume properties. What others draw as curves becomes points here, so that
//! nothing behind this module knows of any other form.

mod color_space;
mod curve;
pub mod file;
mod maps;
mod paraview;
mod presets;
mod slicer;
mod table;

pub use color_space::lab;
pub use file::{Imported, Subject};
pub use table::TransferTable;

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
    /// A word that some programs write in place of a number; JSON has none for it.
    #[error("line {line}, column {column}: found {word}, expected a finite number")]
    NotFinite {
        /// Line, from 1.
        line: usize,
        /// Column of the word's first letter, from 1.
        column: usize,
        /// As the file has it.
        word: String,
    },
    /// None of the forms there are.
    #[error(
        "not a transfer function: expected JSON (brickyard's own, ParaView's colour maps, or 3D Slicer's .vp.json), or the \
         text of a 3D Slicer volume property (.vp)"
    )]
    UnknownForm,
    /// Another program's file, but not as that program writes it.
    #[error("not {form}: {problem}")]
    Foreign {
        /// Whose it seems to be, in words.
        form: &'static str,
        /// The place, what was expected, and what was found.
        problem: String,
    },
    /// A list without points.
    #[error("'{0}' has no points")]
    Empty(&'static str),
    /// A number out of its range, not finite, or out of order.
    #[error("'{list}' point {index}: {problem}")]
    Point {
        /// The list's name in the file.
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
    #[error("unknown transfer function '{name}'{hint}: not a file, and not one of {known}")]
    UnknownPreset {
        /// What was asked for.
        name: String,
        /// `, did you mean '...'?`, or nothing.
        hint: String,
        /// The names there are.
        known: String,
    },
    /// The file has no function of this name.
    #[error("no transfer function '{name}'{hint}: {known}")]
    UnknownName {
        /// What was asked for.
        name: String,
        /// `, did you mean '...'?`, or nothing.
        hint: String,
        /// What there is instead, in words.
        known: String,
    },
}

impl TransferFunction {
    /// Checks that both lists are sorted, finite, in range and not empty.
    ///
    /// # Errors
    /// Names the first offending point.
    pub fn validate(&self) -> Result<(), TransferError> {
        check_points("color", &self.color)?;
        check_order("color", &self.color)?;
        check_points("opacity", &self.opacity)?;
        check_order("opacity", &self.opacity)?;
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
}

/// Points `[value, ...]`: some, all finite, all but the value in 0..=1.
fn check_points<const N: usize>(list: &'static str, points: &[[f64; N]]) -> Result<(), TransferError> {
    if points.is_empty() {
        return Err(TransferError::Empty(list));
    }
    for (index, p) in points.iter().enumerate() {
        let problem = if p.iter().any(|v| !v.is_finite()) {
            "not a finite number".to_string()
        } else if p[1..].iter().any(|v| !(0.0..=1.0).contains(v)) {
            format!("{:?} is outside 0..1", &p[1..])
        } else {
            continue;
        };
        return Err(TransferError::Point { list, index, problem });
    }
    Ok(())
}

/// Points sorted by value.
fn check_order<const N: usize>(list: &'static str, points: &[[f64; N]]) -> Result<(), TransferError> {
    let Some(after) = points.windows(2).position(|pair| pair[1][0] < pair[0][0]) else { return Ok(()) };
    let (earlier, value) = (points[after][0], points[after + 1][0]);
    let problem = format!("value {value} comes after {earlier}: sort the points by value");
    Err(TransferError::Point { list, index: after + 1, problem })
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

/// `, did you mean '...'?` for the known name that is least edits away, if it is few.
fn hint<'a>(name: &str, known: impl Iterator<Item = &'a str>) -> String {
    let lower = name.to_lowercase();
    let nearest = known.map(|k| (edits(&lower, &k.to_lowercase()), k)).min();
    match nearest.filter(|(edits, k)| 2 * edits <= k.chars().count()) {
        Some((_, nearest)) => format!(", did you mean '{nearest}'?"),
        None => String::new(),
    }
}

/// Letters to insert, remove or replace to make one word of the other (Levenshtein's distance).
fn edits(from: &str, to: &str) -> usize {
    let to: Vec<char> = to.chars().collect();
    let mut row: Vec<usize> = (0..=to.len()).collect();
    for (i, a) in from.chars().enumerate() {
        let mut diagonal = row[0];
        row[0] = i + 1;
        for (j, b) in to.iter().enumerate() {
            let replaced = diagonal + usize::from(a != *b);
            diagonal = row[j + 1];
            row[j + 1] = replaced.min(row[j] + 1).min(diagonal + 1);
        }
    }
    row[to.len()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn linear_between_points_and_clamped_outside() {
        let tf = TransferFunction {
            color: vec![[0.0, 0.0, 0.0, 0.0], [10.0, 1.0, 0.5, 0.0]],
            opacity: vec![[2.0, 0.0], [4.0, 0.2], [4.0, 0.9]],
            unit_distance: 1.0,
        };
        assert_eq!([tf.alpha(1.0), tf.alpha(3.0), tf.alpha(4.0), tf.alpha(99.0)], [0.0, 0.1, 0.9, 0.9]);
        assert_eq!(tf.rgb(5.0), [0.5, 0.25, 0.0]);
        assert_eq!(tf.rgb(f64::NEG_INFINITY), [0.0; 3]);
        assert_eq!([tf.max_alpha(0.0, 2.0), tf.max_alpha(3.0, 5.0), tf.max_alpha(2.0, 3.0)], [0.0, 0.9, 0.1]);
    }

    #[test]
    fn the_nearest_name_is_suggested() {
        assert_eq!([edits("gray", "grey"), edits("", "abc"), edits("kitten", "sitting")], [1, 3, 3]);
        let known = || ["gray", "ct-bone"].into_iter();
        assert_eq!(hint("CT_Bone", known()), ", did you mean 'ct-bone'?");
        assert_eq!(hint("bone", known()), ", did you mean 'ct-bone'?");
        assert_eq!(hint("sepia", known()), "");
    }
}
