//! The strip of colours, with a handle for each colour point below, and its editing by the pointer.

use super::{Point, add_point, dragged, keys, least, move_point, remove_point};
use crate::panels::color_map;
use crate::panels::histogram::Axis;
use crate::panels::widgets::color32;
use brickyard::volume::TransferFunction;
use eframe::egui::{Pos2, Rect, Response, Role, Sense, Shape, Stroke, StrokeKind, Ui, Vec2, WidgetInfo, pos2, vec2};

const HEIGHT: f32 = 30.0;

/// Grasping radius of a handle, in points of the screen.
const REACH: f32 = 7.0;

/// As for the curve above, so that values are aligned.
const MARGIN: f32 = 6.0;

const HINT: &str =
    "click a handle to edit its colour, drag it to move it; double click to add one; right click to remove it";

/// Shows a function's colours between two values, and edits its colour points `points`.
pub(super) fn show(
    ui: &mut Ui,
    function: &TransferFunction,
    points: &mut Vec<[f64; 4]>,
    ends: [f64; 2],
    selected: &mut Option<Point>,
) {
    let size = vec2(ui.available_width(), HEIGHT);
    let (area, response) = ui.allocate_exact_size(size, Sense::click_and_drag());
    response.widget_info(|| WidgetInfo::labeled(Role::Canvas, ui.is_enabled(), "colour points"));
    let response = response.on_hover_text_at_pointer(HINT);
    let axis = Axis::over(ends, area.shrink2(vec2(MARGIN, 0.0)));
    let strip = Rect::from_min_max(area.min + vec2(0.0, 1.0), pos2(area.right(), area.top() + 17.0));
    color_map::strip(ui, strip.shrink2(vec2(1.0, 0.0)), |share| {
        color32(function.rgb(axis.value(strip.left() + strip.width() * share as f32)))
    });
    drag(ui, &response, &axis, points, selected);
    click(&response, &axis, function, points, selected);
    let ([by, _], is_removed) = keys(ui, &response, least(ends));
    if let Some(Point::Color(i)) = *selected
        && i < points.len()
    {
        let to = points[i][0] + by;
        move_point(points, i, to, ends, least(ends));
        if is_removed && remove_point(points, i, 1) {
            *selected = None;
        }
    }
    for (i, point) in points.iter().enumerate() {
        handle(ui, pos2(axis.x(point[0]), strip.bottom() + 1.0), area, *point, *selected == Some(Point::Color(i)));
    }
    if response.has_focus() {
        ui.painter().rect_stroke(area, 2.0, ui.visuals().selection.stroke, StrokeKind::Inside);
    }
}

/// Draws a pointed handle below its place in the strip.
fn handle(ui: &Ui, tip: Pos2, area: Rect, [_, r, g, b]: [f64; 4], is_selected: bool) {
    let visuals = ui.visuals();
    let corners = [(0.0, 0.0), (5.0, 5.0), (5.0, 11.0), (-5.0, 11.0), (-5.0, 5.0)];
    let outline = corners.map(|(right, down)| tip + vec2(right, down)).to_vec();
    let stroke = match is_selected {
        true => Stroke::new(2.0, visuals.selection.stroke.color),
        false => Stroke::new(1.0, visuals.text_color()),
    };
    ui.painter_at(area).add(Shape::convex_polygon(outline, color32([r, g, b]), stroke));
}

fn near(axis: &Axis, points: &[[f64; 4]], x: f32) -> Option<usize> {
    let distances = points.iter().map(|point| (axis.x(point[0]) - x).abs()).enumerate();
    let nearest = distances.min_by(|a, b| a.1.total_cmp(&b.1))?;
    (nearest.1 <= REACH).then_some(nearest.0)
}

fn drag(ui: &Ui, response: &Response, axis: &Axis, points: &mut [[f64; 4]], selected: &mut Option<Point>) {
    let near = |from: Pos2| near(axis, points, from.x).map(|i| (i, Vec2::ZERO));
    if let Some((i, to)) = dragged(ui, response, (selected, Point::Color), near)
        && i < points.len()
    {
        move_point(points, i, axis.value(to.x), axis.ends(), least(axis.ends()));
    }
}

fn click(
    response: &Response,
    axis: &Axis,
    function: &TransferFunction,
    points: &mut Vec<[f64; 4]>,
    selected: &mut Option<Point>,
) {
    let Some(pointer) = response.interact_pointer_pos() else { return };
    let near = near(axis, points, pointer.x);
    if response.secondary_clicked() {
        if near.is_some_and(|i| remove_point(points, i, 1)) {
            *selected = None;
        }
    } else if response.clicked() {
        response.request_focus();
        let value = axis.value(pointer.x);
        let [r, g, b] = function.rgb(value);
        let is_new = near.is_none() && response.double_clicked();
        let added = is_new.then(|| add_point(points, [value, r, g, b], least(axis.ends()))).flatten();
        *selected = near.or(added).map(Point::Color);
    }
}
