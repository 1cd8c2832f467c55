//! Stereo: the rays of two eyes, and the composition of their pictures.
//!
//! The eyes stand half the separation to the left and to the right of the camera's eye and look in the same direction; the
//! picture's plane is shifted so that both see points at the convergence distance in the same pixel
//! ([`ViewRays::from_aside`]). Nearer points appear in front of the screen, farther ones behind it. Turning the eyes towards
//! each other instead (toe-in) distorts each picture to a trapezium, and its vertical disparities cannot be fused.
//!
//! Orthographic views follow the same rule: each eye's parallel rays lean to meet the other eye's at the convergence distance,
//! and the disparity grows evenly with the distance from there. VTK and ParaView do the same: they shear space about the focal
//! plane, in both projections.
//!
//! Pixels are square in every layout: an eye of a side-by-side picture has half its width and a narrower view; it is not
//! squeezed.

use crate::camera::{Camera, CameraError, ViewRays};
use crate::enum_all::every;
use crate::picture::Picture;
use serde::{Deserialize, Serialize};

/// Default eye separation as a share of the convergence distance: close to ParaView's eye angle of 2 degrees (1 / 28.6), and a
/// rule of stereo photographers.
const DEFAULT_SEPARATION: f64 = 1.0 / 30.0;

/// Layouts of the two eyes' pictures.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum StereoLayout {
    /// The left eye's picture in the left half, the right eye's in the right.
    SideBySide,
    /// The left eye's picture in the top half, the right eye's below.
    TopBottom,
    /// One picture for red-cyan glasses, with the red glass in front of the left eye.
    Anaglyph,
    /// Rows 0, 2, 4... from the top are the left eye's, the others the right eye's.
    Interlaced,
}

every!(StereoLayout: SideBySide TopBottom Anaglyph Interlaced);

/// Stereo: two eyes instead of one.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Stereo {
    /// Layout of the two eyes' pictures.
    pub layout: StereoLayout,
    /// World distance between the eyes; `None` is a thirtieth of the convergence distance.
    pub eye_separation: Option<f64>,
    /// World distance of the screen along the view; `None` is the distance of the camera's target.
    pub convergence: Option<f64>,
}

/// Why there is no stereo picture.
#[derive(Debug, thiserror::Error, PartialEq)]
pub enum StereoError {
    /// The eye separation or the convergence distance is not a positive, finite number.
    #[error("stereo: {name} is {value}: expected a positive length, in world units")]
    Length {
        /// The length's name: `eye_separation` or `convergence`.
        name: &'static str,
        /// The given length.
        value: f64,
    },
    /// The layout halves a side with an odd number of pixels.
    #[error("a {layout} picture is two {side}s in one, so its {side} must be even: {width}x{height} pixels are not")]
    OddSize {
        /// Name of the layout: `side-by-side` or `top-bottom`.
        layout: &'static str,
        /// The odd side: `width` or `height`.
        side: &'static str,
        /// Width of the whole picture in pixels.
        width: u32,
        /// Height of the whole picture in pixels.
        height: u32,
    },
    /// The camera cannot be used.
    #[error(transparent)]
    Camera(#[from] CameraError),
}

impl Stereo {
    /// Creates stereo in this layout, with default distances.
    pub const fn new(layout: StereoLayout) -> Self {
        Self { layout, eye_separation: None, convergence: None }
    }

    /// Returns the rays of the left and of the right eye for a whole picture of this size.
    ///
    /// # Errors
    /// If a distance is not positive, the layout halves an odd side, or the camera is invalid.
    pub fn eyes(&self, camera: &Camera, size_px: (u32, u32)) -> Result<[ViewRays; 2], StereoError> {
        let length = |name, value: f64| match value.is_finite() && value > 0.0 {
            true => Ok(value),
            false => Err(StereoError::Length { name, value }),
        };
        let (width, height) = self.layout.eye_size(size_px)?;
        let rays = camera.rays(width, height)?;
        let to_target = (camera.target - camera.eye).length();
        let convergence = length("convergence", self.convergence.unwrap_or(to_target))?;
        let separation = self.eye_separation.unwrap_or(convergence * DEFAULT_SEPARATION);
        let half = 0.5 * length("eye_separation", separation)?;
        Ok([-half, half].map(|by| rays.from_aside(by, convergence)))
    }
}

impl StereoLayout {
    /// The size of each eye's picture, given the size of the whole.
    fn eye_size(self, (width, height): (u32, u32)) -> Result<(u32, u32), StereoError> {
        let odd = |layout, side| StereoError::OddSize { layout, side, width, height };
        match self {
            Self::SideBySide if width % 2 == 1 => Err(odd("side-by-side", "width")),
            Self::TopBottom if height % 2 == 1 => Err(odd("top-bottom", "height")),
            Self::SideBySide => Ok((width / 2, height)),
            Self::TopBottom => Ok((width, height / 2)),
            Self::Anaglyph | Self::Interlaced => Ok((width, height)),
        }
    }

    /// Composes the pictures of the left and of the right eye, which have the same size.
    ///
    /// # Panics
    /// If the sizes differ.
    pub fn compose(self, [left, right]: [&Picture; 2]) -> Picture {
        let Picture { width, height, .. } = *left;
        assert_eq!((width, height), (right.width, right.height), "the eyes' pictures differ in size");
        let row = |eye: &Picture, y: u32| eye.rgb[y as usize * width as usize..][..width as usize].to_vec();
        match self {
            Self::SideBySide => {
                let rows = (0..height).flat_map(|y| [row(left, y), row(right, y)]);
                Picture { width: 2 * width, height, rgb: rows.flatten().collect() }
            }
            Self::TopBottom => Picture { width, height: 2 * height, rgb: [&left.rgb[..], &right.rgb[..]].concat() },
            Self::Anaglyph => anaglyph(left, right),
            Self::Interlaced => {
                let rows = (0..height).flat_map(|y| row(if y % 2 == 0 { left } else { right }, y));
                Picture { width, height, rgb: rows.collect() }
            }
        }
    }
}

/// Weights of linear red, green and blue of the left and of the right eye's pixel in red, green and blue for red-cyan glasses:
/// the least-squares optimum for the emission of LCDs and the transmission of the glasses (Dubois, "A projection method to
/// generate anaglyph stereo images", 2001, with the values of 2009).
const DUBOIS: [[f32; 6]; 3] = [
    [0.456_100, 0.500_484, 0.176_381, -0.043_470_6, -0.087_938_8, -0.001_555_29],
    [-0.040_082_2, -0.037_824_6, -0.015_758_9, 0.378_476, 0.733_64, -0.018_450_3],
    [-0.015_216_1, -0.020_597_1, -0.005_468_56, -0.072_152_7, -0.112_961, 1.226_4],
];

/// Composes an anaglyph by [`DUBOIS`]'s matrices. Red from the left and the rest from the right picture would show red things
/// to one eye only, which hurts; turning both gray first cures this, but loses the transfer function's colours. The matrices
/// keep most colours, and subtract each glass's leakage. Gray pictures stay gray, and need no method of their own.
fn anaglyph(left: &Picture, right: &Picture) -> Picture {
    // The matrices apply to light, pictures hold sRGB codes. Between neighbours of 65,536 steps the code changes by 1/20 at
    // most.
    const STEPS: usize = 65_535;
    let linear: [f32; 256] = std::array::from_fn(|code| linear_of(code as f32 / 255.0));
    let codes: Vec<u8> = (0..=STEPS).map(|i| (encoded(i as f32 / STEPS as f32) * 255.0 + 0.5) as u8).collect();
    let pixel = |(l, r): (&[u8; 3], &[u8; 3])| {
        let eyes = [l[0], l[1], l[2], r[0], r[1], r[2]].map(|code| linear[code as usize]);
        DUBOIS.map(|weights| {
            let light: f32 = weights.iter().zip(eyes).map(|(weight, light)| weight * light).sum();
            codes[(light.clamp(0.0, 1.0) * STEPS as f32 + 0.5) as usize]
        })
    };
    let rgb = left.rgb.iter().zip(&right.rgb).map(pixel).collect();
    Picture { width: left.width, height: left.height, rgb }
}

/// Converts an sRGB value to light.
fn linear_of(encoded: f32) -> f32 {
    if encoded <= 0.040_45 { encoded / 12.92 } else { ((encoded + 0.055) / 1.055).powf(2.4) }
}

/// Converts light to an sRGB value.
fn encoded(linear: f32) -> f32 {
    if linear <= 0.003_130_8 { linear * 12.92 } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Projection;
    use glam::DVec3;

    const PERSPECTIVE: Projection = Projection::Perspective { fov_y_deg: 50.0 };
    const ORTHOGRAPHIC: Projection = Projection::Orthographic { height: 9.0 };

    fn camera(projection: Projection) -> Camera {
        Camera { eye: DVec3::new(3.0, -7.0, 2.0), target: DVec3::new(0.5, 1.0, -1.0), up: DVec3::Z, projection }
    }

    /// The pixel of a point for an eye, from its rays: two of them span the picture's plane.
    fn pixel_of(rays: &ViewRays, point: DVec3) -> (f64, f64) {
        // Newton's method on the distance between ray and point; both are linear in the pixel but for the ray's length.
        let miss = |x: f64, y: f64| {
            let ray = rays.ray(x, y);
            let depth = (point - ray.origin).dot(rays.forward) / ray.direction.dot(rays.forward);
            let off = ray.origin + ray.direction * depth - point;
            (off.dot(rays.right) / rays.right.length(), off.dot(rays.up) / rays.up.length())
        };
        let (mut x, mut y) = (rays.width as f64 * 0.5, rays.height as f64 * 0.5);
        for _ in 0..3 {
            let (at, right, down) = (miss(x, y), miss(x + 1.0, y), miss(x, y + 1.0));
            (x, y) = (x - at.0 / (right.0 - at.0), y - at.1 / (down.1 - at.1));
        }
        (x, y)
    }

    #[test]
    fn disparities_have_their_closed_form() {
        let (separation, convergence) = (0.4, 6.0);
        for projection in [PERSPECTIVE, ORTHOGRAPHIC] {
            let camera = camera(projection);
            let (eye_separation, convergence_given) = (Some(separation), Some(convergence));
            let stereo = Stereo { layout: StereoLayout::TopBottom, eye_separation, convergence: convergence_given };
            let (mono, eyes) = (camera.rays(320, 100).unwrap(), stereo.eyes(&camera, (320, 200)).unwrap());
            let pixels_per_unit = 0.5 * mono.width as f64 / mono.right.length();
            for (x, y, depth) in [(0.0, 0.0, 6.0), (310.0, 7.0, 6.0), (160.0, 20.0, 2.0), (33.0, 90.0, 15.0)] {
                let ray = mono.ray(x, y);
                let point = ray.origin + ray.direction * (depth / ray.direction.dot(mono.forward));
                let [left, right] = eyes.map(|rays| pixel_of(&rays, point));
                // At half the convergence distance an eye must look as far across as it is aside; at infinity, not at all.
                let expected = match projection {
                    Projection::Perspective { .. } => separation * (1.0 / convergence - 1.0 / depth),
                    Projection::Orthographic { .. } => separation * (depth / convergence - 1.0),
                };
                let found = right.0 - left.0;
                assert!((found - expected * pixels_per_unit).abs() < 1e-7, "{projection:?} {depth}: {found}");
                assert!(found.abs() < 1e-7 || (found < 0.0) == (depth < convergence), "nearer is crossed");
                assert!((left.1 - y).abs() < 1e-7 && (right.1 - y).abs() < 1e-7, "no vertical disparity");
                assert!((0.5 * (left.0 + right.0) - x).abs() < 1e-7, "the camera's eye is in the middle");
            }
        }
    }

    #[test]
    fn defaults_follow_the_target_and_no_separation_is_the_camera_itself() {
        let camera = camera(PERSPECTIVE);
        let distance = (camera.target - camera.eye).length();
        let [left, right] = Stereo::new(StereoLayout::Anaglyph).eyes(&camera, (64, 48)).unwrap();
        assert!((left.eye.distance(right.eye) - distance / 30.0).abs() < 1e-12);
        let [a, b] = [left, right].map(|rays| pixel_of(&rays, camera.target));
        assert!((a.0 - 32.0).abs() < 1e-9 && (b.0 - 32.0).abs() < 1e-9, "{a:?} {b:?}");
        for projection in [PERSPECTIVE, ORTHOGRAPHIC] {
            let rays = Camera { projection, ..camera }.rays(64, 48).unwrap();
            assert_eq!(rays.from_aside(0.0, 5.0), rays);
        }
    }

    #[test]
    fn what_makes_no_pair_is_refused() {
        let camera = camera(PERSPECTIVE);
        let stereo = Stereo::new(StereoLayout::Anaglyph);
        for bad in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            for (name, stereo) in [
                ("eye_separation", Stereo { eye_separation: Some(bad), ..stereo }),
                ("convergence", Stereo { convergence: Some(bad), ..stereo }),
            ] {
                let error = stereo.eyes(&camera, (8, 8)).unwrap_err().to_string();
                assert!(error.starts_with(&format!("stereo: {name} is {bad}:")), "{error}");
            }
        }
        for (layout, size) in [(StereoLayout::SideBySide, (9, 8)), (StereoLayout::TopBottom, (8, 9))] {
            let error = Stereo::new(layout).eyes(&camera, size).unwrap_err();
            assert!(matches!(error, StereoError::OddSize { .. }), "{error}");
            assert!(Stereo::new(layout).eyes(&camera, (size.1, size.0)).is_ok());
        }
        assert!(Stereo::new(StereoLayout::Interlaced).eyes(&camera, (9, 9)).is_ok());
        let nowhere = Camera { target: camera.eye, ..camera };
        assert!(matches!(stereo.eyes(&nowhere, (8, 8)), Err(StereoError::Camera(_))));
    }

    /// A picture of pixels with their eye and place.
    fn told(eye: u8) -> Picture {
        Picture { width: 4, height: 3, rgb: (0..12).map(|i| [eye, i % 4, i / 4]).collect() }
    }

    #[test]
    fn layouts_put_every_pixel_in_its_place() {
        use StereoLayout::{Anaglyph, Interlaced, SideBySide, TopBottom};
        let camera = camera(PERSPECTIVE);
        for (layout, size) in [(SideBySide, (8, 3)), (TopBottom, (4, 6)), (Interlaced, (4, 3)), (Anaglyph, (4, 3))] {
            let rays = Stereo::new(layout).eyes(&camera, size).unwrap();
            assert_eq!(rays.map(|rays| (rays.width, rays.height)), [(4, 3); 2]);
            // Square pixels.
            let [x, y] = [rays[0].right.length() / 4.0, rays[0].up.length() / 3.0];
            assert!((x - y).abs() < 1e-12);
            let whole = layout.compose([&told(0), &told(1)]);
            assert_eq!((whole.width, whole.height), size);
            for (x, y) in (0..size.1).flat_map(|y| (0..size.0).map(move |x| (x, y))) {
                let expected = match layout {
                    SideBySide => [x / 4, x % 4, y],
                    TopBottom => [y / 3, x, y % 3],
                    Interlaced => [y % 2, x, y],
                    Anaglyph => continue,
                };
                assert_eq!(whole.pixel(x, y), expected.map(|v| v as u8), "{layout:?} {x} {y}");
            }
        }
    }

    fn flat(color: [u8; 3]) -> Picture {
        Picture { width: 1, height: 1, rgb: vec![color] }
    }

    #[test]
    fn anaglyphs_keep_grays_and_part_the_eyes() {
        let pixel = |l, r| anaglyph(&flat(l), &flat(r)).rgb[0];
        for gray in 0..=255 {
            assert_eq!(pixel([gray; 3], [gray; 3]), [gray; 3]);
        }
        // Light for one eye is in its primaries alone; the rest is clipped below black.
        let ([r, g, b], [r2, g2, b2]) = (pixel([200; 3], [0; 3]), pixel([0; 3], [200; 3]));
        assert!(r > 200 && g == 0 && b == 0 && r2 == 0 && g2 > 200 && b2 > 200);
        // Full red of both eyes by hand: 0.4561 - 0.0434706, 0.378476 - 0.0400822, and less than nothing.
        let by_hand = |light: f32| (encoded(light) * 255.0).round() as u8;
        assert_eq!(pixel([255, 0, 0], [255, 0, 0]), [by_hand(0.412_629_4), by_hand(0.338_393_8), 0]);
    }

    #[test]
    fn srgb_goes_there_and_back() {
        for code in 0..=255u8 {
            let value = code as f32 / 255.0;
            assert!((encoded(linear_of(value)) - value).abs() < 1e-6, "{code}");
        }
        // IEC 61966-2-1: middle gray of 18 % is code 118 (117.6).
        assert_eq!((encoded(0.18) * 255.0).round(), 118.0);
    }
}
