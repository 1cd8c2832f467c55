//! Axes of an image in OME-Zarr: names, types, units and anatomical directions, and the letters that follow. Costs a few texts.

use super::field::Field;
use crate::axes::{Axis, AxisOrder};
use crate::cf::axes::letter_of;
use crate::error::Result;
use brickyard_volume::counted;

/// Most axes of an image: those of OME-Zarr are 5, to which others add a few.
const MOST_AXES: usize = 16;

/// An axis, as the document tells.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct ImageAxis {
    pub(super) name: String,
    /// `time`, `channel`, `space` or another type.
    pub(super) kind: Option<String>,
    pub(super) unit: Option<String>,
    /// The direction in which its coordinate grows in a body: `left-to-right`.
    pub(super) direction: Option<String>,
}

/// The axes of 0.1 and 0.2, which do not tell them.
pub(super) fn axes_of_old() -> Vec<ImageAxis> {
    let named = |name: &str| ImageAxis { name: name.into(), ..ImageAxis::default() };
    ["t", "c", "z", "y", "x"].map(named).into()
}

/// Reads a list of axes: names, as in 0.3, or objects.
///
/// # Errors
/// If it is none.
pub(super) fn read_axes(list: &Field<'_>) -> Result<Vec<ImageAxis>> {
    let axis = |item: &Field<'_>| {
        if let Some(name) = item.as_text() {
            return Ok(ImageAxis { name: name.into(), ..ImageAxis::default() });
        }
        let text = |name: &str| item.get(name).and_then(|field| field.as_text()).map(str::to_owned);
        let name = item.need("name", "the name of an axis")?.text("the name of an axis")?.to_owned();
        let direction = item.get("orientation");
        let direction = direction.and_then(|said| said.get("value").unwrap_or(said).as_text());
        Ok(ImageAxis { name, kind: text("type"), unit: text("unit"), direction: direction.map(str::to_owned) })
    };
    let axes: Vec<ImageAxis> = list.items("a list of axes")?.iter().map(axis).collect::<Result<_>>()?;
    match axes.len() {
        2..=MOST_AXES => Ok(axes),
        _ => Err(list.invalid(&format!("2 to {MOST_AXES} axes"))),
    }
}

/// The letters of axes by their types and names; `None` for axes of no letter. Axes of space without a known name become those left, the last
/// one x.
pub(super) fn letters_of(axes: &[ImageAxis]) -> Vec<Option<Axis>> {
    let is_spatial = |axis: &Axis| matches!(axis, Axis::X | Axis::Y | Axis::Z);
    let told = |axis: &ImageAxis| match axis.kind.as_deref() {
        Some("time") => Some(Axis::T),
        Some("channel") => Some(Axis::C),
        Some("space") => letter_of(&axis.name).filter(is_spatial),
        // Axes of an array tell no more than their names.
        None | Some("array") => letter_of(&axis.name),
        // A type of its own is not one of space, whatever its name.
        Some(_) => letter_of(&axis.name).filter(|axis| !is_spatial(axis)),
    };
    let mut letters: Vec<Option<Axis>> = axes.iter().map(told).collect();
    for at in 0..letters.len() {
        if letters[..at].contains(&letters[at]) {
            letters[at] = None;
        }
    }
    let free = [Axis::X, Axis::Y, Axis::Z].into_iter().filter(|axis| !letters.contains(&Some(*axis)));
    let free: Vec<Axis> = free.collect();
    let may_be_space = |axis: &ImageAxis| axis.kind.as_deref().is_none_or(|kind| ["space", "array"].contains(&kind));
    let unknown = (0..axes.len()).rev().filter(|at| letters[*at].is_none() && may_be_space(&axes[*at]));
    let unknown: Vec<usize> = unknown.collect();
    unknown.into_iter().zip(free).for_each(|(at, axis)| letters[at] = Some(axis));
    letters
}

/// An axis for a message: its name, and a type that none of the letters has.
fn in_words(axis: &ImageAxis) -> String {
    match axis.kind.as_deref() {
        None | Some("time" | "channel" | "space") => axis.name.clone(),
        Some(kind) => format!("{} (of type {:?})", axis.name, kind.chars().take(20).collect::<String>()),
    }
}

/// The letters of an array's axes: the caller's, or the document's. Axes of one element and of no letter have none.
///
/// # Errors
/// If two axes have one name, a longer axis has no letter, or x or y is missing: the caller's `axes` give them.
pub(super) fn arrange(
    axes: &[ImageAxis],
    shape: &[u64],
    told: Option<&AxisOrder>,
) -> Result<Vec<Option<Axis>>, String> {
    let names: Vec<&str> = axes.iter().map(|axis| axis.name.as_str()).collect();
    let said = format!("{} of {shape:?}", axes.iter().map(in_words).collect::<Vec<_>>().join(", "));
    if let Some(told) = told {
        return match told.axes().len() == shape.len() {
            true => Ok(told.axes().iter().copied().map(Some).collect()),
            false => Err(format!("`axes` '{told}': the image has {}, {said}", counted(shape.len() as u64, "axis"))),
        };
    }
    if let Some(at) = (0..names.len()).find(|at| names[..*at].contains(&names[*at])) {
        return Err(format!(
            "two axes have the name '{}' (axes {said}); name all with `axes`, slowest first, such as zyx",
            names[at]
        ));
    }
    let letters = letters_of(axes);
    if let Some(at) = (0..shape.len()).find(|at| letters[*at].is_none() && shape[*at] != 1) {
        return Err(format!(
            "the axis '{}' of {} is none of time, channels or x, y, z (axes {said}); name all with `axes`, slowest first, such as tczyx",
            names[at], shape[at]
        ));
    }
    match [Axis::X, Axis::Y].iter().all(|axis| letters.contains(&Some(*axis))) {
        true => Ok(letters),
        false => Err(format!("axes {said} have no x or y; name all with `axes`, slowest first, such as zyx")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::{Value, json};
    use std::path::Path;

    fn read(list: &Value) -> Result<Vec<ImageAxis>, String> {
        read_axes(&Field::new(Path::new("zarr.json"), "axes".into(), list)).map_err(|error| error.to_string())
    }

    fn letters(list: Value, shape: &[u64], told: Option<&str>) -> Result<String, String> {
        let told = told.map(|told| told.parse().unwrap());
        let letters = arrange(&read(&list)?, shape, told.as_ref())?;
        Ok(letters.into_iter().map(|axis| axis.map_or('-', Axis::letter)).collect())
    }

    #[test]
    fn letters_follow_types_and_names_in_any_order() {
        let space = |name: &str| json!({ "name": name, "type": "space" });
        for (list, expected) in [
            (json!(["t", "c", "z", "y", "x"]), "tczyx"),
            (json!(["x", "y", "z"]), "xyz"),
            (json!([{ "name": "frame", "type": "time" }, space("y"), space("x")]), "tyx"),
            (json!([space("z"), space("y"), space("x"), { "name": "marker", "type": "channel" }]), "zyxc"),
            (json!([space("i"), space("j"), space("k")]), "zyx"),
            (json!([space("dim_0"), space("y"), space("x")]), "zyx"),
            (json!([space("lat"), space("lon")]), "yx"),
            (json!([{ "name": "dim_0", "type": "array" }, { "name": "dim_1", "type": "array" }]), "yx"),
            (json!([{ "name": "T" }, { "name": "C" }, { "name": "Y" }, { "name": "X" }]), "tcyx"),
        ] {
            let count = list.as_array().unwrap().len();
            assert_eq!(letters(list.clone(), &vec![2; count], None).as_deref(), Ok(expected), "{list}");
        }
        let angle = json!([{ "name": "angle", "type": "angle" }, space("y"), space("x")]);
        assert_eq!(letters(angle.clone(), &[1, 2, 3], None).as_deref(), Ok("-yx"));
        assert!(letters(angle.clone(), &[4, 2, 3], None).unwrap_err().contains("'angle' of 4 is none of time"));
        assert_eq!(letters(angle.clone(), &[4, 2, 3], Some("zyx")).as_deref(), Ok("zyx"));
        assert!(letters(angle, &[4, 2, 3], Some("yx")).unwrap_err().contains("the image has 3 axes"));
        assert!(letters(json!([space("z"), { "name": "c" }]), &[2, 2], None).unwrap_err().contains("no x or y"));
        let strange = json!([{ "name": "y", "type": "invalid" }, space("x")]);
        let message = letters(strange, &[1, 2], None).unwrap_err();
        assert!(message.contains("axes y (of type \"invalid\"), x of [1, 2] have no x or y"), "{message}");
        let twice = json!([space("x"), space("x")]);
        assert!(letters(twice.clone(), &[2, 3], None).unwrap_err().contains("two axes have the name 'x'"));
        assert_eq!(letters(twice, &[2, 3], Some("yx")).as_deref(), Ok("yx"));
    }

    #[test]
    fn units_and_directions_are_read_and_damage_has_its_place() {
        let list = json!([
            { "name": "y", "type": "space", "unit": "micrometer", "orientation": { "type": "anatomical", "value": "anterior-to-posterior" } },
            { "name": "x", "type": "space", "unit": null }
        ]);
        let axes = read(&list).unwrap();
        assert_eq!(
            (axes[0].unit.as_deref(), axes[0].direction.as_deref()),
            (Some("micrometer"), Some("anterior-to-posterior"))
        );
        assert_eq!((axes[1].unit.as_deref(), axes[1].direction.as_deref()), (None, None));
        for (list, expected) in [
            (json!("zyx"), "zarr.json: axes: expected a list of axes, found \"zyx\""),
            (json!(["x"]), "axes: expected 2 to 16 axes"),
            (json!(["y", { "type": "space" }]), "axes[1].name: is missing, expected the name of an axis"),
            (json!(["y", { "name": 3 }]), "axes[1].name: expected the name of an axis, found 3"),
        ] {
            assert!(read(&list).unwrap_err().contains(expected), "{list}");
        }
    }
}
