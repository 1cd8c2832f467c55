//! Overlays on pictures: a scale bar, colour bars, the box around all volumes with ticks, a line of text. All but the
//! text follow from the scene, its camera and the volumes. Windows and finished pictures share the drawing through a
//! [`Canvas`](canvas::Canvas); on a picture, each part takes the place where it hides least.

pub mod box_axes;
pub mod canvas;
pub mod color_bar;
mod picture_canvas;
pub mod round;
pub mod scale_bar;

use crate::session::volume_source::VolumeSource;
use brickyard_volume::camera::CameraError;
use brickyard_volume::numbers::within_span;
use brickyard_volume::units::unit_symbol;
use brickyard_volume::{Picture, Scene};
use canvas::{Lens, Pen, settle};
use glam::{DVec3, vec2};
pub use picture_canvas::LEAST_PX;
pub(crate) use picture_canvas::PictureCanvas;
use picture_canvas::first_unknown;

/// Height of the line of text, in points.
const LABEL: f32 = 15.0;

/// The world in view.
#[derive(Clone, Copy, Debug)]
pub struct World<'a> {
    /// Its least and greatest corner.
    pub corners: (DVec3, DVec3),
    /// Whether it is a patient's.
    pub is_anatomical: bool,
    /// The unit of its distances, as [`unit()`] gives it.
    pub unit: &'a str,
    /// The units of its axes; empty where unknown.
    pub axis_units: [&'a str; 3],
}

/// Returns the unit of distances in these volumes' world, as written behind a number: empty if unknown, and `axis units`
/// if the axes have different ones, as distances across them have no meaning. `is_anatomical`: whether the
/// world is a patient's.
pub fn unit(volumes: &[VolumeSource], is_anatomical: bool) -> &str {
    match volumes.first().map(|volume| volume.source.geometry()) {
        _ if is_anatomical => "mm",
        Some(geometry) if geometry.has_unlike_axes() => "axis units",
        Some(geometry) => geometry.axis_unit(0).map_or("", unit_symbol),
        None => "",
    }
}

/// The units of the world's axes; empty where unknown.
pub fn axis_units(volumes: &[VolumeSource], is_anatomical: bool) -> [&str; 3] {
    let first = volumes.first().map(|volume| volume.source.geometry());
    [0, 1, 2].map(|axis| match first {
        _ if is_anatomical => "mm",
        Some(geometry) => geometry.axis_unit(axis).map_or("", unit_symbol),
        None => "",
    })
}

/// A place in words, with the units of the world's axes: `1, 2, 3 mm`, or `1 degree, 2 degree, 3 hPa`. Numbers have the digits that tell places
/// in a box apart.
pub fn place_in_words(place: DVec3, (low, high): (DVec3, DVec3), units: [&str; 3]) -> String {
    let size = high - low;
    if units == [units[0]; 3] {
        let [x, y, z] = place.to_array().map(|at| within_span(at, size.max_element()));
        return format!("{x}, {y}, {z} {}", units[0]).trim_end().into();
    }
    let along = |axis: usize| format!("{} {}", within_span(place[axis], size[axis]), units[axis]);
    [0, 1, 2].map(|axis| along(axis).trim_end().to_owned()).join(", ")
}

/// Returns the names of the axes x, y and z of a world; a patient's point to the right, the front and the head.
pub fn axis_names(is_anatomical: bool) -> [&'static str; 3] {
    if is_anatomical { ["R", "A", "S"] } else { ["x", "y", "z"] }
}

/// Returns the name of a layer: its channel's, else its volume's, else one with its number.
pub fn layer_name(scene: &Scene, volumes: &[VolumeSource], layer: usize) -> String {
    let volume = volumes.get(scene.store(layer));
    let channel = volume.and_then(|volume| volume.displays().get(scene.layers[layer].channel as usize));
    let channel = channel.and_then(|display| display.name.clone()).filter(|name| !name.is_empty());
    channel.or_else(|| volume?.name()).unwrap_or_else(|| format!("layer {layer}"))
}

/// Shortens a name to at most `most` characters by omitting its middle, since similar names often differ at their ends.
pub fn short_name(name: &str, most: usize) -> String {
    let count = name.chars().count();
    if count <= most {
        return name.into();
    }
    let end = most.saturating_sub(1) / 2;
    let start = name.chars().take(most.saturating_sub(1) - end);
    start.chain(['\u{2026}']).chain(name.chars().skip(count - end)).collect()
}

/// Choice of overlays.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Overlays {
    /// A scale bar.
    pub scale_bar: bool,
    /// Colour bars: colours by value.
    pub color_bar: bool,
    /// The box around all volumes, with ticks.
    pub axes: bool,
    /// A line of text.
    pub label: Option<String>,
}

/// Errors in drawing overlays.
#[derive(Debug, thiserror::Error, PartialEq)]
pub enum OverlayError {
    /// The picture is too small for letters.
    #[error("a picture of {width}x{height} is too small to write on: {LEAST_PX}x{LEAST_PX} pixels are enough")]
    TooSmall {
        /// Width of the picture in pixels.
        width: u32,
        /// Height of the picture in pixels.
        height: u32,
    },
    /// The text has a character missing in the fonts.
    #[error("the program's fonts (Latin, Greek and Cyrillic) have no letter for '{0}': leave it out")]
    Letter(char),
    /// Overlays are valid for one eye alone.
    #[error("scale bar, colour bar, axes and label are for pictures of one eye: leave them or stereo out")]
    Stereo,
    /// The camera is invalid.
    #[error(transparent)]
    Camera(#[from] CameraError),
}

impl Overlays {
    /// Whether there is nothing to draw.
    pub fn is_empty(&self) -> bool {
        *self == Self::default()
    }

    /// Checks whether these can be drawn on a scene's picture of this size.
    ///
    /// # Errors
    /// If not, with the reason.
    pub fn check(&self, scene: &Scene, (width, height): (u32, u32)) -> Result<(), OverlayError> {
        let unknown = self.label.as_deref().and_then(first_unknown);
        match unknown {
            _ if self.is_empty() => Ok(()),
            _ if width.min(height) < LEAST_PX => Err(OverlayError::TooSmall { width, height }),
            _ if scene.stereo.is_some() => Err(OverlayError::Stereo),
            Some(letter) => Err(OverlayError::Letter(letter)),
            None => Ok(()),
        }
    }

    /// Draws these on the picture of a scene with a camera, such as a [shown](crate::session::ResolvedScene::shown)
    /// one.
    ///
    /// # Errors
    /// The errors of [`Overlays::check`], and an error if the camera is invalid. The picture is then unchanged.
    pub fn draw(&self, picture: &mut Picture, scene: &Scene, volumes: &[VolumeSource]) -> Result<(), OverlayError> {
        let size_px = (picture.width, picture.height);
        self.check(scene, size_px)?;
        let Some(camera) = scene.camera.filter(|_| !self.is_empty()) else { return Ok(()) };
        let rays = camera.rays(size_px.0, size_px.1)?;
        let places: Vec<_> = volumes.iter().map(VolumeSource::place).collect();
        let is_anatomical = scene.is_anatomical(&places);
        let unit = unit(volumes, is_anatomical);
        let mut canvas = PictureCanvas::new(picture, scene.background);
        let mut taken = Vec::new();
        let mut lens = Lens { canvas: &mut canvas, rays };
        if let Some(corners) = scene.world_box(&places).ok().filter(|_| self.axes) {
            let world = World { corners, is_anatomical, unit, axis_units: axis_units(volumes, is_anatomical) };
            box_axes::draw_edges(&mut lens, &world);
            box_axes::draw_ticks(&mut lens, &world, &mut taken);
        }
        if self.color_bar {
            color_bar::draw(lens.canvas, &color_bar::bars(scene, volumes), &mut taken);
        }
        if self.scale_bar {
            scale_bar::draw(&mut lens, &camera, unit, &mut taken);
        }
        if let Some(label) = &self.label {
            let all = lens.canvas.size();
            let size = vec2(lens.canvas.text_width(label, LABEL), LABEL);
            let (far, middle) = (all - size - 14.0, (all.x - size.x) / 2.0);
            let corners = [14.0, far.y].into_iter().flat_map(|y| [14.0, middle, far.x].map(|x| vec2(x, y)));
            if let Some(area) = settle(lens.canvas, size, &corners.collect::<Vec<_>>(), &mut taken) {
                lens.canvas.text(area.min, vec2(0.0, 0.0), label, LABEL, Pen::Strong);
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests;
