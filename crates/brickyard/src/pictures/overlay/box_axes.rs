//! The box around the volumes, with ticks in world units along three of its edges: for each axis the outermost one in
//! the picture, where ticks cover nothing. Edges in front of the box's contents are left out, so they hide nothing
//! either.

use super::canvas::{Area, Lens, Pen, settle};
use super::round::ticks;
use super::{World, axis_names};
use brickyard_volume::box_corners;
use brickyard_volume::numbers::within_span;
use brickyard_volume::units::name_in_unit;
use glam::{DVec3, Vec2, vec2};

/// Distance between ticks, in points.
const APART: f64 = 60.0;

/// Length of a tick, in points.
const LENGTH: f32 = 5.0;

/// Height of the numbers and of the axes' names, in points.
const NUMBER: f32 = 10.5;
const NAME: f32 = 12.0;

/// Returns the twelve edges of a box.
pub fn edges(corners: (DVec3, DVec3)) -> impl Iterator<Item = [DVec3; 2]> {
    (0..3).flat_map(move |axis| along(corners, axis))
}

/// Returns the four edges of a box along an axis.
fn along(corners: (DVec3, DVec3), axis: usize) -> impl Iterator<Item = [DVec3; 2]> {
    let starts = (0..8usize).filter(move |i| i >> axis & 1 == 0);
    let corners = box_corners(corners);
    starts.map(move |i| [corners[i], corners[i | 1 << axis]])
}

/// Draws the edges of a world's box, except those in front of its contents.
pub fn draw_edges(lens: &mut Lens<'_>, world: &World<'_>) {
    for axis in 0..3 {
        let edges: Vec<_> = along(world.corners, axis).collect();
        for edge in edges {
            // An edge between two faces is in front of the box's contents if the outer sides of both are visible, and
            // behind them if neither is.
            let seen = (0..3).filter(|&other| other != axis).map(|other| is_face_seen(lens, world, edge[0], other));
            let seen = seen.filter(|is_seen| *is_seen).count();
            if let (true, [Some(a), Some(b)]) = (seen < 2, edge.map(|end| lens.place(end))) {
                lens.canvas.line([a, b], 1.0, Pen::Faint, seen == 0);
            }
        }
    }
}

/// Whether the outer side of a box's face across an axis, at this point, is visible.
fn is_face_seen(lens: &Lens<'_>, world: &World<'_>, point: DVec3, axis: usize) -> bool {
    let (low, high) = world.corners;
    let outward = if point[axis] > (low[axis] + high[axis]) / 2.0 { 1.0 } else { -1.0 };
    let towards_eye =
        if lens.rays.orthographic { -lens.rays.middle()[axis] } else { lens.rays.eye[axis] - point[axis] };
    outward * towards_eye > 0.0
}

/// Draws the ticks of a world's box.
pub fn draw_ticks(lens: &mut Lens<'_>, world: &World<'_>, taken: &mut Vec<Area>) {
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
            lens.canvas.line([place, place + LENGTH * outward], 1.0, Pen::Axis(axis), false);
            let text = within_span(tick, high[axis] - low[axis]);
            write(lens, [14.0, -18.0].map(|by| place + by * outward), &text, taken);
        }
        let name = axis_names(world.is_anatomical)[axis];
        let text = name_in_unit(name, Some(world.axis_units[axis]));
        name_axis(lens, [start, end, 34.0 * outward], &text, Pen::Axis(axis), taken);
    }
}

/// Writes the name of an axis beside the middle of its edge, or, outside the picture, beyond one of its ends or on the
/// other side.
fn name_axis(lens: &mut Lens<'_>, [start, end, aside]: [Vec2; 3], text: &str, pen: Pen, taken: &mut Vec<Area>) {
    let size = vec2(lens.canvas.text_width(text, NAME), NAME);
    let all = lens.canvas.size();
    let beyond = (end - start).normalize_or_zero() * NAME * 1.5;
    let middle = start.lerp(end, 0.5);
    let places = [middle + aside, end + beyond, start - beyond, middle - aside].map(|place| place - size / 2.0);
    let is_inside = |corner: &Vec2| corner.cmpge(Vec2::ZERO).all() && (*corner + size).cmple(all).all();
    let places: Vec<Vec2> = places.into_iter().filter(is_inside).collect();
    if let Some(area) = settle(lens.canvas, size, &places, taken) {
        lens.canvas.text(area.min, Vec2::ZERO, text, NAME, pen);
    }
}

/// Writes a number around the first of two places, or if cut off there, around the second.
fn write(lens: &mut Lens<'_>, places: [Vec2; 2], text: &str, taken: &mut Vec<Area>) {
    let half = vec2(lens.canvas.text_width(text, NUMBER), NUMBER) / 2.0;
    let all = lens.canvas.size();
    let is_inside = |place: &Vec2| place.cmpge(half).all() && (*place + half).cmple(all).all();
    let Some(place) = places.into_iter().find(is_inside) else { return };
    taken.push(Area { min: place - half, max: place + half });
    lens.canvas.text(place, vec2(0.5, 0.5), text, NUMBER, Pen::Pale);
}

/// Returns the edge along an axis with its middle farthest below or beside the box's middle in the picture; `None` if
/// the eye is in the way.
fn outermost(lens: &Lens<'_>, corners: (DVec3, DVec3), axis: usize, middle: Vec2) -> Option<[DVec3; 2]> {
    let distance = |[from, to]: &[DVec3; 2]| {
        let by = lens.place((*from + *to) * 0.5)? - middle;
        // Prefer below to above, where the eye looks for scales.
        Some(by.length() + by.y.max(0.0))
    };
    let placed = along(corners, axis).filter_map(|edge| Some((distance(&edge)?, edge)));
    placed.max_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, edge)| edge)
}

/// Returns the unit vector at right angles to an edge, away from the middle.
fn outward(start: Vec2, end: Vec2, middle: Vec2) -> Vec2 {
    let across = (end - start).normalize_or_zero().perp();
    if across.dot(start.lerp(end, 0.5) - middle) < 0.0 { -across } else { across }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_box_has_twelve_edges() {
        let lengths: Vec<_> = edges((DVec3::ZERO, DVec3::new(1.0, 2.0, 4.0))).map(|[a, b]| a.distance(b)).collect();
        assert_eq!(lengths.len(), 12);
        assert_eq!(lengths.iter().sum::<f64>(), 28.0);
    }
}
