//! Transfer functions: piecewise linear colour and opacity over data values, and the table used by every renderer after interpolation.
//! Opacity may also depend on the field's gradient magnitude: by a factor, and by [regions](Region) of the plane of both.
//!
//! They come from a name ([`presets`](TransferFunction::preset)) or from a file ([`mod@file`]): the JSON of [`TransferFunction`]
//! itself, ParaView's colour maps, 3D Slicer's volume properties. Curves of other programs become points here, so no other form is used
//! outside this module.

mod automatic;
mod choice;
mod color_space;
mod curve;
pub mod file;
mod grid;
mod imported;
mod maps;
mod paraview;
mod presets;
mod region;
mod slicer;
mod table;
mod window;

pub use choice::{TransferChoice, TransferFile, TransferPreset};
pub use color_space::lab;
pub use grid::TransferGrid;
pub use imported::{Imported, Subject, shown_window};
pub use region::{Region, Shape};
pub use table::TransferTable;

use crate::ensure::ensure;
use crate::labels::{self, LabelLook};
use crate::preintegration::depth;
use serde::de::Error;
use serde::{Deserialize, Deserializer, Serialize};
use std::ops::RangeInclusive;
use std::path::PathBuf;

/// Permitted gammas of a layer's style: beyond them a picture has two colours.
pub const GAMMAS: RangeInclusive<f64> = 0.05..=20.0;

/// Colour and opacity as functions of the data value: linear between points, constant outside. Two points at one value make a step.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TransferFunction {
    /// `[value, r, g, b]`, sorted by value; colours in 0..=1, display-referred, not premultiplied.
    pub color: Vec<[f64; 4]>,
    /// `[value, alpha]`, sorted by value; alpha is the opacity collected over `unit_distance`.
    pub opacity: Vec<[f64; 2]>,
    /// World distance for collecting alpha; positive.
    #[serde(default = "unit")]
    pub unit_distance: f64,
    /// `[magnitude, factor]`, sorted by magnitude: the factor of [`opacity`](Self::opacity) at this magnitude of the field's gradient,
    /// in data units per world unit. Factors are in 0..=1. An empty list, left out of files, is a factor of 1 everywhere.
    #[serde(default, skip_serializing_if = "Vec::is_empty", deserialize_with = "some_points")]
    pub gradient_opacity: Vec<[f64; 2]>,
    /// Further media, each in a region of the plane of values and gradient magnitudes.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub regions: Vec<Region>,
    /// The look of labels; `None` for measurements. Shown labels have the opacity of their values.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub labels: Option<LabelLook>,
}

impl Default for TransferFunction {
    /// White and clear everywhere.
    fn default() -> Self {
        Self::new(vec![[0.0, 1.0, 1.0, 1.0]], vec![[0.0, 0.0]], unit())
    }
}

fn unit() -> f64 {
    1.0
}

/// Rejects a list without points.
fn some_points<'de, D: Deserializer<'de>>(list: D) -> Result<Vec<[f64; 2]>, D::Error> {
    let points = Vec::deserialize(list)?;
    if points.is_empty() { Err(D::Error::custom("'gradient_opacity' has no points")) } else { Ok(points) }
}

/// Why a transfer function cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum TransferError {
    /// The text is not JSON, or not a [`TransferFunction`]'s.
    #[error("not a transfer function: {0}")]
    Json(#[from] serde_json::Error),
    /// The file has a word, such as `NaN`, in place of a number, against JSON's rules.
    #[error("line {line}, column {column}: found {word}, expected a finite number")]
    NotFinite {
        /// Line of the word, from 1.
        line: usize,
        /// Column of the word's first letter, from 1.
        column: usize,
        /// The word in the file.
        word: String,
    },
    /// The file has none of the known forms.
    #[error(
        "not a transfer function: expected JSON (brickyard's own, ParaView's colour maps, or 3D Slicer's .vp.json), or the \
         text of a 3D Slicer volume property (.vp)"
    )]
    UnknownForm,
    /// The file seems to be another program's, but violates its format.
    #[error("not {form}: {problem}")]
    Foreign {
        /// The apparent kind of the file, in words.
        form: &'static str,
        /// The place, and the expected and found contents.
        problem: String,
    },
    /// A list, named here, has no points.
    #[error("'{0}' has no points")]
    Empty(&'static str),
    /// A list's point has a number out of range, not finite, or out of order.
    #[error("'{list}' point {index}: {problem}")]
    Point {
        /// The list's name in the file.
        list: &'static str,
        /// Index of the point in the list, from 0.
        index: usize,
        /// The problem of the point, in words.
        problem: String,
    },
    /// The transfer function's file, at this path, has not been read.
    #[error("the transfer function {} has not been read: set TransferFile::function to the file's function", .0.display())]
    NotRead(PathBuf),
    /// `unit_distance` is not a positive number.
    #[error("'unit_distance' is {0}: expected a positive number of world units")]
    UnitDistance(f64),
    /// There is no preset of this name.
    #[error("unknown transfer function '{name}'{hint}: not a file, and not one of {known}")]
    UnknownPreset {
        /// The requested name.
        name: String,
        /// A hint to follow the name, `, did you mean '...'?`, or nothing.
        hint: String,
        /// The names of all presets.
        known: String,
    },
    /// The file has no function of this name.
    #[error("no transfer function '{name}'{hint}: {known}")]
    UnknownName {
        /// The requested name.
        name: String,
        /// A hint to follow the name, `, did you mean '...'?`, or nothing.
        hint: String,
        /// The file's actual contents, in words.
        known: String,
    },
}

impl TransferFunction {
    /// Creates a function of the value alone from the points of its lists, without labels.
    pub fn new(color: Vec<[f64; 4]>, opacity: Vec<[f64; 2]>, unit_distance: f64) -> Self {
        Self { color, opacity, unit_distance, gradient_opacity: Vec::new(), regions: Vec::new(), labels: None }
    }

    /// Checks that lists are sorted, finite and in range, those of colour and opacity not empty, and `unit_distance` positive.
    ///
    /// # Errors
    /// The first invalid point.
    pub fn validate(&self) -> Result<(), TransferError> {
        check_list("color", &self.color)?;
        check_list("opacity", &self.opacity)?;
        self.check_gradients()?;
        if let Some((index, problem)) = self.labels.as_ref().and_then(LabelLook::bad_color) {
            return Err(TransferError::Point { list: "labels.colors", index, problem });
        }
        let distance = self.unit_distance;
        ensure(distance.is_finite() && distance > 0.0, || TransferError::UnitDistance(distance))
    }

    fn check_gradients(&self) -> Result<(), TransferError> {
        const LIST: &str = "gradient_opacity";
        if !self.gradient_opacity.is_empty() {
            check_list(LIST, &self.gradient_opacity)?;
        }
        if let Some(index) = self.gradient_opacity.iter().position(|point| point[0] < 0.0) {
            let problem = format!("magnitude {} is negative", self.gradient_opacity[index][0]);
            return Err(TransferError::Point { list: LIST, index, problem });
        }
        self.regions.iter().enumerate().try_for_each(|(index, region)| region.check(index))
    }

    /// Whether colour or opacity depends on the gradient magnitude.
    pub fn is_by_gradient(&self) -> bool {
        !(self.gradient_opacity.is_empty() && self.regions.is_empty())
    }

    /// Straight colour `[r, g, b]` at a value, without regions.
    pub fn rgb(&self, value: f64) -> [f64; 3] {
        if let Some(color) = self.labels.as_ref().and_then(|labels| labels.color(value.round() as i64)) {
            return color;
        }
        let [_, r, g, b] = interpolate(&self.color, value);
        [r, g, b]
    }

    /// Straight colour, and opacity over `unit_distance`, of unnamed labels by their [hashed colour](crate::labels::color_index):
    /// `[r, g, b, alpha]`.
    pub(crate) fn of_other_labels(&self, color: u32) -> [f64; 4] {
        let (has_hashed, is_shown) =
            self.labels.as_ref().map_or((false, true), |look| (look.colors.is_some(), look.shown.is_none()));
        let [_, r, g, b] = self.color[0];
        let [r, g, b] = if has_hashed { labels::hashed_color(color) } else { [r, g, b] };
        [r, g, b, if is_shown { self.opacity[0][1] } else { 0.0 }]
    }

    /// Whether colour and opacity are the same at all values, apart from labels' own colours.
    pub fn is_even(&self) -> bool {
        self.color.len() == 1 && self.opacity.len() == 1
    }

    /// The factor of opacity at a gradient magnitude, in data units per world unit.
    pub fn factor(&self, gradient: f64) -> f64 {
        if self.gradient_opacity.is_empty() { 1.0 } else { interpolate(&self.gradient_opacity, gradient)[1] }
    }

    /// Straight colour, and opacity over `unit_distance`, at a value and a gradient magnitude: `[r, g, b, alpha]`. The media of the
    /// value and of all regions are in the same place: their extinctions add, and their colours mix by extinction.
    pub fn at(&self, value: f64, gradient: f64) -> [f64; 4] {
        let [r, g, b, alpha] = self.rgba(value);
        let alpha = alpha * self.factor(gradient);
        mix([r, g, b, alpha], self.regions.iter().map(|region| (region.color, region.alpha(value, gradient))))
    }

    /// Opacity over `unit_distance` at a value, without gradient factor and regions.
    pub fn alpha(&self, value: f64) -> f64 {
        if self.labels.as_ref().is_some_and(|labels| !labels.shows(value.round() as i64)) {
            return 0.0;
        }
        interpolate(&self.opacity, value)[1]
    }

    /// Straight colour, and opacity over `unit_distance`, at a value, without gradient factor and regions: `[r, g, b, alpha]`.
    pub fn rgba(&self, value: f64) -> [f64; 4] {
        let [r, g, b] = self.rgb(value);
        [r, g, b, self.alpha(value)]
    }

    /// The greatest opacity over the closed interval `[low, high]` (which may be infinite), whatever the gradient. Regions in the
    /// interval count with all of their opacity, as if in one place, so with regions it is an upper bound.
    pub fn max_alpha(&self, low: f64, high: f64) -> f64 {
        if self.labels.as_ref().is_some_and(|labels| !labels.shows_between(low.round(), high.round())) {
            return 0.0;
        }
        let inside = self.opacity.iter().filter(|p| low <= p[0] && p[0] <= high).map(|p| p[1]);
        let ends = [low, high].map(|value| interpolate(&self.opacity, value)[1]);
        let alpha = inside.chain(ends).fold(0.0, f64::max);
        let factor = self.gradient_opacity.iter().map(|point| point[1]).reduce(f64::max).unwrap_or(1.0);
        let regions = self.regions.iter().filter(|region| region.value[0] <= high && low <= region.value[1]);
        let clear = regions.map(|region| 1.0 - region.opacity).product::<f64>();
        if clear == 1.0 { alpha * factor } else { 1.0 - (1.0 - alpha * factor) * clear }
    }
}

/// Mixes a medium with others in the same place, each a colour and an opacity over the same distance.
fn mix(one: [f64; 4], others: impl Iterator<Item = ([f64; 3], f64)>) -> [f64; 4] {
    let (mut mixed, mut total) = (one, depth(one[3]));
    for (color, alpha) in others.filter(|(_, alpha)| *alpha > 0.0) {
        let share = depth(alpha) / (total + depth(alpha));
        (0..3).for_each(|k| mixed[k] += share * (color[k] - mixed[k]));
        mixed[3] = 1.0 - (1.0 - mixed[3]) * (1.0 - alpha);
        total += depth(alpha);
    }
    mixed
}

/// Checks points `[value, ...]`: some, all finite, all but the value in 0..=1.
fn check_points<const N: usize>(list: &'static str, points: &[[f64; N]]) -> Result<(), TransferError> {
    ensure(!points.is_empty(), || TransferError::Empty(list))?;
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

/// Checks points as [`check_points`] does, and that they are sorted by value.
fn check_list<const N: usize>(list: &'static str, points: &[[f64; N]]) -> Result<(), TransferError> {
    check_points(list, points)?;
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn linear_between_points_and_clamped_outside() {
        let tf = TransferFunction {
            color: vec![[0.0, 0.0, 0.0, 0.0], [10.0, 1.0, 0.5, 0.0]],
            opacity: vec![[2.0, 0.0], [4.0, 0.2], [4.0, 0.9]],
            unit_distance: 1.0,
            ..TransferFunction::default()
        };
        assert_eq!([tf.alpha(1.0), tf.alpha(3.0), tf.alpha(4.0), tf.alpha(99.0)], [0.0, 0.1, 0.9, 0.9]);
        assert_eq!(tf.rgb(5.0), [0.5, 0.25, 0.0]);
        assert_eq!(tf.rgb(f64::NEG_INFINITY), [0.0; 3]);
        assert_eq!([tf.max_alpha(0.0, 2.0), tf.max_alpha(3.0, 5.0), tf.max_alpha(2.0, 3.0)], [0.0, 0.9, 0.1]);
    }
}
