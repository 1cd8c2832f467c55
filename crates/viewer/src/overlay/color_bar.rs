//! The colour bar: what value has which colour in the first layer that is shown and has colours for values.

use crate::overlay::Lens;
use crate::overlay::round::{digits, ticks};
use brickyard::session::VolumeSource;
use brickyard::volume::{Scene, TransferFunction};
use eframe::egui::{Align2, Color32, Mesh, Rect, Shape, Stroke, StrokeKind, pos2, vec2};

/// The bar's width and height, in points.
const SIZE: [f32; 2] = [12.0, 160.0];

/// Number of colours along it.
const COLORS: usize = 64;

/// Draws the colour bar of a scene in the upper right corner.
pub(crate) fn show(lens: &Lens, scene: &Scene, volumes: &[VolumeSource]) {
    let shown = (0..scene.layers.len()).filter(|&layer| scene.layers[layer].visible);
    let function = shown.into_iter().find_map(|layer| {
        let volume = volumes.get(scene.store(layer)).filter(|volume| !volume.source.is_labels())?;
        volume.function(&scene.layers[layer]).ok()
    });
    let Some(function) = function else { return };
    let (low, high) = function.span();
    let fits = lens.area.height() > SIZE[1] + 60.0 && lens.area.width() > 420.0;
    if !(fits && low < high) {
        return;
    }
    let corner = lens.area.right_top() + vec2(-SIZE[0] - 14.0, 20.0);
    let bar = Rect::from_min_size(corner, SIZE.into());
    lens.painter.add(Shape::mesh(strip(bar, &function, (low, high))));
    lens.painter.rect_stroke(bar, 0.0, Stroke::new(1.0, Color32::from_black_alpha(160)), StrokeKind::Outside);
    for tick in ticks(low, high, 4.0) {
        let y = bar.bottom() - ((tick - low) / (high - low)) as f32 * bar.height();
        let at = pos2(bar.left() - 3.0, y);
        lens.painter.line_segment([at, at + vec2(3.0, 0.0)], Stroke::new(1.0, Color32::WHITE));
        lens.text(at - vec2(2.0, 0.0), Align2::RIGHT_CENTER, &digits(tick, 6), 11.0, Color32::from_gray(225));
    }
}

/// The function's colours from the least value at the bottom to the greatest at the top.
fn strip(bar: Rect, function: &TransferFunction, (low, high): (f64, f64)) -> Mesh {
    let mut mesh = Mesh::default();
    for i in 0..=COLORS {
        let part = i as f64 / COLORS as f64;
        let [r, g, b] = function.rgb(low + part * (high - low)).map(|c| (255.0 * c.clamp(0.0, 1.0)).round() as u8);
        let y = bar.bottom() - part as f32 * bar.height();
        for x in [bar.left(), bar.right()] {
            mesh.colored_vertex(pos2(x, y), Color32::from_rgb(r, g, b));
        }
        if i > 0 {
            let last = 2 * i as u32;
            mesh.add_triangle(last - 2, last - 1, last);
            mesh.add_triangle(last - 1, last, last + 1);
        }
    }
    mesh
}
