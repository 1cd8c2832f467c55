//! A picture in the window as a canvas for overlays.

use crate::overlay::{AXIS_COLORS, Lens};
use brickyard::overlay::canvas::{Area, Canvas, Pen};
use eframe::egui::{Align, Align2, Color32, FontId, Mesh, Pos2, Rect, Shape, Stroke, StrokeKind, pos2};
use glam::{Vec2, vec2};

/// Canvas over a picture in the window.
pub(crate) struct WindowCanvas<'a>(pub(crate) &'a Lens);

impl WindowCanvas<'_> {
    fn place(&self, place: Vec2) -> Pos2 {
        self.0.area.min + eframe::egui::vec2(place.x, place.y)
    }
}

fn color(pen: Pen) -> Color32 {
    match pen {
        Pen::Strong => Color32::WHITE,
        Pen::Pale => Color32::from_gray(225),
        Pen::Faint => Color32::from_gray(200).gamma_multiply(0.35),
        Pen::Axis(axis) => AXIS_COLORS[axis],
    }
}

/// The end, middle or start of a text, at its place.
fn align(part: f32) -> Align {
    match part {
        part if part < 0.25 => Align::Min,
        part if part > 0.75 => Align::Max,
        _ => Align::Center,
    }
}

impl Canvas for WindowCanvas<'_> {
    fn size(&self) -> Vec2 {
        vec2(self.0.area.width(), self.0.area.height())
    }

    fn line(&mut self, ends: [Vec2; 2], width: f32, pen: Pen, _is_behind: bool) {
        let ends = ends.map(|end| self.place(end));
        if pen == Pen::Strong {
            self.0.painter.line_segment(ends, Stroke::new(2.0 * width, Color32::from_black_alpha(150)));
        }
        self.0.painter.line_segment(ends, Stroke::new(width, color(pen)));
    }

    fn text(&mut self, place: Vec2, anchor: Vec2, text: &str, height: f32, pen: Pen) {
        let align = Align2([align(anchor.x), align(anchor.y)]);
        self.0.text(self.place(place), align, text, height, color(pen));
    }

    fn text_width(&self, text: &str, height: f32) -> f32 {
        self.0.painter.layout_no_wrap(text.into(), FontId::proportional(height), Color32::WHITE).size().x
    }

    fn bands(&mut self, area: Area, colors: &[[u8; 3]]) {
        let bar = Rect::from_min_max(self.place(area.min), self.place(area.max));
        let mut mesh = Mesh::default();
        let band = bar.height() / colors.len() as f32;
        for (i, [r, g, b]) in colors.iter().enumerate() {
            let bottom = bar.bottom() - i as f32 * band;
            let rect = Rect::from_min_max(pos2(bar.left(), bottom - band), pos2(bar.right(), bottom));
            mesh.add_colored_rect(rect, Color32::from_rgb(*r, *g, *b));
        }
        self.0.painter.add(Shape::mesh(mesh));
        self.0.painter.rect_stroke(bar, 0.0, Stroke::new(1.0, Color32::from_black_alpha(160)), StrokeKind::Outside);
    }
}
