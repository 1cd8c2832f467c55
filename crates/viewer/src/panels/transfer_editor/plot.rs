//! The curve of opacities over the histogram, and its editing by the pointer.

use super::{FEWEST, Point, add_point, dragged, keys, least, move_point, remove_point};
use crate::panels::color_map::ribbon;
use crate::panels::histogram::{self, Axis};
use crate::panels::widgets::color32;
use brickyard::store::Histogram;
use brickyard::volume::TransferFunction;
use eframe::egui::{Pos2, Rect, Response, Role, Sense, Shape, Stroke, Ui, WidgetInfo, pos2, vec2};

const HEIGHT: f32 = 116.0;

/// Grasping radius of a point, in points of the screen.
const REACH: f32 = 8.0;

/// Points of the screen between the plot's edge and its curve, so that no point is cut off.
const MARGIN: f32 = 6.0;

const HINT: &str = "drag a point; double click, or click on the curve, to add one; right click to remove it\n\
                    arrow keys move the clicked point, Delete removes it";

/// Shows and edits the opacities of a function between two values.
pub(super) fn show(
    ui: &mut Ui,
    function: &mut TransferFunction,
    counts: Counts<'_>,
    ends: [f64; 2],
    selected: &mut Option<Point>,
) {
    let size = vec2(ui.available_width(), HEIGHT);
    let (area, response) = ui.allocate_exact_size(size, Sense::click_and_drag());
    response.widget_info(|| WidgetInfo::labeled(Role::Canvas, ui.is_enabled(), "opacity curve"));
    let plot = Plot { axis: Axis::over(ends, area.shrink(MARGIN)), ends, counts };
    plot.draw(ui, function, *selected, &response);
    let response = plot.hover(response, function);
    plot.drag(ui, &response, function, selected);
    plot.click(&response, function, selected);
    let ([by, up], is_removed) = keys(ui, &response, least(ends));
    if let Some(Point::Opacity(i)) = *selected
        && i < function.opacity.len()
    {
        let [value, alpha] = function.opacity[i];
        if by != 0.0 || up != 0.0 {
            plot.put(function, i, [value + by, alpha + up]);
        }
        if is_removed && remove_point(&mut function.opacity, i, FEWEST) {
            *selected = None;
        }
    }
}

/// How often the values occur, and their unit, as far as known.
#[derive(Clone, Copy)]
pub(super) struct Counts<'a> {
    pub(super) histogram: Option<&'a Histogram>,
    pub(super) unit: Option<&'a str>,
}

struct Plot<'a> {
    axis: Axis,
    ends: [f64; 2],
    counts: Counts<'a>,
}

impl Plot<'_> {
    fn place(&self, [value, alpha]: [f64; 2]) -> Pos2 {
        let area = self.axis.area;
        pos2(self.axis.x(value), area.bottom() - alpha as f32 * area.height())
    }

    fn at(&self, place: Pos2) -> [f64; 2] {
        let area = self.axis.area;
        [self.axis.value(place.x), f64::from((area.bottom() - place.y) / area.height()).clamp(0.0, 1.0)]
    }

    /// The nearest point within reach.
    fn near(&self, function: &TransferFunction, place: Pos2) -> Option<usize> {
        let distances = function.opacity.iter().map(|point| self.place(*point).distance(place)).enumerate();
        let nearest = distances.min_by(|a, b| a.1.total_cmp(&b.1))?;
        (nearest.1 <= REACH).then_some(nearest.0)
    }

    /// Moves a point, as far as possible.
    fn put(&self, function: &mut TransferFunction, index: usize, [value, alpha]: [f64; 2]) {
        move_point(&mut function.opacity, index, value, self.ends, least(self.ends));
        function.opacity[index][1] = alpha.clamp(0.0, 1.0);
    }

    fn drag(&self, ui: &Ui, response: &Response, function: &mut TransferFunction, selected: &mut Option<Point>) {
        let near = |from| self.near(function, from).map(|i| (i, self.place(function.opacity[i]) - from));
        if let Some((i, to)) = dragged(ui, response, (selected, Point::Opacity), near)
            && i < function.opacity.len()
        {
            self.put(function, i, self.at(to));
        }
    }

    fn click(&self, response: &Response, function: &mut TransferFunction, selected: &mut Option<Point>) {
        let Some(pointer) = response.interact_pointer_pos() else { return };
        let near = self.near(function, pointer);
        if response.secondary_clicked() {
            if near.is_some_and(|i| remove_point(&mut function.opacity, i, FEWEST)) {
                *selected = None;
            }
            return;
        }
        if !response.clicked() {
            return;
        }
        response.request_focus();
        let [value, alpha] = self.at(pointer);
        let on_curve = function.alpha(value);
        let is_on_curve = (self.place([value, on_curve]).y - pointer.y).abs() <= 0.6 * REACH;
        let added = match near {
            Some(_) => None,
            None if is_on_curve => add_point(&mut function.opacity, [value, on_curve], least(self.ends)),
            None if response.double_clicked() => add_point(&mut function.opacity, [value, alpha], least(self.ends)),
            None => None,
        };
        *selected = near.or(added).map(Point::Opacity);
    }

    fn hover(&self, response: Response, function: &TransferFunction) -> Response {
        let Some(pointer) = response.hover_pos().filter(|_| !response.dragged()) else { return response };
        let [value, _] = self.at(pointer);
        let text = format!("opacity {:.3}\n{HINT}", function.alpha(value));
        match self.counts.histogram {
            Some(histogram) => histogram::hovered(response, &self.axis, histogram, self.counts.unit, &text),
            None => response.on_hover_text_at_pointer(text),
        }
    }

    fn draw(&self, ui: &Ui, function: &TransferFunction, selected: Option<Point>, response: &Response) {
        let area = response.rect;
        let (painter, visuals) = (ui.painter_at(area), ui.visuals());
        painter.rect_filled(area, 2.0, visuals.extreme_bg_color);
        // Not translucent: bars meet each other.
        let faint = visuals.extreme_bg_color.lerp_to_gamma(visuals.weak_text_color(), 0.4);
        if let Some(histogram) = self.counts.histogram {
            histogram::bars(ui, &self.axis, histogram, |_| faint);
        }
        painter.add(self.fill(area, function));
        let edge = |x: f32| pos2(x, self.place([0.0, function.alpha(self.axis.value(x))]).y);
        // A curve dragged past an edge leaves the picture there.
        let inside = function.opacity.iter().map(|point| self.place(*point));
        let inside = inside.filter(|place| area.x_range().contains(place.x));
        let line: Vec<_> = [edge(area.left())].into_iter().chain(inside.clone()).chain([edge(area.right())]).collect();
        painter.add(Shape::line(line, Stroke::new(1.5, visuals.text_color())));
        let near = response.hover_pos().and_then(|pointer| self.near(function, pointer));
        for (i, point) in function.opacity.iter().enumerate() {
            let place = self.place(*point);
            let is_selected = selected == Some(Point::Opacity(i));
            let radius = if near == Some(i) || is_selected { 5.0 } else { 4.0 };
            let fill = if is_selected { visuals.selection.bg_fill } else { visuals.extreme_bg_color };
            painter.circle(place, radius, fill, Stroke::new(1.5, visuals.strong_text_color()));
        }
        if response.has_focus() {
            painter.rect_stroke(area, 2.0, visuals.selection.stroke, eframe::egui::StrokeKind::Inside);
        }
    }

    /// The area below the curve, in the function's colours.
    fn fill(&self, area: Rect, function: &TransferFunction) -> Shape {
        let columns = (area.width() / 2.0).ceil() as u32;
        ribbon((0..=columns).map(|column| {
            let x = area.left() + area.width() * column as f32 / columns as f32;
            let value = self.axis.value(x);
            let top = pos2(x, self.place([value, function.alpha(value)]).y);
            ([top, pos2(x, area.bottom())], color32(function.rgb(value)).gamma_multiply(0.75))
        }))
    }
}
