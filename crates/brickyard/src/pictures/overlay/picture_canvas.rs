//! A finished picture as a canvas. Lines and letters are drawn by coverage, with a rim that sets them off from the
//! picture; costs the pixels of the rectangles around them.

use super::canvas::{AXIS_COLORS, Area, Canvas, Pen};
use ab_glyph::{Font, FontRef, Glyph, PxScale, ScaleFont, point};
use brickyard_volume::Picture;
use epaint_default_fonts::{HACK_REGULAR, UBUNTU_LIGHT};
use glam::{IVec2, Vec2, vec2};
use std::sync::LazyLock;

/// Least width and height in pixels of a picture with letters: in a smaller one they would hide too much.
pub const LEAST_PX: u32 = 96;

/// Lesser of a picture's width and height, in points: letters keep their relative size in large pictures.
const POINTS: f32 = 400.0;

/// The least pixels of a point, for legible letters.
const LEAST_SCALE: f32 = 0.85;

/// The fonts, each a fallback for those before it.
static FONTS: LazyLock<[FontRef<'static>; 2]> = LazyLock::new(|| {
    [UBUNTU_LIGHT, HACK_REGULAR].map(|font| FontRef::try_from_slice(font).expect("the fonts come with the program"))
});

/// Returns the first character of a text missing in all fonts.
pub(crate) fn first_unknown(text: &str) -> Option<char> {
    text.chars().find(|&letter| FONTS.iter().all(|font| font.glyph_id(letter).0 == 0))
}

/// Returns the font for a text: the first with all of its characters.
fn font_of(text: &str) -> &'static FontRef<'static> {
    let has_all = |font: &&FontRef<'_>| text.chars().all(|letter| font.glyph_id(letter).0 != 0);
    FONTS.iter().find(has_all).unwrap_or(&FONTS[1])
}

/// Codes from the background on that hide a line behind them. The picture has no transparency, but haze around a body,
/// present in most volumes, is fainter than this; a line fades out towards it.
const HAZE: f32 = 16.0;

/// A picture to draw on.
pub(crate) struct PictureCanvas<'a> {
    picture: &'a mut Picture,
    /// Distance of each pixel from the background before any drawing, in codes of its farthest colour; 0 where no
    /// volume was visible.
    shown: Vec<u8>,
    pixels_per_point: f32,
    is_light: bool,
}

impl<'a> PictureCanvas<'a> {
    pub(crate) fn new(picture: &'a mut Picture, background: [f64; 3]) -> Self {
        let behind = Picture::quantise(background.map(|c| c as f32));
        let farthest = |pixel: &[u8; 3]| pixel.iter().zip(behind).map(|(a, b)| a.abs_diff(b)).fold(0, u8::max);
        let shown = picture.rgb.iter().map(farthest).collect();
        let pixels_per_point = (picture.width.min(picture.height) as f32 / POINTS).max(LEAST_SCALE);
        let luminance = 0.2126 * background[0] + 0.7152 * background[1] + 0.0722 * background[2];
        Self { picture, shown, pixels_per_point, is_light: luminance > 0.5 }
    }

    /// Returns a pen's colour, and its rim's.
    fn colors(&self, pen: Pen) -> ([f32; 3], [f32; 3]) {
        let axes = AXIS_COLORS.map(|color| color.map(f32::from));
        let color = match (pen, self.is_light) {
            (Pen::Strong, false) => [255.0; 3],
            (Pen::Strong, true) => [0.0; 3],
            (Pen::Pale, false) => [215.0; 3],
            (Pen::Pale, true) => [50.0; 3],
            (Pen::Faint, _) => [128.0; 3],
            (Pen::Axis(axis), false) => axes[axis],
            (Pen::Axis(axis), true) => axes[axis].map(|c| c * 0.65),
        };
        (color, if self.is_light { [255.0; 3] } else { [0.0; 3] })
    }

    /// Returns the rows and columns of an area in pixels, within the picture.
    fn pixels(&self, area: &Area) -> (std::ops::Range<u32>, std::ops::Range<u32>) {
        // Casts of floats saturate.
        let within = |low: f32, high: f32, count: u32| {
            ((low * self.pixels_per_point).floor() as u32).min(count)
                ..((high * self.pixels_per_point).ceil() as u32).min(count)
        };
        (within(area.min.y, area.max.y, self.picture.height), within(area.min.x, area.max.x, self.picture.width))
    }
}

impl Canvas for PictureCanvas<'_> {
    fn size(&self) -> Vec2 {
        vec2(self.picture.width as f32, self.picture.height as f32) / self.pixels_per_point
    }

    fn line(&mut self, ends: [Vec2; 2], width: f32, pen: Pen, is_behind: bool) {
        let [from, to] = ends.map(|end| end * self.pixels_per_point);
        let half = (width * self.pixels_per_point / 2.0).max(0.5);
        let Some([from, to]) = in_picture([from, to], vec2(self.picture.width as f32, self.picture.height as f32))
        else {
            return;
        };
        let mut ink = Ink::new(from.min(to) - half, from.max(to) + half);
        let (along, length) = ((to - from).normalize_or_zero(), from.distance(to));
        ink.fill(|centre| {
            let by = centre - from;
            let (ahead, aside) = (by.dot(along), by.perp_dot(along).abs());
            let beyond = (-ahead).max(ahead - length).max(0.0);
            (half + 0.5 - aside).clamp(0.0, 1.0) * (1.0 - beyond).clamp(0.0, 1.0)
        });
        // Lines of the box are thin and long: a rim would be most of them.
        let rim_px = if pen == Pen::Strong { (self.pixels_per_point).round() as i32 } else { 0 };
        self.put(&ink, pen, rim_px, is_behind);
    }

    fn text(&mut self, place: Vec2, anchor: Vec2, text: &str, height: f32, pen: Pen) {
        let font = font_of(text);
        let scaled = font.as_scaled(PxScale::from(height * self.pixels_per_point));
        let size_px = vec2(self.text_width(text, height) * self.pixels_per_point, scaled.ascent() - scaled.descent());
        let corner = place * self.pixels_per_point - anchor * size_px;
        let mut ink = Ink::new(corner - 1.0, corner + size_px + 1.0);
        let mut left = corner.x;
        for letter in text.chars() {
            let glyph = scaled.scaled_glyph(letter);
            let at = point(left, corner.y + scaled.ascent());
            left += scaled.h_advance(glyph.id);
            let Some(outline) = font.outline_glyph(Glyph { position: at, ..glyph }) else { continue };
            let bounds = outline.px_bounds().min;
            outline.draw(|x, y, coverage| {
                ink.add(IVec2::new(bounds.x as i32 + x as i32, bounds.y as i32 + y as i32), coverage)
            });
        }
        self.put(&ink, pen, (height * self.pixels_per_point / 12.0).round().max(1.0) as i32, false);
    }

    fn text_width(&self, text: &str, height: f32) -> f32 {
        let font = font_of(text);
        let scaled = font.as_scaled(PxScale::from(height * self.pixels_per_point));
        text.chars().map(|letter| scaled.h_advance(font.glyph_id(letter))).sum::<f32>() / self.pixels_per_point
    }

    fn bands(&mut self, area: Area, colors: &[[u8; 3]]) {
        let (rows, columns) = self.pixels(&area);
        let (first, last) = (rows.start, rows.end.saturating_sub(1));
        for y in rows.clone() {
            let part = (rows.end - 1 - y) as usize * colors.len() / rows.len();
            for x in columns.clone() {
                let is_frame = y == first || y == last || x == columns.start || x + 1 == columns.end;
                let color = if is_frame { [0; 3] } else { colors[part] };
                self.picture.rgb[(y * self.picture.width + x) as usize] = color;
            }
        }
    }

    fn hidden(&self, area: &Area) -> usize {
        let (rows, columns) = self.pixels(area);
        let row = |y: u32| (y * self.picture.width) as usize;
        let shown = |y: u32| &self.shown[row(y) + columns.start as usize..row(y) + columns.end as usize];
        rows.map(|y| shown(y).iter().filter(|codes| **codes > 0).count()).sum()
    }
}

impl PictureCanvas<'_> {
    /// Puts ink on the picture, with a rim of `rim_px`. With `is_behind`, the volumes hide the ink, and haze fades it.
    fn put(&mut self, ink: &Ink, pen: Pen, rim_px: i32, is_behind: bool) {
        let (color, rim_color) = self.colors(pen);
        let (width, height) = (self.picture.width as i32, self.picture.height as i32);
        let rim = ink.rim(rim_px);
        for place in rim.places() {
            if !(0..width).contains(&place.x) || !(0..height).contains(&place.y) {
                continue;
            }
            let pixel = (place.y * width + place.x) as usize;
            let passed = if is_behind { 1.0 - (f32::from(self.shown[pixel]) / HAZE).min(1.0) } else { 1.0 };
            let (around, covered) = (0.75 * passed * rim.coverage_at(place), passed * ink.coverage_at(place));
            let below = &mut self.picture.rgb[pixel];
            *below = std::array::from_fn(|i| {
                let rimmed = f32::from(below[i]) + (rim_color[i] - f32::from(below[i])) * around;
                (rimmed + (color[i] - rimmed) * covered).round() as u8
            });
        }
    }
}

/// Clips a line to the picture and a little around it; `None` if nothing is left. Ends may be far away.
fn in_picture([from, to]: [Vec2; 2], size_px: Vec2) -> Option<[Vec2; 2]> {
    const BESIDE: f32 = 16.0;
    let (mut start, mut end) = (0.0f32, 1.0f32);
    for axis in 0..2 {
        let (at, by) = (from[axis], to[axis] - from[axis]);
        let [a, b] = [-BESIDE, size_px[axis] + BESIDE].map(|edge| (edge - at) / by);
        if by == 0.0 {
            let is_inside = (-BESIDE..=size_px[axis] + BESIDE).contains(&at);
            end = if is_inside { end } else { -1.0 };
        } else {
            (start, end) = (start.max(a.min(b)), end.min(a.max(b)));
        }
    }
    (start <= end).then(|| [from.lerp(to, start), from.lerp(to, end)])
}

/// Coverage of each pixel of a rectangle, 0 to 1.
struct Ink {
    min: IVec2,
    size: IVec2,
    coverage: Vec<f32>,
}

impl Ink {
    fn new(low: Vec2, high: Vec2) -> Self {
        let min = low.floor().as_ivec2();
        Self::of(min, (high.ceil().as_ivec2() - min).max(IVec2::ZERO))
    }

    fn of(min: IVec2, size: IVec2) -> Self {
        Self { min, size, coverage: vec![0.0; (size.x * size.y) as usize] }
    }

    fn places(&self) -> impl Iterator<Item = IVec2> + use<> {
        let (min, size) = (self.min, self.size);
        (0..size.y).flat_map(move |y| (0..size.x).map(move |x| min + IVec2::new(x, y)))
    }

    fn index(&self, place: IVec2) -> Option<usize> {
        let at = place - self.min;
        let is_inside = at.cmpge(IVec2::ZERO).all() && at.cmplt(self.size).all();
        is_inside.then(|| (at.y * self.size.x + at.x) as usize)
    }

    fn coverage_at(&self, place: IVec2) -> f32 {
        self.index(place).map_or(0.0, |i| self.coverage[i])
    }

    fn add(&mut self, place: IVec2, coverage: f32) {
        if let Some(i) = self.index(place) {
            self.coverage[i] = self.coverage[i].max(coverage.min(1.0));
        }
    }

    fn fill(&mut self, coverage: impl Fn(Vec2) -> f32) {
        for place in self.places() {
            self.add(place, coverage(place.as_vec2() + 0.5));
        }
    }

    /// Dilates this ink by `rim_px`.
    fn rim(&self, rim_px: i32) -> Self {
        let mut rim = Self::of(self.min - rim_px, self.size + 2 * rim_px);
        for place in self.places().filter(|place| self.coverage_at(*place) > 0.0) {
            for (dx, dy) in (-rim_px..=rim_px).flat_map(|dy| (-rim_px..=rim_px).map(move |dx| (dx, dy))) {
                rim.add(place + IVec2::new(dx, dy), self.coverage_at(place));
            }
        }
        rim
    }
}
