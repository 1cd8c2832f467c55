//! Ticks with world coordinates along three edges of a box: for each axis the edge that is outermost in the picture, so that they stand over nothing.

use crate::overlay::round::ticks;
use crate::overlay::{AXIS_COLORS, Lens, World, corner};
use brickyard::volume::numbers::within_span;
use eframe::egui::{Align2, Color32, Pos2, Stroke, Vec2};
use glam::DVec3;

/// How far ticks are apart, in points.
const APART: f64 = 60.0;

/// How long they are, in points.
const LENGTH: f32 = 5.0;

/// Draws the ticks of a world's box.
pub(crate) fn show(lens: &Lens, world: &World<'_>) {
    let (low, high) = world.corners;
    let Some(middle) = lens.place((low + high) * 0.5) else { return };
    for axis in 0..3 {
        let Some([from, to]) = outermost(lens, world.corners, axis, middle) else { continue };
        let (Some(start), Some(end)) = (lens.place(from), lens.place(to)) else { continue };
        let outward = outward(start, end, middle);
        let count = f64::from(start.distance(end)) / APART;
        for tick in ticks(low[axis], high[axis], count) {
            let mut point = from;
            point[axis] = tick;
            let Some(place) = lens.place(point) else { continue };
            lens.painter.line_segment([place, place + LENGTH * outward], Stroke::new(1.0, AXIS_COLORS[axis]));
            let text = within_span(tick, high[axis] - low[axis]);
            lens.text(place + 14.0 * outward, Align2::CENTER_CENTER, &text, 10.5, Color32::from_gray(220));
        }
        let name = if world.is_anatomical { ["R", "A", "S"][axis] } else { ["x", "y", "z"][axis] };
        let text = if world.unit.is_empty() { name.to_string() } else { format!("{name} ({})", world.unit) };
        lens.text(start.lerp(end, 0.5) + 34.0 * outward, Align2::CENTER_CENTER, &text, 12.0, AXIS_COLORS[axis]);
    }
}

/// The edge along an axis whose middle is farthest below or beside the box's middle in the picture; `None` if the eye is in the way.
fn outermost(lens: &Lens, corners: (DVec3, DVec3), axis: usize, middle: Pos2) -> Option<[DVec3; 2]> {
    let starts = (0..8usize).filter(|i| i >> axis & 1 == 0);
    let ends = starts.map(|i| [corner(corners, i), corner(corners, i | 1 << axis)]);
    let distance = |[from, to]: &[DVec3; 2]| {
        let by = lens.place((*from + *to) * 0.5)? - middle;
        // Below rather than above, where the eye looks for scales.
        Some(by.length() + if by.y > 0.0 { by.y } else { 0.0 })
    };
    let placed = ends.filter_map(|edge| Some((distance(&edge)?, edge)));
    placed.max_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, edge)| edge)
}

/// At right angles to an edge, away from the middle; of length 1.
fn outward(start: Pos2, end: Pos2, middle: Pos2) -> Vec2 {
    let across = (end - start).normalized().rot90();
    if across.dot(start.lerp(end, 0.5) - middle) < 0.0 { -across } else { across }
}
