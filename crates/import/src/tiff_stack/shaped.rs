//! The description written by tifffile, and by scikit-image and napari through it: JSON with the array's shape and, often, its axes,
//! `{"shape": [3, 4, 7, 9], "axes": "TZYX"}`, beside values from their callers, such as spacings and units.
//!
//! The last axes are those of a page; the others are steps, channels and slices by their letters. One axis without a meaning is taken along
//! z; several are ambiguous, and left to the user.

use super::description::{Declared, Description};
use super::hyperstack::{is_length, spacing};
use super::page::PageFormat;
use super::tag_scale::ScaleTags;
use crate::axes::Axis;
use crate::note::{Note, Setting};
use crate::spacing::Spacing;
use serde_json::Value;

/// Most bytes of a description.
pub(super) const LONGEST: u64 = 1 << 20;

/// Start of the oldest ones: `shape=(5, 7, 9)`.
const OLD_START: &str = "shape=";
/// The letter of an unnamed axis.
const UNSAID: char = 'Q';

/// Whether a description with this start is of an array's shape. Other programs write JSON, too.
pub(super) fn is_shaped(text: &str) -> bool {
    text.starts_with(OLD_START) || text.starts_with('{') && text.contains("\"shape\":") && !text.contains("\"mibi.")
}

/// Parses the text for pages of this format. `tags` hold the pixels per unit.
pub(super) fn read(text: &str, format: &PageFormat, tags: &ScaleTags) -> Description {
    let (declared, values) = match parsed(text).and_then(|array| Ok((array.declared(format)?, array.values))) {
        Ok(read) => read,
        Err(problem) => {
            return Description::unreadable(format!(
                "its description (tifffile's) {problem}; pass `axes` (with `channels` and `times`) to order its pages, \
                 such as zyx"
            ));
        }
    };
    let mut description = Description::default();
    description.notes.extend(declared.1);
    let declared = declared.0;
    place(&mut description, &values, tags);
    let step = [("finterval", "tunit"), ("TimeIncrement", "TimeIncrementUnit")]
        .iter()
        .find_map(|(step, unit)| Some((number(&values, step).filter(|step| *step != 0.0)?, text_of(&values, unit))));
    if let Some((step, unit)) = step {
        description.set_increment(step, unit.unwrap_or("s"), declared.times);
    }
    Description { declared: Some(declared), ..description }
}

/// Sets spacing and unit: by OME's names, or else by ImageJ's.
fn place(description: &mut Description, values: &Value, tags: &ScaleTags) {
    let depth = number(values, "spacing").map(f64::abs).filter(|&depth| is_length(depth));
    let unit = text_of(values, "unit").filter(|unit| !unit.starts_with("pixel"));
    let sizes = ["X", "Y", "Z"].map(|axis| {
        let name = format!("PhysicalSize{axis}");
        let size = number(values, &name).filter(|&size| is_length(size))?;
        let unit = text_of(values, &format!("{name}Unit")).or(unit).unwrap_or("µm");
        Some((size, unit.to_owned()))
    });
    description.set_physical_sizes(sizes);
    match &mut description.spacing {
        Some(spacing) => spacing.z = spacing.z.or(depth),
        None => {
            let resolution = unit.and_then(|unit| tags.pixels_per(unit));
            if resolution.is_none() && depth.is_none() {
                return;
            }
            if let (None, Some(depth), Some((_, of_pixels))) = (unit, depth, tags.per_unit()) {
                description.notes.push(Note::warning(format!(
                    "The description's spacing of {depth} has no unit, and that of pixels is {of_pixels}: the distance \
                     of slices is left out; pass `spacing` and `unit`."
                )).settled_by(Setting::Spacing));
                return;
            }
            description.set_unit(unit);
            description.spacing = spacing(resolution.is_some(), depth, resolution).map(|s| Spacing { z: depth, ..s });
        }
    }
}

/// A number, stored as one or as text.
fn number(values: &Value, key: &str) -> Option<f64> {
    match values.get(key)? {
        Value::Number(number) => number.as_f64(),
        Value::String(text) => text.trim().parse().ok(),
        _ => None,
    }
    .filter(|number| number.is_finite())
}

fn text_of<'a>(values: &'a Value, key: &str) -> Option<&'a str> {
    values.get(key)?.as_str().map(str::trim).filter(|text| !text.is_empty())
}

/// An array as described by tifffile.
struct Array {
    shape: Vec<u32>,
    axes: Option<String>,
    /// Whether there is one directory for all pages.
    truncated: bool,
    values: Value,
}

fn parsed(text: &str) -> Result<Array, String> {
    if let Some(list) = text.strip_prefix(OLD_START) {
        let numbers = list.trim().trim_matches(['(', ')']).split(',').map(str::trim).filter(|n| !n.is_empty());
        let shape = numbers.map(str::parse).collect::<Result<_, _>>();
        let shape = shape.map_err(|_| format!("has the shape '{}'", list.chars().take(60).collect::<String>()))?;
        return Ok(Array { shape, axes: None, truncated: false, values: Value::Null });
    }
    let values: Value = serde_json::from_str(text).map_err(|error| format!("is not JSON ({error})"))?;
    let size = |size: &Value| size.as_u64().and_then(|size| u32::try_from(size).ok());
    let shape = values.get("shape").and_then(Value::as_array).and_then(|sizes| sizes.iter().map(size).collect());
    let shape: Vec<u32> = shape.ok_or("has a shape other than a list of sizes")?;
    let axes = match values.get("axes") {
        None | Some(Value::Null) => None,
        Some(Value::String(axes)) if axes.is_empty() => None,
        Some(Value::String(axes)) => Some(axes.to_ascii_uppercase()),
        Some(_) => return Err("has axes other than text".into()),
    };
    let truncated = values.get("truncated").and_then(Value::as_bool).unwrap_or(false);
    Ok(Array { shape, axes, truncated, values })
}

impl Array {
    /// The arrangement of pages, and a note, if any.
    fn declared(&self, format: &PageFormat) -> Result<(Declared, Option<Note>), String> {
        if self.shape.contains(&0) {
            return Err(format!("has the shape {:?}, of no pixels", self.shape));
        }
        let before_page = match &self.axes {
            Some(axes) => self.named_before_page(axes, format)?,
            None => self.unnamed_before_page(format)?,
        };
        let mut declared = Declared {
            page_axes: Vec::new(),
            in_one_directory: true,
            of_each_page: !self.truncated,
            ..Declared::one_plane()
        };
        let mut note = None;
        for &(letter, size) in &before_page {
            let axis = match letter {
                'T' => Axis::T,
                'C' | 'S' => Axis::C,
                'Z' => Axis::Z,
                'I' | UNSAID if before_page.len() == 1 => {
                    let sequence = "The axis I (a sequence) of the description is taken along z.";
                    note = (letter == 'I').then(|| Note::new(sequence));
                    Axis::Z
                }
                _ => return Err(format!("does not name every axis of the shape {}", self.words())),
            };
            if declared.page_axes.contains(&axis) {
                return Err(format!("has two axes along {axis:?} in the shape {}", self.words()));
            }
            declared.page_axes.push(axis);
            match axis {
                Axis::T => declared.times = size,
                Axis::C => declared.channels = size,
                _ => declared.z = size,
            }
        }
        Ok((declared, note))
    }

    /// Axes longer than 1 before those of a page, which stand last: y and x, and the samples of a pixel.
    fn named_before_page(&self, axes: &str, format: &PageFormat) -> Result<Vec<(char, u32)>, String> {
        let mut rest: Vec<(char, u32)> = axes.chars().zip(self.shape.iter().copied()).collect();
        if axes.chars().count() != self.shape.len() {
            return Err(format!("has {} axes '{axes}' for the shape {:?}", axes.chars().count(), self.shape));
        }
        let unfit = || format!("has the shape {}, which pages of {format} do not fit", self.words());
        for (letters, size) in axes_of_page(format) {
            while rest.last().is_some_and(|(letter, n)| *n == 1 && !letters.contains(letter)) {
                rest.pop();
            }
            rest.pop().filter(|(letter, n)| letters.contains(letter) && *n == size).ok_or_else(unfit)?;
        }
        rest.retain(|(_, size)| *size > 1);
        Ok(rest)
    }

    /// Like [`Self::named_before_page`], for axes without names.
    fn unnamed_before_page(&self, format: &PageFormat) -> Result<Vec<(char, u32)>, String> {
        let mut rest = self.shape.clone();
        let of_page = axes_of_page(format).into_iter().map(|(_, size)| size);
        // Axes of length 1 may be left out, or be there.
        for size in of_page.filter(|size| *size > 1) {
            while rest.last() == Some(&1) {
                rest.pop();
            }
            if rest.pop() != Some(size) {
                return Err(format!("has the shape {:?}, which pages of {format} do not fit", self.shape));
            }
        }
        Ok(rest.into_iter().filter(|size| *size > 1).map(|size| (UNSAID, size)).collect())
    }

    fn words(&self) -> String {
        let axes = self.axes.as_ref().map_or(" without axes".into(), |axes| format!(" of the axes '{axes}'"));
        format!("{:?}{axes}", self.shape)
    }
}

/// Letters and size of each axis of a page, fastest first.
fn axes_of_page(format: &PageFormat) -> Vec<(&'static [char], u32)> {
    let [x, y, s]: [(&[char], u32); 3] =
        [(&['X'], format.width), (&['Y'], format.height), (&['S', 'C'], format.samples.into())];
    match (format.samples, format.planar) {
        (1, _) => vec![x, y],
        (_, false) => vec![s, x, y],
        (_, true) => vec![x, y, s],
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::element::Element;
    use crate::testing::{is_warned, said};
    use brickyard_volume::TimeAxis;
    use brickyard_volume::VoxelType;

    fn format(samples: u16, planar: bool) -> PageFormat {
        let element = Element::Voxel(VoxelType::U16);
        PageFormat {
            width: 9,
            height: 7,
            element,
            samples,
            planar,
            white_is_zero: false,
            is_rgb: false,
            is_palette: false,
            turn: Default::default(),
        }
    }

    fn gray(text: &str) -> Description {
        read(text, &format(1, false), &ScaleTags::default())
    }

    #[test]
    fn letters_are_steps_channels_and_slices() {
        let declared = |text: &str| {
            let d = gray(text).declared.unwrap_or_else(|| panic!("{text}"));
            (d.page_axes, [d.times, d.channels, d.z])
        };
        use Axis::*;
        for (text, axes, sizes) in [
            (r#"{"shape": [3, 4, 7, 9], "axes": "TZYX"}"#, vec![T, Z], [3, 1, 4]),
            (r#"{"shape": [3, 4, 7, 9], "axes": "CZYX"}"#, vec![C, Z], [1, 3, 4]),
            (r#"{"shape": [2, 3, 4, 7, 9], "axes": "zctyx"}"#, vec![Z, C, T], [4, 3, 2]),
            (r#"{"shape": [5, 1, 7, 9, 1], "axes": "TZYXS"}"#, vec![T], [5, 1, 1]),
            (r#"{"shape": [5, 7, 9], "axes": "SYX"}"#, vec![C], [1, 5, 1]),
            (r#"{"shape": [5, 7, 9], "axes": "QYX"}"#, vec![Z], [1, 1, 5]),
            (r#"{"shape": [7, 9], "axes": "YX"}"#, vec![], [1, 1, 1]),
            (r#"{"shape": [5, 7, 9]}"#, vec![Z], [1, 1, 5]),
            (r#"{"shape": [1, 5, 1, 7, 9, 1]}"#, vec![Z], [1, 1, 5]),
            ("shape=(5, 7, 9)", vec![Z], [1, 1, 5]),
            ("shape=(7, 9)", vec![], [1, 1, 1]),
        ] {
            // Axes of length 1 have no place.
            let (found, counts) = declared(text);
            assert_eq!((found, counts), (axes, sizes), "{text}");
        }
        assert!(gray(r#"{"shape": [5, 7, 9], "axes": "IYX"}"#).notes[0].contains("axis I"));
    }

    #[test]
    fn samples_are_a_pages_own_axis() {
        for (text, samples, planar, sizes) in [
            (r#"{"shape": [5, 7, 9, 3], "axes": "TYXS"}"#, 3, false, [5, 1]),
            (r#"{"shape": [5, 7, 9, 3], "axes": "TYXC"}"#, 3, false, [5, 1]),
            (r#"{"shape": [5, 3, 7, 9], "axes": "TCYX"}"#, 3, true, [5, 1]),
            (r#"{"shape": [2, 5, 3, 7, 9], "axes": "CTSYX"}"#, 3, true, [5, 2]),
        ] {
            let d = read(text, &format(samples, planar), &ScaleTags::default()).declared.unwrap();
            assert_eq!([d.times, d.channels], sizes, "{text}");
        }
        let bare = read(r#"{"shape": [5, 7, 9, 3]}"#, &format(3, false), &ScaleTags::default()).declared.unwrap();
        assert_eq!(bare.z, 5);
    }

    #[test]
    fn what_cannot_be_followed_is_told() {
        for (text, words) in [
            (r#"{"shape": [3, 4, 7, 9]}"#, "name every axis of the shape [3, 4, 7, 9] without axes"),
            (r#"{"shape": [3, 4, 7, 9], "axes": "IZYX"}"#, "of the axes 'IZYX'"),
            (r#"{"shape": [3, 7, 9], "axes": "AYX"}"#, "of the axes 'AYX'"),
            (r#"{"shape": [3, 4, 7, 9], "axes": "ZZYX"}"#, "two axes along Z"),
            (r#"{"shape": [3, 4, 7, 9], "axes": "CSYX"}"#, "two axes along C"),
            (r#"{"shape": [3, 7, 9], "axes": "ZXY"}"#, "do not fit"),
            (r#"{"shape": [3, 7, 8], "axes": "ZYX"}"#, "do not fit"),
            (r#"{"shape": [3, 7, 8]}"#, "do not fit"),
            (r#"{"shape": [3, 7, 9], "axes": "YX"}"#, "2 axes"),
            (r#"{"shape": [0, 7, 9]}"#, "no pixels"),
            (r#"{"shape": [-1, 7, 9]}"#, "other than a list of sizes"),
            (r#"{"shape": 5}"#, "other than a list of sizes"),
            (r#"{"shape": [5, 7, 9]"#, "not JSON"),
            ("shape=(5, x)", "has the shape"),
        ] {
            let problem = gray(text).problem.unwrap_or_else(|| panic!("{text}"));
            assert!(problem.contains(words) && problem.contains("`axes`"), "{problem}");
        }
        assert!(!is_shaped(r#"{"mibi.": 1, "shape": [5]}"#) && !is_shaped(r#"{"a": 1}"#) && !is_shaped("shape"));
    }

    #[test]
    fn spacing_and_times_are_taken() {
        let place = |more: &str, resolution| {
            let tags = ScaleTags { resolution, ..ScaleTags::default() };
            let text = format!(r#"{{"shape": [3, 4, 7, 9], "axes": "TZYX", {more}}}"#);
            let d = read(&text, &format(1, false), &tags);
            (d.spacing.map(|s| [s.x, s.y, s.z.unwrap_or(0.0)]), d.unit, d.time)
        };
        let micrometres = Some("micrometer");
        assert_eq!(
            place(r#""spacing": 2.5, "unit": "um""#, Some([4.0, 2.0])),
            (Some([0.25, 0.5, 2.5]), micrometres, None)
        );
        assert_eq!(place(r#""spacing": "2.5""#, None), (Some([1.0, 1.0, 2.5]), None, None));
        let ome = r#""PhysicalSizeX": 0.5, "PhysicalSizeY": 0.25, "PhysicalSizeYUnit": "um", "PhysicalSizeZ": 2"#;
        assert_eq!(place(ome, None), (Some([0.5, 0.25, 2.0]), micrometres, None));
        assert_eq!(place(r#""PhysicalSizeX": 0.5"#, None).0, Some([0.5, 0.5, 0.0]));
        let axis = Some(TimeAxis { step: 0.5, unit: Some("second".into()), ..TimeAxis::default() });
        assert_eq!(place(r#""finterval": 0.5"#, None), (None, None, axis));
        // Lengths in a unit, beside one in none.
        let tags = ScaleTags { resolution: Some([2e4, 2e4]), unit: Some(3), ..ScaleTags::default() };
        let mixed = read(r#"{"shape": [4, 7, 9], "axes": "ZYX", "spacing": 3e-4}"#, &format(1, false), &tags);
        assert!(mixed.spacing.is_none() && mixed.notes[0].contains("has no unit"), "{:?}", mixed.notes);
        assert!(is_warned(&said(&mixed.notes), "has no unit"));
        // Defaults of writers.
        assert_eq!(place(r#""unit": "um""#, Some([1.0, 1.0])).0, None);
        for odd in [r#""spacing": -0.0"#, r#""spacing": [1]"#, r#""PhysicalSizeX": "NaN""#, r#""finterval": "x""#] {
            assert_eq!(place(odd, None), (None, None, None), "{odd}");
        }
    }
}
