//! Colour bars: colours by value, for the visible layers with colours for values, or for the expression over them, with
//! the name above. Layers with the same colours over the same values share a bar.

use super::canvas::{Area, Canvas, Pen, settle};
use super::round::ticks;
use super::{layer_name, short_name};
use crate::session::resolve::expression_look;
use crate::session::volume_source::VolumeSource;
use brickyard_volume::numbers::within_span;
use brickyard_volume::units::name_in_unit;
use brickyard_volume::{Mode, Scene, TransferFunction};
use glam::{Vec2, vec2};

/// A bar's width, its usual height, and its least height in low pictures, in points.
const WIDTH: f32 = 12.0;
const HEIGHT: f32 = 160.0;
const LEAST_HEIGHT: f32 = 60.0;

/// Greatest share of the picture's height for a bar with its name.
const MOST_OF_HEIGHT: f32 = 0.5;

/// Number of colours along it.
const COLORS: usize = 64;

/// Space to the right of a bar, in points.
const GAP: f32 = 14.0;

/// Height of names and of ticks, in points.
const TEXT: f32 = 11.0;

/// Height of a name with the space below it, in points.
const HEAD: f32 = TEXT + 8.0;

/// Distance between a name and its bar, in points.
const NAME_ABOVE: f32 = 7.0;

/// The most characters of a name.
const LONGEST: usize = 16;

/// Greatest share of the picture's width for bars, except the first, which is always there.
const MOST_OF_WIDTH: f32 = 0.4;

/// The bar of a layer, and of others with the same colours.
pub struct Bar {
    name: String,
    /// Number of the other layers.
    others: usize,
    /// Unit of the values, if known.
    unit: Option<String>,
    pub(super) function: TransferFunction,
    /// Round values with their text.
    pub(super) ticks: Vec<(f64, String)>,
}

/// Returns the bars of the visible layers, in the order of each bar's first layer, or of the expression over them, each
/// of the drawn function. Labels have none, nor have surfaces with a colour of their own.
pub fn bars(scene: &Scene, volumes: &[VolumeSource]) -> Vec<Bar> {
    if let Some(expression) = &scene.expression {
        let has_all = (0..scene.layers.len()).all(|layer| scene.store(layer) < volumes.len());
        let look = has_all.then(|| expression_look(volumes, scene).ok().flatten()).flatten();
        return look.and_then(|(_, function)| Bar::new(&expression.text, None, function)).into_iter().collect();
    }
    let shown = (0..scene.layers.len()).filter(|&layer| scene.layers[layer].visible);
    let bar = |layer: usize| {
        let volume = volumes.get(scene.store(layer)).filter(|volume| !volume.source.is_labels())?;
        let surfaces = &scene.layers[layer].isosurfaces;
        if scene.mode == Mode::Isosurface && surfaces.iter().all(|surface| surface.color.is_some()) {
            return None;
        }
        let unit = volume.value_unit(scene.layers[layer].channel);
        Bar::new(&layer_name(scene, volumes, layer), unit, volume.function(&scene.look(layer)).ok()?)
    };
    let mut bars: Vec<Bar> = Vec::new();
    for bar in shown.filter_map(bar) {
        match bars.iter_mut().find(|other| other.is_like(&bar)) {
            Some(other) => other.others += 1,
            None => bars.push(bar),
        }
    }
    bars
}

/// Draws colour bars side by side, the first one at the right, where they hide least, and the number of bars left out
/// for lack of room.
pub fn draw(canvas: &mut dyn Canvas, bars: &[Bar], taken: &mut Vec<Area>) {
    let all = canvas.size();
    let height = HEIGHT.min(MOST_OF_HEIGHT * all.y - HEAD);
    let (mut widths, mut width) = (Vec::new(), 0.0);
    for bar in bars {
        let more = bar.width(canvas);
        if widths.is_empty() || width + more < MOST_OF_WIDTH * all.x {
            widths.push(more);
            width += more;
        }
    }
    let left_out = bars.len() - widths.len();
    let note = format!("+{left_out} more");
    if left_out > 0 {
        width += GAP + canvas.text_width(&note, TEXT);
    }
    if height < LEAST_HEIGHT || width > all.x || widths.is_empty() {
        return;
    }
    let size = vec2(width, HEAD + height + TEXT / 2.0);
    let far = all - size - vec2(0.0, 8.0);
    let (right, top, middle) = (far.x, 8.0, (all.y - size.y) / 2.0);
    let corners = [right, 0.0].into_iter().flat_map(|x| [top, far.y, middle].map(|y| vec2(x, y)));
    let Some(area) = settle(canvas, size, &corners.collect::<Vec<_>>(), taken) else { return };
    let mut right = area.max.x;
    for (bar, width) in bars.iter().zip(widths) {
        bar.draw(canvas, vec2(right - WIDTH - GAP, area.min.y + HEAD), height);
        right -= width;
    }
    if left_out > 0 {
        canvas.text(vec2(right - GAP, area.min.y + HEAD - NAME_ABOVE), vec2(1.0, 1.0), &note, TEXT, Pen::Pale);
    }
}

impl Bar {
    /// Creates the bar of a function; `None` if it has a single value.
    fn new(name: &str, unit: Option<&str>, function: TransferFunction) -> Option<Self> {
        let (low, high) = function.span();
        let ticks = ticks(low, high, 4.0).into_iter().map(|tick| (tick, within_span(tick, high - low))).collect();
        (low < high).then_some(Self {
            name: short_name(name, LONGEST),
            unit: unit.map(|unit| short_name(unit, LONGEST)),
            others: 0,
            function,
            ticks,
        })
    }

    fn is_like(&self, other: &Self) -> bool {
        self.unit == other.unit
            && self.function.color == other.function.color
            && self.function.span() == other.function.span()
    }

    pub(super) fn title(&self) -> String {
        let name = if self.others == 0 { self.name.clone() } else { format!("{} +{}", self.name, self.others) };
        name_in_unit(&name, self.unit.as_deref())
    }

    /// The width of the bar with its texts, in points.
    fn width(&self, canvas: &dyn Canvas) -> f32 {
        let ticks = self.ticks.iter().map(|(_, text)| canvas.text_width(text, TEXT)).fold(0.0, f32::max);
        GAP + (WIDTH + 5.0 + ticks).max(canvas.text_width(&self.title(), TEXT))
    }

    /// Draws the bar with this upper left corner, and its name above.
    fn draw(&self, canvas: &mut dyn Canvas, corner: Vec2, height: f32) {
        let (low, high) = self.function.span();
        let bar = Area::new(corner, vec2(WIDTH, height));
        let color = |i: usize| {
            let value = low + (i as f64 + 0.5) / COLORS as f64 * (high - low);
            self.function.rgb(value).map(|c| (255.0 * c.clamp(0.0, 1.0)).round() as u8)
        };
        canvas.bands(bar, &(0..COLORS).map(color).collect::<Vec<_>>());
        canvas.text(vec2(bar.max.x, bar.min.y - NAME_ABOVE), vec2(1.0, 1.0), &self.title(), TEXT, Pen::Pale);
        for (tick, text) in &self.ticks {
            let at = vec2(bar.min.x - 3.0, bar.max.y - ((tick - low) / (high - low)) as f32 * height);
            canvas.line([at, at + vec2(3.0, 0.0)], 1.0, Pen::Pale, false);
            canvas.text(at - vec2(2.0, 0.0), vec2(1.0, 0.5), text, TEXT, Pen::Pale);
        }
    }
}
