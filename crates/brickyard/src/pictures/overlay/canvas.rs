//! Canvases for overlays: a window's painter or a finished picture. Places are in points from the upper left corner.

use brickyard_volume::ViewRays;
use glam::{DVec3, Vec2};

/// A rectangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Area {
    /// The upper left corner.
    pub min: Vec2,
    /// The lower right corner.
    pub max: Vec2,
}

impl Area {
    /// Creates the rectangle with this upper left corner and this size.
    pub fn new(min: Vec2, size: Vec2) -> Self {
        Self { min, max: min + size }
    }

    /// Whether the rectangles overlap.
    pub fn meets(&self, other: &Self) -> bool {
        self.min.cmplt(other.max).all() && other.min.cmplt(self.max).all()
    }
}

/// A pen for lines and texts, by purpose. The canvas chooses a colour visible on its background.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pen {
    /// The pen for bars and labels, which are read first.
    Strong,
    /// The pen for numbers and names beside bars and axes.
    Pale,
    /// The pen for edges, which the eye may pass over.
    Faint,
    /// The pen for the ticks and the name of the axis x, y or z, by its number.
    Axis(usize),
}

/// The colours of the axes x, y and z on dark backgrounds, as in other programs.
pub const AXIS_COLORS: [[u8; 3]; 3] = [[235, 85, 85], [95, 200, 95], [95, 145, 245]];

/// A surface for overlays.
pub trait Canvas {
    /// Width and height in points.
    fn size(&self) -> Vec2;

    /// Draws a straight line of this width. With `is_behind`, the volumes hide it.
    fn line(&mut self, ends: [Vec2; 2], width: f32, pen: Pen, is_behind: bool);

    /// Writes a line of text of this height. `anchor` is the part of the text at `place`: 0 is its left or upper end, 1
    /// its right or lower one.
    fn text(&mut self, place: Vec2, anchor: Vec2, text: &str, height: f32, pen: Pen);

    /// The width of a line of text of this height.
    fn text_width(&self, text: &str, height: f32) -> f32;

    /// Fills a rectangle with bands of colours, the first one lowest, and frames it.
    fn bands(&mut self, area: Area, colors: &[[u8; 3]]);

    /// Amount of picture content hidden by this rectangle. None in a window, where the user can look elsewhere.
    fn hidden(&self, _area: &Area) -> usize {
        0
    }
}

/// The canvas of a camera's picture, with the projection from the world.
pub struct Lens<'a> {
    /// The canvas, filled by the picture.
    pub canvas: &'a mut dyn Canvas,
    /// The rays of the picture's pixels.
    pub rays: ViewRays,
}

impl Lens<'_> {
    /// Projects a point of the world to the canvas; `None` if it is behind the eye.
    pub fn place(&self, point: DVec3) -> Option<Vec2> {
        let [x, y] = self.rays.pixel(point)?;
        let part = Vec2::new((x / f64::from(self.rays.width)) as f32, (y / f64::from(self.rays.height)) as f32);
        Some(part * self.canvas.size())
    }

    /// Points on the canvas per unit of the world at this distance from the eye.
    pub fn points_per_unit(&self, distance: f64) -> f64 {
        f64::from(self.canvas.size().x) / (self.rays.pixel_size(distance) * f64::from(self.rays.width))
    }
}

/// Takes the place in which something of this size hides least, from a list of upper left corners, the best first.
/// Avoids the places in `taken` if possible, and adds the new one.
pub fn settle(canvas: &dyn Canvas, size: Vec2, corners: &[Vec2], taken: &mut Vec<Area>) -> Option<Area> {
    let cost = |area: &Area| (taken.iter().filter(|other| other.meets(area)).count(), canvas.hidden(area));
    // Of equal ones the first.
    let best = corners.iter().map(|corner| Area::new(*corner, size)).min_by_key(cost)?;
    taken.push(best);
    Some(best)
}
