//! The automatic transfer function: background is clear, and the rest bright enough to be lit.
//!
//! A body's surface is a haze, with greater values inside shining through, as bone does through skin. All of it is nearly white, since light and
//! opacity separate its parts. A field without a background shows its upper half in the colours of turbo, without its dark ends.

use super::TransferFunction;
use super::maps;
use crate::foreground::Foreground;

/// Name of the preset.
pub(super) const NAME: &str = "auto";

/// Opacities at the foreground's beginning, its surface, the body's mean and the window's end.
const BODY: [f64; 4] = [0.0, 0.08, 0.3, 0.8];
/// Opacities at the beginning, middle and end of the upper half.
const FIELD: [f64; 3] = [0.0, 0.15, 0.8];

/// Colours of a body, at the places of [`BODY`].
const COLORS: [[f64; 3]; 4] = [[0.75, 0.68, 0.62], [0.85, 0.78, 0.71], [0.97, 0.93, 0.88], [1.0, 1.0, 1.0]];

/// The function for a foreground, up to the value `high`.
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
    TransferFunction::new(color, opacity, unit_distance)
}
