//! What is drawn over the picture: the volume's box, a scale bar, and which way the axes of the world point. All of it follows from the camera.

use brickyard::volume::{Camera, ViewRays};
use eframe::egui::{Align2, Color32, FontId, Painter, Pos2, Rect, Stroke, Vec2, pos2, vec2};
use glam::DVec3;

/// The part of the picture's width that the scale bar takes at most.
const MOST_OF_WIDTH: f64 = 0.25;

/// Colours of the axes x, y and z, as elsewhere.
const AXIS_COLORS: [Color32; 3] =
    [Color32::from_rgb(235, 85, 85), Color32::from_rgb(95, 200, 95), Color32::from_rgb(95, 145, 245)];

const PALE: Color32 = Color32::from_rgb(200, 200, 200);

/// The world that is seen.
pub(crate) struct World<'a> {
    /// Its least and greatest corner.
    pub(crate) corners: (DVec3, DVec3),
    /// Whether it is a patient's.
    pub(crate) is_anatomical: bool,
    /// The unit of its distances; empty if that is not known.
    pub(crate) unit: &'a str,
}

/// Draws over a picture that fills `area`.
pub(crate) fn show(painter: &Painter, area: Rect, camera: &Camera, size_px: (u32, u32), world: &World<'_>) {
    let Ok(rays) = camera.rays(size_px.0, size_px.1) else { return };
    let painter = painter.with_clip_rect(area);
    outline(&painter, area, &rays, world.corners);
    axes(&painter, area, &rays, world.is_anatomical);
    let distance = (camera.target - camera.eye).dot(rays.forward);
    let points_per_unit = f64::from(area.width()) / (rays.pixel_size(distance) * f64::from(size_px.0));
    scale_bar(&painter, area, points_per_unit, world.unit);
}

/// The edges of the box, as far as both of their ends are in front of the eye.
fn outline(painter: &Painter, area: Rect, rays: &ViewRays, (low, high): (DVec3, DVec3)) {
    let corner = |i: usize| DVec3::select(glam::BVec3::new(i & 1 > 0, i & 2 > 0, i & 4 > 0), high, low);
    for (from, axis) in (0..8).flat_map(|from| (0..3).map(move |axis| (from, axis))) {
        let to = from | 1 << axis;
        if to == from {
            continue;
        }
        if let (Some(a), Some(b)) = (place(area, rays, corner(from)), place(area, rays, corner(to))) {
            painter.line_segment([a, b], Stroke::new(1.0, PALE.gamma_multiply(0.35)));
        }
    }
}

/// Where a point of the world is in the window; `None` if it is behind the eye.
fn place(area: Rect, rays: &ViewRays, point: DVec3) -> Option<Pos2> {
    let [x, y] = rays.pixel(point)?;
    let part = vec2((x / f64::from(rays.width)) as f32, (y / f64::from(rays.height)) as f32);
    Some(area.min + part * area.size())
}

/// The directions of the axes, in the lower left corner; the nearest last.
fn axes(painter: &Painter, area: Rect, rays: &ViewRays, is_anatomical: bool) {
    let names = if is_anatomical { ["R", "A", "S"] } else { ["x", "y", "z"] };
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

fn scale_bar(painter: &Painter, area: Rect, points_per_unit: f64, unit: &str) {
    let Some(length) = round_length(MOST_OF_WIDTH * f64::from(area.width()) / points_per_unit) else { return };
    let width = (length * points_per_unit) as f32;
    let right = area.right_bottom() + Vec2::new(-20.0, -18.0);
    let left = right - vec2(width, 0.0);
    painter.line_segment([left, right], Stroke::new(3.0, Color32::BLACK.gamma_multiply(0.6)));
    painter.line_segment([left, right], Stroke::new(2.0, Color32::WHITE));
    let text = format!("{length} {unit}");
    painter.text(
        left.lerp(right, 0.5),
        Align2::CENTER_BOTTOM,
        text.trim_end(),
        FontId::proportional(13.0),
        Color32::WHITE,
    );
}

/// The greatest length of 1, 2 or 5 times a power of ten that is no more than `most`; `None` if there is none.
fn round_length(most: f64) -> Option<f64> {
    let power = 10f64.powf(most.log10().floor());
    let round = [5.0, 2.0, 1.0].into_iter().map(|factor| factor * power).find(|&length| length <= most * (1.0 + 1e-9));
    // Written as users write it: 0.2, not 0.2000000001.
    round.and_then(|length| format!("{length:.3e}").parse().ok()).filter(|length: &f64| length.is_normal())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lengths_are_1_2_or_5() {
        for (most, expected) in
            [(1.0, 1.0), (1.99, 1.0), (2.0, 2.0), (49.0, 20.0), (0.07, 0.05), (9.9e-7, 5e-7), (3e5, 2e5)]
        {
            assert_eq!(round_length(most), Some(expected), "{most}");
        }
        for none in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            assert_eq!(round_length(none), None, "{none}");
        }
    }

    #[test]
    fn places_are_those_of_the_picture() {
        let camera = Camera::looking_at_box((DVec3::ZERO, DVec3::ONE));
        let rays = camera.rays(400, 200).unwrap();
        let area = Rect::from_min_size(pos2(100.0, 50.0), vec2(200.0, 100.0));
        let found = place(area, &rays, camera.target).unwrap();
        assert!((found - pos2(200.0, 100.0)).length() < 1e-3, "{found:?}");
        assert_eq!(place(area, &rays, camera.eye + (camera.eye - camera.target)), None);
    }
}
