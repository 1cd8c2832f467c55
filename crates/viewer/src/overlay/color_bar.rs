//! Colour bars: what value has which colour, for each layer that is shown and has colours for values, with its name above.

use crate::overlay::Lens;
use crate::overlay::round::ticks;
use crate::panels::layers::name;
use brickyard::session::VolumeSource;
use brickyard::volume::numbers::within_span;
use brickyard::volume::{Scene, TransferFunction};
use eframe::egui::{Align2, Color32, FontId, Mesh, Painter, Rect, Shape, Stroke, StrokeKind, pos2, vec2};

/// A bar's width and height, in points.
const SIZE: [f32; 2] = [12.0, 160.0];

/// Number of colours along it.
const COLORS: usize = 64;

/// Space to the right of a bar, in points.
const GAP: f32 = 14.0;

/// Height of names and of ticks, in points.
const TEXT: f32 = 11.0;

/// The most characters of a name.
const LONGEST: usize = 16;

/// The part of the picture's width that bars take at most, but for the first, which is always there.
const MOST_OF_WIDTH: f32 = 0.4;

/// A layer's bar.
struct Bar {
    name: String,
    function: TransferFunction,
    /// Round values, and how they are written.
    ticks: Vec<(f64, String)>,
}

/// Draws the colour bars of a scene from the upper right corner on, the first layer's first.
pub(crate) fn show(lens: &Lens, scene: &Scene, volumes: &[VolumeSource]) {
    if !(lens.area.height() > SIZE[1] + 60.0 && lens.area.width() > 420.0) {
        return;
    }
    let mut right = lens.area.right();
    for bar in bars(scene, volumes) {
        let left = right - bar.width(&lens.painter);
        if left < lens.area.right() - MOST_OF_WIDTH * lens.area.width() && right < lens.area.right() {
            return;
        }
        bar.draw(lens, right);
        right = left;
    }
}

/// The bars of the layers that are shown, in their order.
fn bars(scene: &Scene, volumes: &[VolumeSource]) -> Vec<Bar> {
    let shown = (0..scene.layers.len()).filter(|&layer| scene.layers[layer].visible);
    let bar = |layer: usize| {
        let volume = volumes.get(scene.store(layer)).filter(|volume| !volume.source.is_labels())?;
        let function = volume.function(&scene.look(layer)).ok()?;
        let (low, high) = function.span();
        let ticks = ticks(low, high, 4.0).into_iter().map(|tick| (tick, within_span(tick, high - low))).collect();
        let name = name(scene, volumes, layer);
        let short = name.chars().take(LONGEST - 1).collect::<String>() + "\u{2026}";
        let name = if name.chars().count() > LONGEST { short } else { name };
        (low < high).then_some(Bar { name, function, ticks })
    };
    shown.filter_map(bar).collect()
}

impl Bar {
    /// The width that the bar takes with its texts, in points.
    fn width(&self, painter: &Painter) -> f32 {
        let width =
            |text: &str| painter.layout_no_wrap(text.into(), FontId::proportional(TEXT), Color32::WHITE).size().x;
        let ticks = self.ticks.iter().map(|(_, text)| width(text)).fold(0.0, f32::max);
        GAP + (SIZE[0] + 5.0 + ticks).max(width(&self.name))
    }

    /// Draws the bar to the left of a place.
    fn draw(&self, lens: &Lens, right: f32) {
        let (low, high) = self.function.span();
        let corner = pos2(right - SIZE[0] - GAP, lens.area.top() + 28.0);
        let bar = Rect::from_min_size(corner, SIZE.into());
        lens.painter.add(Shape::mesh(strip(bar, &self.function, (low, high))));
        lens.painter.rect_stroke(bar, 0.0, Stroke::new(1.0, Color32::from_black_alpha(160)), StrokeKind::Outside);
        let (pale, above) = (Color32::from_gray(225), bar.right_top() - vec2(0.0, 7.0));
        lens.text(above, Align2::RIGHT_BOTTOM, &self.name, TEXT, pale);
        for (tick, text) in &self.ticks {
            let y = bar.bottom() - ((tick - low) / (high - low)) as f32 * bar.height();
            let at = pos2(bar.left() - 3.0, y);
            lens.painter.line_segment([at, at + vec2(3.0, 0.0)], Stroke::new(1.0, Color32::WHITE));
            lens.text(at - vec2(2.0, 0.0), Align2::RIGHT_CENTER, text, TEXT, pale);
        }
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::panels::fixture;
    use brickyard::volume::SceneLayer;

    #[test]
    fn each_layer_has_a_bar_whose_ticks_differ() {
        for (offset, scale) in [(0.0, 255.0), (1e9, 2000.0), (-1e12, 8.0), (0.0, 1e-6), (3e-5, 1e-9)] {
            let window = Some([offset - scale, offset + scale]);
            let layer = |channel| SceneLayer { source: Some(0), channel, window, ..SceneLayer::default() };
            let hidden = SceneLayer { visible: false, ..layer(0) };
            let of_labels = SceneLayer { source: Some(1), ..SceneLayer::default() };
            let scene = Scene { layers: vec![layer(0), hidden, layer(1), of_labels], ..Scene::default() };
            let bars = bars(&scene, &fixture::volumes());
            assert_eq!(bars.len(), 2);
            let mut texts: Vec<_> = bars[0].ticks.iter().map(|(_, text)| text).collect();
            assert!(texts.len() > 2, "{texts:?}");
            texts.dedup();
            assert_eq!(texts.len(), bars[0].ticks.len(), "{texts:?}");
        }
    }
}
