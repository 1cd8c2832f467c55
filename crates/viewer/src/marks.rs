//! Marks over a saved picture: the window's overlays in the picture's own resolution. The window's own code makes the shapes and the CPU draws them,
//! so this needs no device. Costs the covered pixels.

use crate::overlay::{self, Lens};
use crate::paint;
use crate::state::{Overlays, WindowState};
use brickyard::overlay::{World, axis_units, unit};
use brickyard::session::VolumeSource;
use brickyard::volume::{Picture, Scene};
use eframe::egui::{Context, RawInput, Rect, ViewportId, pos2, vec2};
use glam::DVec3;
use std::fmt;
use std::str::FromStr;

/// The choice of marks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Marks {
    overlays: Overlays,
    distances: bool,
}

impl Marks {
    pub(crate) const NONE: Self = Self { overlays: Overlays::NONE, distances: false };

    /// The marks shown by a window.
    pub(crate) fn shown(window: &WindowState) -> Self {
        // Handles and bricks belong to the window's work, not to the picture.
        let overlays = Overlays { clip_handles: false, bricks: false, ..window.overlays };
        Self { overlays, distances: true }
    }

    /// All marks: the name of each in commands and for users, and whether it is drawn.
    pub(crate) fn each(&mut self) -> [(&'static str, &'static str, &mut bool); 7] {
        let Self { overlays, distances } = self;
        [
            ("outline", "box", &mut overlays.outline),
            ("ticks", "ticks", &mut overlays.ticks),
            ("axes", "axes", &mut overlays.axes),
            ("scale_bar", "scale bar", &mut overlays.scale_bar),
            ("color_bar", "colour bar", &mut overlays.color_bar),
            ("letters", "letters", &mut overlays.letters),
            ("distances", "distances", distances),
        ]
    }
}

impl fmt::Display for Marks {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut marks = *self;
        let names: Vec<_> =
            marks.each().into_iter().filter(|(.., is_drawn)| **is_drawn).map(|(name, ..)| name).collect();
        f.write_str(&if names.is_empty() { "none".into() } else { names.join(",") })
    }
}

impl FromStr for Marks {
    type Err = ();

    fn from_str(text: &str) -> Result<Self, ()> {
        let mut marks = Self::NONE;
        for word in text.split(',').filter(|_| text != "none") {
            let (.., is_drawn) = marks.each().into_iter().find(|(name, ..)| *name == word).ok_or(())?;
            *is_drawn = true;
        }
        Ok(marks)
    }
}

/// The marks of a picture, and their subjects.
#[derive(Clone, Debug)]
pub(crate) struct Over {
    pub(crate) marks: Marks,
    pub(crate) distances: Vec<[DVec3; 2]>,
}

/// Pixels per point of a picture, where `shown_px` pixels in the window have `scale`: marks keep their relative size, but stay legible.
pub(crate) fn pixels_per_point(size_px: (u32, u32), shown_px: (u32, u32), scale: f32) -> f32 {
    let ratio = |of: u32, shown: u32| of as f32 / shown.max(1) as f32;
    (scale * ratio(size_px.0, shown_px.0).min(ratio(size_px.1, shown_px.1))).max(1.0)
}

/// Draws marks over a scene's picture. Stereo pictures have none: marks hold for one eye.
pub(crate) fn draw(picture: &mut Picture, scene: &Scene, volumes: &[VolumeSource], over: &Over, pixels_per_point: f32) {
    let Some(camera) = scene.camera.filter(|_| scene.stereo.is_none()) else { return };
    let places: Vec<_> = volumes.iter().map(VolumeSource::place).collect();
    let Ok(corners) = scene.world_box(&places) else { return };
    let is_anatomical = scene.is_anatomical(&places);
    let world = World {
        corners,
        is_anatomical,
        unit: unit(volumes, is_anatomical),
        axis_units: axis_units(volumes, is_anatomical),
    };
    let size_px = (picture.width, picture.height);
    let area = Rect::from_min_size(pos2(0.0, 0.0), vec2(size_px.0 as f32, size_px.1 as f32) / pixels_per_point);
    let mut input = RawInput { screen_rect: Some(area), ..RawInput::default() };
    input.viewports.entry(ViewportId::ROOT).or_default().native_pixels_per_point = Some(pixels_per_point);
    let context = Context::default();
    let mut shown = context.run_ui(input, |ui| {
        let Some(lens) = Lens::new(ui.painter(), area, &camera, size_px) else { return };
        overlay::show(&lens, &over.marks.overlays, scene, &camera, volumes, &world);
        if over.marks.distances {
            overlay::distances(&lens, &over.distances, world.unit);
        }
    });
    let shapes = context.tessellate(shown.shapes, shown.pixels_per_point);
    paint::put(picture, &shapes, &shown.textures_delta, shown.pixels_per_point);
    // egui insists on it.
    shown.textures_delta.clear();
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::panels::fixture;
    use brickyard::volume::Camera;

    /// The pixels of a black picture changed by marks.
    fn drawn(words: &str, size_px: (u32, u32), pixels_per_point: f32) -> Vec<(u32, u32)> {
        let (width, height) = size_px;
        let mut picture = Picture { width, height, rgb: vec![[0; 3]; (width * height) as usize] };
        let camera = Camera::looking_from(DVec3::Z, DVec3::Y, (DVec3::ZERO, DVec3::new(15.0, 23.0, 31.0)));
        let scene = Scene { camera: Some(camera), ..fixture::scene() };
        let over = Over { marks: words.parse().unwrap(), distances: vec![[camera.target, camera.target + DVec3::X]] };
        draw(&mut picture, &scene, &fixture::volumes(), &over, pixels_per_point);
        let places = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
        places.zip(&picture.rgb).filter(|(_, pixel)| **pixel != [0; 3]).map(|(place, _)| place).collect()
    }

    #[test]
    fn marks_are_where_the_window_has_them() {
        assert!(drawn("none", (640, 400), 1.0).is_empty());
        let bar = drawn("scale_bar", (640, 400), 1.0);
        assert!(bar.len() > 100 && bar.iter().all(|(x, y)| *x > 440 && *y > 350), "{bar:?}");
        let colors = drawn("color_bar", (640, 400), 1.0);
        assert!(colors.len() > 1000 && colors.iter().all(|(x, y)| *x > 540 && *y < 200));
        let measured = drawn("distances", (640, 400), 1.0);
        assert!(measured.iter().any(|(x, y)| x.abs_diff(320) < 6 && y.abs_diff(200) < 6), "{measured:?}");
        let large = drawn("scale_bar", (1280, 800), 2.0);
        let ratio = large.len() as f64 / bar.len() as f64;
        assert!((3.0..5.0).contains(&ratio) && large.iter().all(|(x, y)| *x > 880 && *y > 700), "{ratio}");
    }

    #[test]
    fn marks_are_as_large_as_in_the_window_and_can_be_read() {
        assert_eq!(pixels_per_point((1200, 800), (600, 400), 1.5), 3.0);
        assert_eq!(pixels_per_point((1200, 400), (600, 400), 1.5), 1.5);
        assert_eq!(pixels_per_point((120, 80), (600, 400), 1.0), 1.0);
    }

    #[test]
    fn a_window_s_marks_are_those_that_it_shows() {
        let mut window = WindowState::default();
        window.overlays.ticks = true;
        window.overlays.axes = false;
        let words = Marks::shown(&window).to_string();
        assert_eq!(words, "outline,ticks,scale_bar,color_bar,letters,distances");
        assert_eq!(words.parse(), Ok(Marks::shown(&window)));
        assert_eq!(("none".parse(), "bricks".parse::<Marks>()), (Ok(Marks::NONE), Err(())));
    }
}
