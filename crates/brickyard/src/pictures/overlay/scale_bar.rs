//! Scale bars: lengths of 1, 2 or 5 times a power of ten, at the distance of the camera's target.

use super::canvas::{Area, Lens, Pen, settle};
use super::round::round_length;
use brickyard_volume::Camera;
use glam::{Vec2, vec2};

/// Greatest share of the picture's width for the bar.
const MOST_OF_WIDTH: f64 = 0.25;

/// Height of the text, in points.
const TEXT: f32 = 13.0;

/// Space between the bar and the picture's edges, horizontally and vertically, in points.
const MARGIN: Vec2 = vec2(20.0, 16.0);

/// Draws the scale bar of a camera's picture; `unit` is the world's.
pub fn draw(lens: &mut Lens<'_>, camera: &Camera, unit: &str, taken: &mut Vec<Area>) {
    let points_per_unit = lens.points_per_unit((camera.target - camera.eye).dot(lens.rays.forward));
    let all = lens.canvas.size();
    let Some(length) = round_length(MOST_OF_WIDTH * f64::from(all.x) / points_per_unit) else { return };
    let bar = (length * points_per_unit) as f32;
    let text = format!("{length} {unit}");
    let text = text.trim_end();
    let size = vec2(bar.max(lens.canvas.text_width(text, TEXT)), TEXT + 8.0);
    let far = all - size - MARGIN;
    let middle = (all.x - size.x) / 2.0;
    let corners =
        [far, vec2(MARGIN.x, far.y), vec2(middle, far.y), vec2(far.x, MARGIN.y), MARGIN, vec2(middle, MARGIN.y)];
    let Some(area) = settle(lens.canvas, size, &corners, taken) else { return };
    let (middle, y) = ((area.min.x + area.max.x) / 2.0, area.max.y - 2.0);
    lens.canvas.line([vec2(middle - bar / 2.0, y), vec2(middle + bar / 2.0, y)], 2.0, Pen::Strong, false);
    lens.canvas.text(vec2(middle, y - 3.0), vec2(0.5, 1.0), text, TEXT, Pen::Strong);
}
