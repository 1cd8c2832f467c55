//! Overlays of the pictures: the volume's box with ticks, a scale bar, the axes' directions, colour bars, measured distances, and the drawn bricks.
//! All of it follows from the camera and the scene.

pub(crate) mod bricks;
mod canvas;

use crate::overlay::canvas::WindowCanvas;
use crate::state::Overlays;
use brickyard::lettering::edge_letters;
use brickyard::overlay::canvas::Lens as OverlayLens;
use brickyard::overlay::{World, axis_names, box_axes, color_bar, scale_bar};
use brickyard::session::VolumeSource;
use brickyard::volume::numbers::significant;
use brickyard::volume::{Camera, Scene, ViewRays};
use eframe::egui::{Align2, Color32, FontId, Painter, Pos2, Rect, Stroke, Vec2, pos2, vec2};
use glam::DVec3;

/// Least width of a picture with colour bars, in points.
const LEAST_BARRED: f32 = 420.0;

/// Least size of a picture with letters at its edges, in points: smaller ones would be covered.
const LEAST_LETTERED: f32 = 96.0;

/// Least distance from a letter's middle to a line, in points.
const CLEARANCE: f32 = 16.0;

/// The colours of the axes x, y and z, as on finished pictures.
pub(crate) const AXIS_COLORS: [Color32; 3] = {
    const fn color([r, g, b]: [u8; 3]) -> Color32 {
        Color32::from_rgb(r, g, b)
    }
    let [x, y, z] = brickyard::overlay::canvas::AXIS_COLORS;
    [color(x), color(y), color(z)]
};

/// The colour of measured distances, rare in volumes.
const MEASURED: Color32 = Color32::from_rgb(255, 210, 60);

/// A picture in the window, mapping world points to places.
pub(crate) struct Lens {
    /// Painter clipped to the picture.
    pub(crate) painter: Painter,
    /// The picture's part of the window.
    pub(crate) area: Rect,
    pub(crate) rays: ViewRays,
}

impl Lens {
    /// A camera's picture of `size_px` pixels in a part of the window, if it has one.
    pub(crate) fn new(painter: &Painter, area: Rect, camera: &Camera, size_px: (u32, u32)) -> Option<Self> {
        let rays = camera.rays(size_px.0, size_px.1).ok()?;
        Some(Self { painter: painter.with_clip_rect(area), area, rays })
    }

    /// A world point's place in the window; `None` behind the eye.
    pub(crate) fn place(&self, point: DVec3) -> Option<Pos2> {
        let [x, y] = self.rays.pixel(point)?;
        let part = vec2((x / f64::from(self.rays.width)) as f32, (y / f64::from(self.rays.height)) as f32);
        Some(self.area.min + part * self.area.size())
    }

    /// The pixel at a place of the window, from the picture's upper left corner.
    pub(crate) fn pixel(&self, place: Pos2) -> [f64; 2] {
        let part = (place - self.area.min) / self.area.size();
        [f64::from(part.x) * f64::from(self.rays.width), f64::from(part.y) * f64::from(self.rays.height)]
    }

    /// Points in the window per unit of the world along a direction from a point; `small` is a short distance of the world.
    pub(crate) fn rate(&self, point: DVec3, direction: DVec3, small: f64) -> Option<Vec2> {
        Some((self.place(point + small * direction)? - self.place(point)?) / small as f32)
    }

    /// The world distance along such a direction of a drag by some points; `None` where the direction is not visible.
    pub(crate) fn distance(&self, point: DVec3, direction: DVec3, small: f64, by: Vec2) -> Option<f64> {
        let rate = self.rate(point, direction, small).filter(|rate| rate.length_sq() > 1e-12)?;
        Some(f64::from(by.dot(rate) / rate.length_sq()))
    }

    /// The handle nearest to a place of the window, of those within `reach` points. Each is given with its world point.
    pub(crate) fn nearest<T>(&self, handles: impl Iterator<Item = (T, DVec3)>, at: Pos2, reach: f32) -> Option<T> {
        let near = handles.filter_map(|(handle, point)| {
            let distance = self.place(point)?.distance(at);
            (distance <= reach).then_some((distance, handle))
        });
        near.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, handle)| handle)
    }

    /// Draws a line between two world points in front of the eye.
    pub(crate) fn line(&self, from: DVec3, to: DVec3, stroke: Stroke) {
        if let (Some(a), Some(b)) = (self.place(from), self.place(to)) {
            self.painter.line_segment([a, b], stroke);
        }
    }

    /// Draws the edges of a box, of which both ends are in front of the eye.
    pub(crate) fn edges(&self, corners: (DVec3, DVec3), stroke: Stroke) {
        for [from, to] in box_axes::edges(corners) {
            self.line(from, to, stroke);
        }
    }

    /// Draws overlays shared with finished pictures.
    fn overlay(&self, draw: impl FnOnce(&mut OverlayLens<'_>)) {
        draw(&mut OverlayLens { canvas: &mut WindowCanvas(self), rays: self.rays });
    }

    /// Writes a text legible on any colour.
    pub(crate) fn text(&self, place: Pos2, align: Align2, text: &str, size: f32, color: Color32) {
        let font = FontId::proportional(size);
        let shade = Color32::from_black_alpha(190);
        self.painter.text(place + vec2(1.0, 1.0), align, text, font.clone(), shade);
        self.painter.text(place, align, text, font, color);
    }
}

/// Draws the overlays of a scene and its world.
pub(crate) fn show(
    lens: &Lens,
    overlays: &Overlays,
    scene: &Scene,
    camera: &Camera,
    volumes: &[VolumeSource],
    world: &World<'_>,
) {
    if overlays.outline {
        lens.overlay(|over| box_axes::draw_edges(over, world));
    }
    if overlays.ticks {
        lens.overlay(|over| box_axes::draw_ticks(over, world, &mut Vec::new()));
    }
    if overlays.axes {
        axes(&lens.painter, lens.area, &lens.rays, world.is_anatomical);
    }
    if overlays.scale_bar {
        scale_bar(lens, camera, world.unit);
    }
    if overlays.color_bar && lens.area.width() > LEAST_BARRED {
        let bars = color_bar::bars(scene, volumes);
        lens.overlay(|over| color_bar::draw(over.canvas, &bars, &mut Vec::new()));
    }
    if overlays.letters && world.is_anatomical && scene.slice.is_some() && scene.stereo.is_none() {
        letters(lens, None);
    }
}

/// Draws distances, each with its length.
pub(crate) fn distances(lens: &Lens, distances: &[[DVec3; 2]], unit: &str) {
    for [from, to] in distances {
        lens.line(*from, *to, Stroke::new(1.5, MEASURED));
        for end in [from, to] {
            if let Some(place) = lens.place(*end) {
                lens.painter.circle_stroke(place, 3.5, Stroke::new(1.5, MEASURED));
            }
        }
        if let Some(middle) = lens.place((*from + *to) * 0.5) {
            let text = format!("{} {unit}", significant(from.distance(*to), 4));
            lens.text(middle + vec2(6.0, -6.0), Align2::LEFT_BOTTOM, text.trim_end(), 13.0, MEASURED);
        }
    }
}

/// Draws the mark at the start of a distance.
pub(crate) fn beginning(lens: &Lens, point: DVec3) {
    if let Some(place) = lens.place(point) {
        lens.painter.circle(place, 4.0, MEASURED, Stroke::new(1.5, Color32::from_black_alpha(160)));
    }
}

/// Writes the letters of a patient's sides at the picture's edges, beside the lines crossing it at a point.
pub(crate) fn letters(lens: &Lens, crossing: Option<DVec3>) {
    let area = lens.area.shrink(8.0);
    if lens.area.size().min_elem() < LEAST_LETTERED {
        return;
    }
    let lines = crossing.and_then(|point| lens.place(point));
    let [x, y] = [0, 1].map(|axis| beside(area.center()[axis], lines.map(|lines| lines[axis])));
    let places = [
        (pos2(area.left(), y), Align2::LEFT_CENTER),
        (pos2(area.right(), y), Align2::RIGHT_CENTER),
        (pos2(x, area.top()), Align2::CENTER_TOP),
        (pos2(x, area.bottom()), Align2::CENTER_BOTTOM),
    ];
    for (letters, (place, align)) in edge_letters(&lens.rays).iter().zip(places) {
        lens.text(place, align, letters, 18.0, Color32::WHITE);
    }
}

/// The place along an edge nearest to `place` with room for a letter beside a line.
fn beside(place: f32, line: Option<f32>) -> f32 {
    match line {
        Some(line) if (place - line).abs() < CLEARANCE => line + CLEARANCE.copysign(place - line),
        _ => place,
    }
}

/// Draws the directions of the axes in the lower left corner, the nearest last.
fn axes(painter: &Painter, area: Rect, rays: &ViewRays, is_anatomical: bool) {
    let names = axis_names(is_anatomical);
    let middle = pos2(area.left() + 40.0, area.bottom() - 40.0);
    let (right, up) = (rays.right.normalize(), rays.up.normalize());
    let mut axes = [0, 1, 2].map(|axis| (axis, DVec3::AXES[axis]));
    axes.sort_by(|a, b| b.1.dot(rays.forward).total_cmp(&a.1.dot(rays.forward)));
    for (axis, direction) in axes {
        let towards = vec2(direction.dot(right) as f32, -direction.dot(up) as f32);
        let end = middle + 24.0 * towards;
        painter.line_segment([middle, end], Stroke::new(2.0, AXIS_COLORS[axis]));
        let text = middle + 33.0 * towards;
        painter.text(text, Align2::CENTER_CENTER, names[axis], FontId::proportional(12.0), AXIS_COLORS[axis]);
    }
}

/// Draws a scale bar for the distance of the camera's target.
pub(crate) fn scale_bar(lens: &Lens, camera: &Camera, unit: &str) {
    lens.overlay(|over| scale_bar::draw(over, camera, unit, &mut Vec::new()));
}

#[cfg(test)]
mod tests {
    use super::*;
    use brickyard::volume::Side;
    use eframe::egui;
    use eframe::egui::{Context, LayerId, RawInput, Shape};

    pub(crate) fn lens(camera: &Camera) -> Lens {
        let painter = Painter::new(Context::default(), LayerId::background(), egui::Rect::EVERYTHING);
        let area = Rect::from_min_size(pos2(100.0, 50.0), vec2(200.0, 100.0));
        Lens::new(&painter, area, camera, (400, 200)).unwrap()
    }

    #[test]
    fn places_are_those_of_the_picture() {
        let camera = Camera::looking_at_box((DVec3::ZERO, DVec3::ONE));
        let lens = lens(&camera);
        let found = lens.place(camera.target).unwrap();
        assert!((found - pos2(200.0, 100.0)).length() < 1e-3, "{found:?}");
        assert_eq!(lens.pixel(pos2(200.0, 100.0)), [200.0, 100.0]);
        assert_eq!(lens.place(camera.eye + (camera.eye - camera.target)), None);
    }

    /// The texts drawn over a picture in a part of a window, with their middles.
    fn texts(camera: &Camera, draw: impl Fn(&Lens)) -> Vec<(String, Pos2)> {
        let area = Rect::from_min_size(pos2(100.0, 50.0), vec2(200.0, 100.0));
        let mut shown = Context::default().run_ui(RawInput::default(), |ui| {
            let painter = Painter::new(ui.ctx().clone(), LayerId::background(), Rect::EVERYTHING);
            draw(&Lens::new(&painter, area, camera, (400, 200)).unwrap());
        });
        let drawn = shown.shapes.iter().filter_map(|shape| match &shape.shape {
            Shape::Text(text) => Some((text.galley.text().to_string(), text.visual_bounding_rect().center())),
            _ => None,
        });
        let drawn = drawn.collect();
        // egui insists on it.
        shown.textures_delta.clear();
        drawn
    }

    #[test]
    fn letters_stand_at_the_edges_of_the_sides_that_they_name() {
        // An axial slice, seen from the feet: the patient's left is on the right.
        let camera =
            Camera::looking_from(Side::Inferior.direction(), Side::Anterior.direction(), (DVec3::ZERO, DVec3::ONE));
        let texts = texts(&camera, |lens| letters(lens, None));
        for (letter, near) in
            [("R", pos2(110.0, 100.0)), ("L", pos2(290.0, 100.0)), ("A", pos2(200.0, 62.0)), ("P", pos2(200.0, 138.0))]
        {
            let found = texts.iter().filter(|(text, _)| text == letter).map(|(_, place)| place.distance(near));
            assert!(found.clone().count() > 0 && found.clone().all(|distance| distance < 12.0), "{letter}: {texts:?}");
        }
    }

    #[test]
    fn letters_stand_beside_the_lines_of_slices() {
        let camera =
            Camera::looking_from(Side::Inferior.direction(), Side::Anterior.direction(), (DVec3::ZERO, DVec3::ONE));
        let texts = texts(&camera, |lens| letters(lens, Some(camera.target)));
        for (letter, axis) in [("R", 1), ("L", 1), ("A", 0), ("P", 0)] {
            let line = pos2(200.0, 100.0)[axis];
            let found = texts.iter().filter(|(text, _)| text == letter).map(|(_, place)| (place[axis] - line).abs());
            assert!(found.clone().all(|distance| (10.0..22.0).contains(&distance)), "{letter}: {texts:?}");
        }
        assert_eq!([beside(50.0, None), beside(50.0, Some(10.0)), beside(50.0, Some(52.0))], [50.0, 50.0, 36.0]);
    }
}
