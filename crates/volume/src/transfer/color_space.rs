//! ParaView's colour spaces for interpolation between the points of a colour map, as computed by VTK
//! (`vtkColorTransferFunction`): a map's look depends on its points and its space.

use std::f64::consts::PI;

/// A colour in 0..=1, display-referred.
type Rgb = [f64; 3];

/// Spaces of the colours between two points.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum ColorSpace {
    Rgb,
    /// Hue, saturation and value; with `wrap`, hue takes the shorter way round.
    Hsv {
        wrap: bool,
    },
    /// CIELAB, of a white at D65.
    Lab,
    /// Kenneth Moreland's polar form of CIELAB, with white between two saturated colours ("Diverging Color Maps for
    /// Scientific Visualization", 2009).
    Diverging,
    /// No colours between: the next point's.
    Step,
}

impl ColorSpace {
    /// The colour at `t` in 0..1 between two.
    pub(super) fn mix(self, a: Rgb, b: Rgb, t: f64) -> Rgb {
        match self {
            Self::Rgb => lerp(a, b, t),
            Self::Hsv { wrap } => {
                let (mut a, mut b) = (hsv(a), hsv(b));
                if wrap && (a[0] - b[0]).abs() > 0.5 {
                    if a[0] > b[0] { a[0] -= 1.0 } else { b[0] -= 1.0 }
                }
                let [hue, saturation, value] = lerp(a, b, t);
                rgb_of_hsv([hue.rem_euclid(1.0), saturation, value])
            }
            Self::Lab => rgb_of_lab(lerp(lab(a), lab(b), t)),
            Self::Diverging => diverging(a, b, t),
            Self::Step => b,
        }
    }
}

fn lerp(a: [f64; 3], b: [f64; 3], t: f64) -> [f64; 3] {
    std::array::from_fn(|k| a[k] + t * (b[k] - a[k]))
}

fn hsv([r, g, b]: Rgb) -> [f64; 3] {
    let (least, greatest) = (r.min(g).min(b), r.max(g).max(b));
    let range = greatest - least;
    if range == 0.0 {
        return [0.0, 0.0, greatest];
    }
    let sixths = if greatest == r {
        (g - b) / range
    } else if greatest == g {
        2.0 + (b - r) / range
    } else {
        4.0 + (r - g) / range
    };
    [(sixths / 6.0).rem_euclid(1.0), range / greatest, greatest]
}

fn rgb_of_hsv([hue, saturation, value]: [f64; 3]) -> Rgb {
    [5.0, 3.0, 1.0].map(|offset| {
        let sixths = (offset + 6.0 * hue).rem_euclid(6.0);
        value - value * saturation * sixths.min(4.0 - sixths).clamp(0.0, 1.0)
    })
}

/// D65, as in VTK.
const WHITE: [f64; 3] = [0.9505, 1.0, 1.089];

/// Converts a display-referred colour (sRGB, in 0..=1) to CIELAB, of a white at D65: lightness from 0 to 100, and
/// two differences of colour.
pub fn lab(color: Rgb) -> [f64; 3] {
    let [r, g, b] = color.map(|c| if c > 0.04045 { ((c + 0.055) / 1.055).powf(2.4) } else { c / 12.92 });
    let xyz = [
        0.4124 * r + 0.3576 * g + 0.1805 * b,
        0.2126 * r + 0.7152 * g + 0.0722 * b,
        0.0193 * r + 0.1192 * g + 0.9505 * b,
    ];
    let [x, y, z] = std::array::from_fn(|k| {
        let v: f64 = xyz[k] / WHITE[k];
        if v > 0.008856 { v.cbrt() } else { 7.787 * v + 16.0 / 116.0 }
    });
    [116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)]
}

/// Colours outside the display's range are scaled down to its brightest, and clamped from below.
fn rgb_of_lab([l, a, b]: [f64; 3]) -> Rgb {
    let y = (l + 16.0) / 116.0;
    let [x, y, z] = [a / 500.0 + y, y, y - b / 200.0].map(|v| {
        let cube = v * v * v;
        if cube > 0.008856 { cube } else { (v - 16.0 / 116.0) / 7.787 }
    });
    let [x, y, z] = [x * WHITE[0], y * WHITE[1], z * WHITE[2]];
    let linear = [
        3.2406 * x - 1.5372 * y - 0.4986 * z,
        -0.9689 * x + 1.8758 * y + 0.0415 * z,
        0.0557 * x - 0.2040 * y + 1.0570 * z,
    ];
    let color = linear.map(|c| if c > 0.0031308 { 1.055 * c.powf(1.0 / 2.4) - 0.055 } else { 12.92 * c });
    let brightest = color.into_iter().fold(1.0, f64::max);
    color.map(|c| (c / brightest).max(0.0))
}

/// Magnitude, saturation (an angle) and hue (an angle): CIELAB in polar form.
fn polar(color: Rgb) -> [f64; 3] {
    let [l, a, b] = lab(color);
    let magnitude = (l * l + a * a + b * b).sqrt();
    let saturation = if magnitude > 0.001 { (l / magnitude).acos() } else { 0.0 };
    let hue = if saturation > 0.001 { b.atan2(a) } else { 0.0 };
    [magnitude, saturation, hue]
}

fn rgb_of_polar([magnitude, saturation, hue]: [f64; 3]) -> Rgb {
    let (sin, cos) = saturation.sin_cos();
    rgb_of_lab([magnitude * cos, magnitude * sin * hue.cos(), magnitude * sin * hue.sin()])
}

/// Saturation below which a colour's hue is meaningless.
const UNSATURATED: f64 = 0.05;

fn diverging(a: Rgb, b: Rgb, t: f64) -> Rgb {
    let (mut a, mut b, mut t) = (polar(a), polar(b), t);
    let between = (a[2] - b[2]).abs();
    let apart = between.min(2.0 * PI - between) > 0.33 * PI;
    if a[1] > UNSATURATED && b[1] > UNSATURATED && apart {
        let white = [a[0].max(b[0]).max(88.0), 0.0, 0.0];
        if t < 0.5 {
            (b, t) = (white, 2.0 * t);
        } else {
            (a, t) = (white, 2.0 * t - 1.0);
        }
    }
    if a[1] < UNSATURATED && b[1] > UNSATURATED {
        a[2] = hue_towards(b, a[0]);
    } else if b[1] < UNSATURATED && a[1] > UNSATURATED {
        b[2] = hue_towards(a, b[0]);
    }
    rgb_of_polar(lerp(a, b, t))
}

/// Final hue of a colour on its way to an unsaturated one, for even perceived change.
fn hue_towards([magnitude, saturation, hue]: [f64; 3], unsaturated_magnitude: f64) -> f64 {
    if magnitude >= unsaturated_magnitude - 0.1 {
        return hue;
    }
    let longer = (unsaturated_magnitude * unsaturated_magnitude - magnitude * magnitude).sqrt();
    let spin = saturation * longer / (magnitude * saturation.sin());
    if hue > -0.3 * PI { hue + spin } else { hue - spin }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Colours at 0.2, 0.5 and 0.7 between two, by `vtkColorTransferFunction` of VTK 9.7.2.
    #[test]
    fn colours_between_are_vtks() {
        let cases = [
            (
                ColorSpace::Hsv { wrap: false },
                [0.231, 0.298, 0.753],
                [0.706, 0.016, 0.149],
                [[0.33019, 0.18586, 0.7436], [0.63167, 0.12016, 0.7295], [0.7201, 0.0777, 0.57455]],
            ),
            (
                ColorSpace::Hsv { wrap: false },
                [1.0, 0.1, 0.0],
                [0.9, 0.1, 0.6],
                [[0.83148, 0.98, 0.02178], [0.05278, 0.95, 0.71448], [0.07233, 0.2503, 0.93]],
            ),
            (
                ColorSpace::Hsv { wrap: false },
                [0.9, 0.2, 0.1],
                [0.95, 0.95, 0.94],
                [[0.91, 0.45568, 0.26097], [0.925, 0.74301, 0.50902], [0.935, 0.86774, 0.67878]],
            ),
            (
                ColorSpace::Hsv { wrap: false },
                [0.02, 0.05, 0.01],
                [1.0, 1.0, 0.2],
                [[0.1248, 0.24, 0.048], [0.3675, 0.525, 0.105], [0.5863, 0.715, 0.143]],
            ),
            (
                ColorSpace::Hsv { wrap: true },
                [0.231, 0.298, 0.753],
                [0.706, 0.016, 0.149],
                [[0.33019, 0.18586, 0.7436], [0.63167, 0.12016, 0.7295], [0.7201, 0.0777, 0.57455]],
            ),
            (
                ColorSpace::Hsv { wrap: true },
                [1.0, 0.1, 0.0],
                [0.9, 0.1, 0.6],
                [[0.98, 0.02178, 0.0649], [0.95, 0.05278, 0.2883], [0.93, 0.07233, 0.42183]],
            ),
            (
                ColorSpace::Hsv { wrap: true },
                [0.9, 0.2, 0.1],
                [0.95, 0.95, 0.94],
                [[0.91, 0.45568, 0.26097], [0.925, 0.74301, 0.50902], [0.935, 0.86774, 0.67878]],
            ),
            (
                ColorSpace::Hsv { wrap: true },
                [0.02, 0.05, 0.01],
                [1.0, 1.0, 0.2],
                [[0.1248, 0.24, 0.048], [0.3675, 0.525, 0.105], [0.5863, 0.715, 0.143]],
            ),
            (
                ColorSpace::Lab,
                [0.231, 0.298, 0.753],
                [0.706, 0.016, 0.149],
                [[0.43516, 0.26237, 0.62631], [0.58067, 0.20252, 0.44307], [0.64139, 0.15331, 0.32513]],
            ),
            (
                ColorSpace::Lab,
                [1.0, 0.1, 0.0],
                [0.9, 0.1, 0.6],
                [[0.98887, 0.08943, 0.17727], [0.96556, 0.08125, 0.34171], [0.94414, 0.0836, 0.4448]],
            ),
            (
                ColorSpace::Lab,
                [0.9, 0.2, 0.1],
                [0.95, 0.95, 0.94],
                [[0.94293, 0.38798, 0.265], [0.98134, 0.60875, 0.50729], [0.98562, 0.74649, 0.6758]],
            ),
            (
                ColorSpace::Lab,
                [0.02, 0.05, 0.01],
                [1.0, 1.0, 0.2],
                [[0.20276, 0.21316, 0.08382], [0.47711, 0.48345, 0.13902], [0.67786, 0.68173, 0.16804]],
            ),
            (
                ColorSpace::Diverging,
                [0.231, 0.298, 0.753],
                [0.706, 0.016, 0.149],
                [[0.48429, 0.62202, 0.97533], [0.8654, 0.86541, 0.8654], [0.96983, 0.67748, 0.55977]],
            ),
            (
                ColorSpace::Diverging,
                [1.0, 0.1, 0.0],
                [0.9, 0.1, 0.6],
                [[1.0, 0.0, 0.18628], [1.0, 0.0, 0.35795], [0.98656, 0.0, 0.46672]],
            ),
            (
                ColorSpace::Diverging,
                [0.9, 0.2, 0.1],
                [0.95, 0.95, 0.94],
                [[1.0, 0.42487, 0.29804], [1.0, 0.62034, 0.52243], [1.0, 0.74485, 0.67718]],
            ),
            (
                ColorSpace::Diverging,
                [0.02, 0.05, 0.01],
                [1.0, 1.0, 0.2],
                [[0.10387, 0.19029, 0.05038], [0.31084, 0.44489, 0.04763], [0.53658, 0.64914, 0.0552]],
            ),
        ];
        for (space, a, b, expected) in cases {
            for (t, expected) in [0.2, 0.5, 0.7].into_iter().zip(expected) {
                let found = space.mix(a, b, t);
                for (found, expected) in found.into_iter().zip(expected) {
                    // Five digits are written here.
                    assert!((found - expected).abs() < 1e-5, "{space:?} {a:?} {b:?} at {t}: {found} {expected}");
                }
            }
        }
    }
}
