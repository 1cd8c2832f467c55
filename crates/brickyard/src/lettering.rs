//! Letters on pictures: which side of a patient each edge of a picture is on. A letter is drawn by coverage, white with a dark rim, so that it is
//! read on any background; that costs its own pixels.

use ab_glyph::{Font, FontRef, PxScale, ScaleFont, point};
use brickyard_volume::camera::CameraError;
use brickyard_volume::{Camera, Picture, Side, ViewRays};
use epaint_default_fonts::HACK_REGULAR;
use glam::DVec3;

/// The least height of a picture, or width, that has letters, pixels: in a smaller one they would hide too much.
pub const LEAST_LETTERED_PX: u32 = 96;

/// Writes at each edge of a picture, seen by this camera, which side of the patient is there. Pictures that are less than
/// [`LEAST_LETTERED_PX`] wide or high are left as they are.
///
/// # Errors
/// If the camera cannot make a picture.
pub fn letter_sides(picture: &mut Picture, camera: &Camera) -> Result<(), CameraError> {
    let (width, height) = (picture.width, picture.height);
    let rays = camera.rays(width, height)?;
    if width.min(height) < LEAST_LETTERED_PX {
        return Ok(());
    }
    let letter_px = (width.min(height) as f32 / 20.0).clamp(14.0, 60.0);
    let (far_x, far_y, margin) = (width as f32, height as f32, letter_px * 0.8);
    let centres_px =
        [[margin, far_y / 2.0], [far_x - margin, far_y / 2.0], [far_x / 2.0, margin], [far_x / 2.0, far_y - margin]];
    for (letters, centre_px) in edge_letters(&rays).iter().zip(centres_px) {
        draw_text(picture, letters, centre_px, letter_px);
    }
    Ok(())
}

/// The letters of the sides of a patient at the edges of a picture: left, right, top, bottom. More than one where the picture is oblique, and the
/// nearest side first.
pub fn edge_letters(rays: &ViewRays) -> [String; 4] {
    let (right, up) = (rays.right.normalize_or_zero(), rays.up.normalize_or_zero());
    [-right, right, up, -up].map(sides)
}

/// The letters of the sides that a direction points to, most of all to the first: more than one where it is oblique.
fn sides(direction: DVec3) -> String {
    let along = |side: &Side| side.direction().dot(direction);
    let mut towards: Vec<Side> = Side::ALL.into_iter().filter(|side| along(side) > 0.3).collect();
    towards.sort_by(|a, b| along(b).total_cmp(&along(a)));
    towards.into_iter().map(Side::letter).collect()
}

/// Draws a line of text, centred, with letters of this height.
fn draw_text(picture: &mut Picture, text: &str, [x_px, y_px]: [f32; 2], height_px: f32) {
    let font = FontRef::try_from_slice(HACK_REGULAR).expect("the font comes with the program");
    let scale = PxScale::from(height_px);
    let scaled = font.as_scaled(scale);
    let advance = |letter| scaled.h_advance(font.glyph_id(letter));
    let mut left = x_px - text.chars().map(advance).sum::<f32>() / 2.0;
    let baseline = y_px + (scaled.ascent() + scaled.descent()) / 2.0;
    let mut ink = Ink { size: (picture.width, picture.height), coverage: vec![0.0; picture.rgb.len()] };
    for letter in text.chars() {
        let glyph = font.glyph_id(letter).with_scale_and_position(scale, point(left, baseline));
        left += advance(letter);
        if let Some(outline) = font.outline_glyph(glyph) {
            let corner = outline.px_bounds().min;
            outline.draw(|x, y, coverage| {
                ink.add(corner.x as i64 + i64::from(x), corner.y as i64 + i64::from(y), coverage)
            });
        }
    }
    ink.put_on(picture, (height_px / 12.0).round().max(1.0) as i64);
}

/// How much of each pixel of a picture is covered by letters, 0 to 1.
struct Ink {
    size: (u32, u32),
    coverage: Vec<f32>,
}

impl Ink {
    fn index(&self, x: i64, y: i64) -> Option<usize> {
        let inside = (0..i64::from(self.size.0)).contains(&x) && (0..i64::from(self.size.1)).contains(&y);
        inside.then(|| (y * i64::from(self.size.0) + x) as usize)
    }

    fn add(&mut self, x: i64, y: i64, coverage: f32) {
        if let Some(i) = self.index(x, y) {
            self.coverage[i] = self.coverage[i].max(coverage);
        }
    }

    /// Puts the letters on the picture, in white, with a dark rim of `rim_px`.
    fn put_on(&self, picture: &mut Picture, rim_px: i64) {
        let (width, height) = (i64::from(self.size.0), i64::from(self.size.1));
        let mut rim = Self { size: self.size, coverage: vec![0.0; self.coverage.len()] };
        let covered = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
        for (i, (x, y)) in covered.enumerate().filter(|(i, _)| self.coverage[*i] > 0.0) {
            for (dx, dy) in (-rim_px..=rim_px).flat_map(|dy| (-rim_px..=rim_px).map(move |dx| (dx, dy))) {
                rim.add(x + dx, y + dy, self.coverage[i]);
            }
        }
        for ((pixel, ink), rim) in picture.rgb.iter_mut().zip(&self.coverage).zip(&rim.coverage) {
            *pixel = pixel.map(|value| {
                let dark = f32::from(value) * (1.0 - 0.75 * rim);
                (dark + (255.0 - dark) * ink).round() as u8
            });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn letters_name_the_sides_that_a_direction_points_to() {
        assert_eq!(sides(DVec3::NEG_X), "L");
        assert_eq!(sides(DVec3::new(0.1, -0.7, -0.69)), "PI");
    }

    #[test]
    fn letters_are_drawn_at_the_edges_alone_and_not_on_small_pictures() {
        let gray = |width: u32, height| Picture { width, height, rgb: vec![[90; 3]; (width * height) as usize] };
        let world_box = (DVec3::splat(-1.0), DVec3::ONE);
        let camera = Camera::looking_from(Side::Anterior.direction(), Side::Anterior.up(), world_box);
        assert_eq!(edge_letters(&camera.rays(200, 100).unwrap()), ["R", "L", "S", "I"]);
        let mut picture = gray(200, 100);
        letter_sides(&mut picture, &camera).unwrap();
        let is_drawn = |x: u32, y: u32| picture.rgb[(y * 200 + x) as usize] != [90; 3];
        let drawn: Vec<_> =
            (0..100).flat_map(|y| (0..200).map(move |x| (x, y))).filter(|&(x, y)| is_drawn(x, y)).collect();
        assert!(drawn.iter().all(|&(x, y)| !(25..175).contains(&x) || !(25..75).contains(&y)), "in the middle");
        for near in [(11u32, 50u32), (189, 50), (100, 11), (100, 89)] {
            let at_edge = |&&(x, y): &&(u32, u32)| near.0.abs_diff(x) < 12 && near.1.abs_diff(y) < 12;
            assert!(drawn.iter().filter(at_edge).count() > 20, "nothing near {near:?}");
        }
        let brightest = picture.rgb.iter().map(|pixel| pixel[0]).max();
        assert!(brightest > Some(200), "white: {brightest:?}");
        let mut small = gray(90, 300);
        letter_sides(&mut small, &camera).unwrap();
        assert_eq!(small, gray(90, 300));
    }
}
