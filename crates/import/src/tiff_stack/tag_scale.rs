//! Pixel sizes from a page's tags: GeoTIFF's model of the ground, or pixels per inch or centimetre; used unless a description gives
//! them. Tags have no distance of planes, except for GeoTIFF's third scale.

use super::description::Description;
use super::hyperstack::is_length;
use super::units::unit_of;
use crate::note::Note;
use crate::spacing::{Spacing, default_note, default_per_inch};

const CM_PER_INCH: f64 = 2.54;

/// GeoTIFF's keys: the kind of coordinates, and their unit of length.
const MODEL_TYPE: u16 = 1024;
const LINEAR_UNITS: u16 = 3076;
const PROJECTED: u16 = 1;
const GEOGRAPHIC: u16 = 2;
const METRE: u16 = 9001;

/// A page's tags about the size of its pixels.
#[derive(Debug, Default)]
pub(super) struct ScaleTags {
    /// Pixels per unit along x and y (XResolution, YResolution).
    pub(super) resolution: Option<[f64; 2]>,
    /// ResolutionUnit.
    pub(super) unit: Option<u16>,
    /// ModelPixelScale: a pixel's size along x, y and z.
    pub(super) model_scale: Vec<f64>,
    /// ModelTransformation: a matrix of four rows.
    pub(super) model_matrix: Vec<f64>,
    /// GeoKeyDirectory: a head of four numbers, then four for each key.
    pub(super) geo_keys: Vec<u16>,
}

impl ScaleTags {
    /// Adds the size of pixels to a description without one.
    pub(super) fn describe(&self, description: &mut Description) {
        if description.spacing.is_some() {
            return;
        }
        if let Some(spacing) = self.model_spacing() {
            description.spacing = Some(spacing);
            let place = "The pixel size is GeoTIFF's; the position on the ground is not kept";
            let (unit, note) = match (self.geo_key(MODEL_TYPE), self.geo_key(LINEAR_UNITS)) {
                (Some(GEOGRAPHIC), _) => (None, format!("{place}. They are measured in degrees.")),
                (Some(PROJECTED), Some(METRE)) => (Some("meter"), format!("{place}.")),
                _ => (None, format!("{place}, and neither is a unit.")),
            };
            description.unit = unit;
            description.notes.push(Note::new(note));
        } else if let Some(([x, y], unit)) = self.per_unit().filter(|_| !description.ignores_resolution) {
            if let Some(dots) = self.default_per_inch() {
                description.notes.push(default_note(dots));
                return;
            }
            description.spacing = Some(Spacing { x: 1.0 / x, y: 1.0 / y, z: None });
            description.set_unit(Some(unit));
        }
    }

    /// Pixels per unit of a description. As in ImageJ's files they are counted in it, unless the tags name another unit; an inch,
    /// tifffile's default, does not count.
    pub(super) fn pixels_per(&self, name: &str) -> Option<[f64; 2]> {
        match (self.unit, self.per_unit()) {
            (Some(3..), Some((resolution, unit))) => {
                let factor = unit_of(name)?.convert(1.0, unit_of(unit)?);
                Some(resolution.map(|pixels| pixels * factor))
            }
            (Some(3..), None) => None,
            _ => self.resolution.filter(|sizes| *sizes != [1.0; 2] && self.default_per_inch().is_none()),
        }
    }

    /// Default pixels per inch of a screen or printer, if the resolution is one in any unit.
    fn default_per_inch(&self) -> Option<f64> {
        let [x, _] = self.resolution.filter(|[x, y]| x == y)?;
        let per_inch = match self.unit {
            Some(2) => x,
            Some(3) => x * CM_PER_INCH,
            _ => return None,
        };
        default_per_inch(per_inch)
    }

    /// Pixels per unit, and the unit; `None` if one is missing, or both are placeholders.
    pub(super) fn per_unit(&self) -> Option<([f64; 2], &'static str)> {
        // The last two are not the standard's, but tifffile's.
        let unit = match self.unit? {
            2 => "inch",
            3 => "cm",
            4 => "mm",
            5 => "um",
            _ => return None,
        };
        let resolution = self.resolution.filter(|sizes| *sizes != [1.0; 2])?;
        resolution.iter().all(|&pixels| is_length(pixels) && is_length(1.0 / pixels)).then_some((resolution, unit))
    }

    fn model_spacing(&self) -> Option<Spacing> {
        let lengths = match (&self.model_scale[..], &self.model_matrix[..]) {
            ([x, y, z, ..], _) => [x.abs(), y.abs(), z.abs()],
            (_, matrix) if matrix.len() == 16 => {
                [0, 1, 2].map(|column| [0, 4, 8].iter().map(|row| matrix[row + column].powi(2)).sum::<f64>().sqrt())
            }
            _ => return None,
        };
        let [x, y, z] = lengths.map(|length| Some(length).filter(|&length| is_length(length)));
        x.zip(y).map(|(x, y)| Spacing { x, y, z })
    }

    /// The value of a key with one number.
    fn geo_key(&self, key: u16) -> Option<u16> {
        let keys = self.geo_keys.as_chunks::<4>().0;
        keys.iter().skip(1).find(|entry| entry[0] == key && entry[1] == 0).map(|entry| entry[3])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::said;

    fn described(tags: &ScaleTags) -> (Option<[f64; 3]>, Option<&'static str>, String) {
        let mut description = Description::default();
        tags.describe(&mut description);
        let spacing = description.spacing.map(|s| [s.x, s.y, s.z.unwrap_or(0.0)]);
        (spacing, description.unit, said(&description.notes))
    }

    fn resolution(x: f64, y: f64, unit: u16) -> ScaleTags {
        ScaleTags { resolution: Some([x, y]), unit: Some(unit), ..ScaleTags::default() }
    }

    #[test]
    fn pixels_per_inch_or_centimetre_are_sizes() {
        for (tags, expected, unit) in [
            (resolution(2.0, 4.0, 3), Some([0.5, 0.25, 0.0]), Some("centimeter")),
            (resolution(254.0, 254.0, 2), Some([1.0 / 254.0, 1.0 / 254.0, 0.0]), Some("inch")),
            (resolution(8.0, 8.0, 5), Some([0.125, 0.125, 0.0]), Some("micrometer")),
            // A screen's default along only one axis, or in another unit.
            (resolution(72.0, 96.0, 2), Some([1.0 / 72.0, 1.0 / 96.0, 0.0]), Some("inch")),
            (resolution(72.0, 72.0, 3), Some([1.0 / 72.0, 1.0 / 72.0, 0.0]), Some("centimeter")),
            (resolution(1.0, 1.0, 3), None, None),
            (resolution(8.0, 8.0, 1), None, None),
            (resolution(8.0, 8.0, 9), None, None),
            (resolution(0.0, 8.0, 2), None, None),
            (resolution(f64::INFINITY, 8.0, 2), None, None),
            (ScaleTags { unit: None, ..resolution(8.0, 8.0, 2) }, None, None),
        ] {
            let (spacing, found, notes) = described(&tags);
            assert_eq!((spacing, found, notes.as_str()), (expected, unit, ""), "{tags:?}");
        }
        let mut imagej = Description { ignores_resolution: true, ..Description::default() };
        resolution(254.0, 254.0, 2).describe(&mut imagej);
        assert_eq!(imagej.spacing, None);
        for dots in [72.0, 96.0] {
            let (spacing, _, notes) = described(&resolution(dots, dots, 2));
            assert!(spacing.is_none() && notes.contains(&format!("{dots} pixels per inch")), "{notes}");
        }
        // 72 and 96 as written by programs counting pixels per metre or centimetre.
        for (pixels, unit, dots) in [
            (72.009, 2, "72 pixels per inch"),
            (28.346, 3, "72 pixels per inch"),
            (28.34, 3, "72 pixels per inch"),
            (37.795, 3, "96 pixels per inch"),
        ] {
            let (spacing, _, notes) = described(&resolution(pixels, pixels, unit));
            assert!(spacing.is_none() && notes.contains(dots), "{notes}");
        }
        for (pixels, unit) in [(72.1, 2), (28.4, 3), (95.9, 2)] {
            assert!(described(&resolution(pixels, pixels, unit)).0.is_some(), "{pixels}");
        }
    }

    #[test]
    fn pixels_are_counted_in_the_unit_that_is_named() {
        assert_eq!(resolution(4.0, 2.0, 1).pixels_per("um"), Some([4.0, 2.0]));
        let [x, y] = resolution(20_000.0, 40_000.0, 3).pixels_per("µm").unwrap();
        assert!((x - 2.0).abs() < 1e-9 && (y - 4.0).abs() < 1e-9, "{x} {y}");
        assert_eq!(resolution(4.0, 2.0, 3).pixels_per("furlong"), None);
        assert_eq!(resolution(4.0, 2.0, 2).pixels_per("um"), Some([4.0, 2.0]));
        assert_eq!(resolution(72.0, 72.0, 2).pixels_per("um"), None);
        assert_eq!(resolution(1.0, 1.0, 1).pixels_per("um"), None);
    }

    #[test]
    fn geotiff_scales_pixels_in_its_own_unit() {
        let keys = |kind, unit| vec![1, 1, 0, 2, MODEL_TYPE, 0, 1, kind, LINEAR_UNITS, 0, 1, unit];
        let scale =
            |geo_keys| ScaleTags { model_scale: vec![30.0, 15.0, 0.0], geo_keys, ..resolution(300.0, 300.0, 2) };
        let (spacing, unit, notes) = described(&scale(keys(PROJECTED, METRE)));
        assert_eq!((spacing, unit), (Some([30.0, 15.0, 0.0]), Some("meter")));
        assert!(notes.contains("not kept"), "{notes}");
        assert!(described(&scale(keys(GEOGRAPHIC, 0))).2.contains("degrees"));
        assert_eq!(described(&scale(vec![])).1, None);
        let matrix = vec![0.0, -3.0, 0.0, 500.0, 4.0, 0.0, 0.0, 9.0, 0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 0.0, 1.0];
        let tags = ScaleTags { model_matrix: matrix, ..ScaleTags::default() };
        assert_eq!(described(&tags).0, Some([4.0, 3.0, 2.0]));
        let odd = ScaleTags { model_scale: vec![f64::NAN, 1.0, 1.0], ..ScaleTags::default() };
        assert_eq!(described(&odd).0, None);
    }
}
