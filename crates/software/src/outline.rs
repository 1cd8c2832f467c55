//! Outlines: the pixels that a cell or a triangle may cover.

use brickyard_volume::{PixelRect, ViewRays};
use glam::DVec3;

/// The pixels among `within` whose rays may meet the convex hull of these corners, with a pixel to spare on each side;
/// `None` if there are none.
pub(crate) fn pixels<const N: usize>(rays: &ViewRays, within: PixelRect, corners: [DVec3; N]) -> Option<PixelRect> {
    let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
    for corner in corners {
        // Partly behind the eye: the outline is unbounded.
        let Some(place) = rays.pixel(corner) else { return Some(within) };
        for k in 0..2 {
            (low[k], high[k]) = (low[k].min(place[k]), high[k].max(place[k]));
        }
    }
    // Casts saturate: far outside becomes the edge.
    let range = |k: usize, from: u32, to: u32| {
        let first = ((low[k] - 1.0).floor() as u32).clamp(from, to);
        (first, ((high[k] + 1.0).ceil() as u32).clamp(first, to))
    };
    let ((x0, x1), (y0, y1)) = (range(0, within.x0, within.x1), range(1, within.y0, within.y1));
    (x0 < x1 && y0 < y1).then_some(PixelRect { x0, x1, y0, y1 })
}
