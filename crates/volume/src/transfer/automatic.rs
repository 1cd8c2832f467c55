//! The transfer function that shows a field whose user has said nothing: what is background is clear, and the rest bright enough to be lit.
//!
//! A body's surface is a haze that its inside shines through where that has greater values, as bone does through skin; all of it is
//! nearly white, since what tells its parts apart is light and opacity. A field without a background shows its upper half in the colours of turbo, without its dark ends.

use super::TransferFunction;
use super::maps;
use crate::foreground::Foreground;

/// The name of the preset.
pub(super) const NAME: &str = "auto";

/// Opacities where the foreground begins, at its surface, at the body's mean and at the window's end.
const BODY: [f64; 4] = [0.0, 0.08, 0.3, 0.8];
/// Opacities where the upper half begins, in its middle and at its end.
const FIELD: [f64; 3] = [0.0, 0.15, 0.8];

/// Colours of a body, at the same places as [`BODY`].
const COLORS: [[f64; 3]; 4] = [[0.75, 0.68, 0.62], [0.85, 0.78, 0.71], [0.97, 0.93, 0.88], [1.0, 1.0, 1.0]];

/// The function that shows a foreground, up to the value `high`.
pub(super) fn automatic(foreground: &Foreground, high: f64, unit_distance: f64) -> TransferFunction {
    let Foreground { low, surface, body, has_background } = *foreground;
    let (color, opacity) = if has_background {
        let places = [low, surface, body.max(surface), high.max(body).max(surface)];
        let color = places.iter().zip(COLORS).map(|(value, [r, g, b])| [*value, r, g, b]).collect();
        (color, places.into_iter().zip(BODY).map(Into::into).collect())
    } else {
        let colors = maps::colors("turbo").expect("'turbo' is a map");
        let colors = &colors[colors.len() / 8..colors.len() * 7 / 8];
        let last = (colors.len() - 1) as f64;
        let place = |i: usize| low + (body - low) * (i as f64 / last);
        let color = colors.iter().enumerate().map(|(i, [r, g, b])| [place(i), *r, *g, *b]).collect();
        (color, [low, surface, body].into_iter().zip(FIELD).map(Into::into).collect())
    };
    TransferFunction { color, opacity, unit_distance, ..TransferFunction::default() }
}
