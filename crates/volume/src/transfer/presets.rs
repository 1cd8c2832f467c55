//! Transfer functions by name: the perceptual maps and other ramps over a window, and presets for CT and MR.

use super::{TransferError, TransferFunction, automatic, maps};
use crate::foreground::Foreground;
use crate::near_name;

impl TransferFunction {
    /// Names of all presets, for [`TransferFunction::preset`].
    pub const PRESETS: [&str; 14] = [
        automatic::NAME,
        "gray",
        "viridis",
        "magma",
        "inferno",
        "plasma",
        "turbo",
        "fire",
        "ct-bone",
        "ct-skin",
        "ct-angio",
        "ct-lung",
        "ct-soft",
        "mr-default",
    ];

    /// Returns the preset called `name`. Presets for CT are absolute (Hounsfield units, millimetres); the others span
    /// `window` (data units) and collect their opacity over `unit_distance` (world units).
    ///
    /// # Errors
    /// [`TransferError::UnknownPreset`], with the names of all presets.
    pub fn preset(name: &str, window: (f64, f64), unit_distance: f64) -> Result<Self, TransferError> {
        let over_window = |color: &[[f64; 4]], opacity: &[[f64; 2]]| {
            Self::new(color.to_vec(), opacity.to_vec(), unit_distance).stretched((0.0, 1.0), window)
        };
        let hounsfield = |color: &[[f64; 4]], opacity: &[[f64; 2]]| Self::new(color.to_vec(), opacity.to_vec(), 2.0);
        Ok(match name {
            automatic::NAME => automatic::automatic(&Foreground::of_window(window), window.1, unit_distance),
            "gray" => over_window(&ramp(&[[0.0; 3], [1.0; 3]]), &RISING),
            "fire" => over_window(
                &ramp(&[[0.0; 3], [0.55, 0.05, 0.0], [0.95, 0.45, 0.05], [1.0, 0.85, 0.35], [1.0, 1.0, 0.95]]),
                &RISING,
            ),
            // Air and noise are clear; tissue, most of the window, goes from red-brown to ivory.
            "mr-default" => over_window(
                &[[0.08, 0.25, 0.06, 0.03], [0.3, 0.62, 0.36, 0.22], [0.6, 0.86, 0.74, 0.58], [1.0, 1.0, 1.0, 0.97]],
                &[[0.08, 0.0], [0.2, 0.02], [0.5, 0.2], [1.0, 0.5]],
            ),
            "ct-skin" => hounsfield(
                &[[-500.0, 0.62, 0.36, 0.28], [-100.0, 0.86, 0.62, 0.50], [300.0, 0.98, 0.86, 0.76]],
                &[[-500.0, 0.0], [-250.0, 0.35], [0.0, 0.45], [3000.0, 0.6]],
            ),
            "ct-bone" => hounsfield(
                &[[150.0, 0.55, 0.25, 0.15], [400.0, 0.88, 0.72, 0.50], [1200.0, 1.0, 0.97, 0.90]],
                &[[180.0, 0.0], [350.0, 0.12], [900.0, 0.7], [1600.0, 0.95]],
            ),
            // Contrast medium (150 to 450) is nearly opaque; bone, mostly denser, a faint shell around it.
            "ct-angio" => hounsfield(
                &[
                    [150.0, 0.45, 0.02, 0.04],
                    [260.0, 0.85, 0.14, 0.10],
                    [420.0, 1.0, 0.52, 0.34],
                    [600.0, 0.93, 0.87, 0.76],
                    [1500.0, 1.0, 1.0, 0.97],
                ],
                &[[140.0, 0.0], [200.0, 0.2], [300.0, 0.6], [420.0, 0.5], [600.0, 0.03], [1500.0, 0.1]],
            ),
            // The lung's tissue is a haze around visible vessels and walls of airways; denser tissue is clear.
            "ct-lung" => hounsfield(
                &[
                    [-950.0, 0.25, 0.45, 0.75],
                    [-750.0, 0.60, 0.72, 0.90],
                    [-500.0, 0.95, 0.80, 0.72],
                    [-300.0, 0.90, 0.40, 0.32],
                ],
                &[[-960.0, 0.0], [-850.0, 0.01], [-650.0, 0.05], [-450.0, 0.2], [-300.0, 0.2], [-200.0, 0.0]],
            ),
            // Fat (-120 to -60) is thin, muscle (10 to 80) dense, bone opaque.
            "ct-soft" => hounsfield(
                &[
                    [-150.0, 0.90, 0.76, 0.45],
                    [-40.0, 0.88, 0.62, 0.42],
                    [30.0, 0.62, 0.20, 0.16],
                    [90.0, 0.78, 0.34, 0.26],
                    [250.0, 0.92, 0.78, 0.62],
                    [800.0, 1.0, 0.97, 0.90],
                ],
                &[[-160.0, 0.0], [-90.0, 0.015], [-20.0, 0.03], [30.0, 0.3], [90.0, 0.4], [250.0, 0.5], [800.0, 0.9]],
            ),
            _ => match maps::colors(name) {
                Some(colors) => over_window(&ramp(&colors), &RISING),
                None => {
                    let (hint, known) = (near_name::hint(name, Self::PRESETS.into_iter()), Self::PRESETS.join(", "));
                    return Err(TransferError::UnknownPreset { name: name.to_string(), hint, known });
                }
            },
        })
    }

    /// Whether a preset has values of its own, independent of the window.
    pub(super) fn is_absolute(name: &str) -> bool {
        name.starts_with("ct-")
    }
}

/// The opacity of a plain colour map, from 0 to 1.
pub(super) const RISING: [[f64; 2]; 2] = [[0.0, 0.0], [1.0, 0.5]];

/// Colours at equal distances from 0 to 1.
fn ramp(colors: &[[f64; 3]]) -> Vec<[f64; 4]> {
    let last = (colors.len() - 1) as f64;
    colors.iter().enumerate().map(|(i, [r, g, b])| [i as f64 / last, *r, *g, *b]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn presets_are_valid_whatever_the_window() {
        for name in TransferFunction::PRESETS {
            for window in [(0.0, 255.0), (3.0, 3.0), (-1e30, 1e30)] {
                TransferFunction::preset(name, window, 1.0).unwrap().validate().unwrap();
            }
        }
    }

    #[test]
    fn absolute_presets_are_those_that_no_window_moves() {
        for name in TransferFunction::PRESETS {
            let [a, b] = [(0.0, 1.0), (2.0, 9.0)].map(|window| TransferFunction::preset(name, window, 1.0).unwrap());
            assert_eq!(TransferFunction::is_absolute(name), a == b, "{name}");
        }
    }

    /// Colours at the ends and in between, from matplotlib 3.11 (`matplotlib.colormaps[name].colors`).
    #[test]
    fn perceptual_maps_are_the_published_ones() {
        let published = [
            (
                "viridis",
                [[0.267004, 0.004874, 0.329415], [0.127568, 0.566949, 0.550556], [0.993248, 0.906157, 0.143936]],
            ),
            ("magma", [[0.001462, 0.000466, 0.013866], [0.716387, 0.214982, 0.475290], [0.987053, 0.991438, 0.749504]]),
            (
                "inferno",
                [[0.001462, 0.000466, 0.013866], [0.735683, 0.215906, 0.330245], [0.988362, 0.998364, 0.644924]],
            ),
            (
                "plasma",
                [[0.050383, 0.029803, 0.527975], [0.798216, 0.280197, 0.469538], [0.940015, 0.975158, 0.131326]],
            ),
            ("turbo", [[0.18995, 0.07176, 0.23217], [0.64362, 0.98999, 0.23356], [0.47960, 0.01583, 0.01055]]),
        ];
        for (name, colors) in published {
            let map = TransferFunction::preset(name, (0.0, 255.0), 1.0).unwrap();
            assert_eq!(map.color.len(), 256, "{name}");
            for (value, color) in [0.0, 128.0, 255.0].into_iter().zip(colors) {
                for (found, expected) in map.rgb(value).into_iter().zip(color) {
                    // The table has 8 bits a channel.
                    assert!((found - expected).abs() <= 0.5001 / 255.0, "{name} at {value}: {found} {expected}");
                }
            }
        }
    }

    #[test]
    fn an_unknown_name_is_answered_with_the_nearest() {
        let unknown = |name: &str| TransferFunction::preset(name, (0.0, 1.0), 1.0).unwrap_err().to_string();
        assert!(
            unknown("grey").contains("'grey', did you mean 'gray'?: not a file, and not one of auto, gray, viridis")
        );
        assert!(unknown("sepia").starts_with("unknown transfer function 'sepia': not a file"));
    }
}
