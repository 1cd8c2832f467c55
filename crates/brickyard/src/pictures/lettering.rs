//! Letters for a patient's sides at the edges of pictures, white with a dark rim, legible on any tissue.

use crate::pictures::overlay::canvas::{Canvas, Pen};
use crate::pictures::overlay::{LEAST_PX, PictureCanvas};
use brickyard_volume::camera::CameraError;
use brickyard_volume::{Camera, Picture, Side, ViewRays};
use glam::{DVec3, Vec2, vec2};

/// Height of the letters, in points.
const LETTER: f32 = 20.0;

/// Writes the patient's side at each edge of a picture seen by this camera. Pictures less than [`LEAST_PX`] wide or
/// high stay unchanged.
///
/// # Errors
/// If the camera is invalid for a picture.
pub fn letter_sides(picture: &mut Picture, camera: &Camera) -> Result<(), CameraError> {
    let (width, height) = (picture.width, picture.height);
    let rays = camera.rays(width, height)?;
    if width.min(height) < LEAST_PX {
        return Ok(());
    }
    let mut canvas = PictureCanvas::new(picture, [0.0; 3]);
    let (far, margin) = (canvas.size(), LETTER * 0.8);
    let centres = [
        vec2(margin, far.y / 2.0),
        vec2(far.x - margin, far.y / 2.0),
        vec2(far.x / 2.0, margin),
        vec2(far.x / 2.0, far.y - margin),
    ];
    for (letters, centre) in edge_letters(&rays).iter().zip(centres) {
        canvas.text(centre, Vec2::splat(0.5), letters, LETTER, Pen::Strong);
    }
    Ok(())
}

/// Returns the letters of a patient's sides at the edges of a picture: left, right, top, bottom. Oblique pictures have
/// several at an edge, the nearest side first.
pub fn edge_letters(rays: &ViewRays) -> [String; 4] {
    let (right, up) = (rays.right.normalize_or_zero(), rays.up.normalize_or_zero());
    [-right, right, up, -up].map(sides)
}

/// Returns the letters of the sides in a direction, the nearest first; several if it is oblique.
fn sides(direction: DVec3) -> String {
    let along = |side: &Side| side.direction().dot(direction);
    let mut towards: Vec<Side> = Side::ALL.into_iter().filter(|side| along(side) > 0.3).collect();
    towards.sort_by(|a, b| along(b).total_cmp(&along(a)));
    towards.into_iter().map(Side::letter).collect()
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
