//! Transformations of OME-Zarr's coordinates: those of 0.4 to 0.6 that are affine, as one map. Others are named, for a note.

use super::affine::Affine;
use super::field::Field;
use crate::error::{ImportError, Result};

/// Largest difference of a rotation from one: rows of length 1, at right angles.
const NOT_ROTATED: f64 = 1e-3;

/// Most coordinates of a transformation: an image has five axes at most.
const MOST_AXES: usize = 16;

/// Most transformations within one another.
const DEEPEST: usize = 16;

/// A transformation as a map of its axes.
pub(super) enum Transform {
    Map(Affine),
    /// Its kind, which is no affine map or lies in an array of its own.
    Other(String),
}

/// Reads a transformation from axes of these names.
///
/// # Errors
/// If it is damaged.
pub(super) fn read(field: &Field<'_>, inputs: &[String]) -> Result<Transform> {
    read_at(field, inputs, 0)
}

fn read_at(field: &Field<'_>, inputs: &[String], depth: usize) -> Result<Transform> {
    let kind = field.need("type", "the kind of a transformation")?.text("the kind of a transformation")?;
    let count = inputs.len();
    if field.get("path").is_some() {
        return Ok(Transform::Other(format!("{kind} in an array")));
    }
    if count > MOST_AXES {
        return Err(field.invalid(&format!("at most {MOST_AXES} coordinates")));
    }
    if depth > DEEPEST {
        return Err(field.invalid("fewer transformations within one another"));
    }
    let numbers = || field.need(kind, "a number for each axis")?.numbers(Some(count));
    let map = match kind {
        "identity" => Affine::identity(count),
        "scale" => Affine::scale(&numbers()?),
        "translation" => Affine::translation(&numbers()?),
        "affine" => affine(&field.need("affine", "rows of numbers")?, count)?,
        "rotation" => rotation(&field.need("rotation", "rows of numbers")?, count)?,
        "mapAxis" => permutation(&field.need("mapAxis", "an axis for each axis")?, inputs)?,
        "sequence" => return sequence(field, inputs, depth),
        "bijection" => return read_at(&field.need("forward", "a transformation")?, inputs, depth + 1),
        "byDimension" => return by_dimension(field, inputs, depth),
        other => return Ok(Transform::Other(other.chars().take(40).collect())),
    };
    Ok(Transform::Map(map))
}

/// Reads transformations that follow one another. The list may be a dataset's, or a sequence's.
///
/// # Errors
/// If one is damaged, or they do not fit together.
pub(super) fn read_list(list: &Field<'_>, inputs: &[String]) -> Result<Transform> {
    list_at(list, inputs, 0)
}

fn sequence(field: &Field<'_>, inputs: &[String], depth: usize) -> Result<Transform> {
    list_at(&field.need("transformations", "a list of transformations")?, inputs, depth + 1)
}

fn list_at(list: &Field<'_>, inputs: &[String], depth: usize) -> Result<Transform> {
    let mut map = Affine::identity(inputs.len());
    for item in list.items("a list of transformations")? {
        // Between two of them, axes that stay keep their names.
        let names = if map.outputs() == inputs.len() { inputs.to_vec() } else { vec![String::new(); map.outputs()] };
        match read_at(&item, &names, depth)? {
            Transform::Map(next) => {
                let unfit = || item.invalid("finite numbers, one for each axis of the transformation before");
                map = map.then(&next).ok_or_else(unfit)?;
            }
            other => return Ok(other),
        }
    }
    Ok(Transform::Map(map))
}

/// Rows of numbers, or all of them in one list, as in drafts.
fn rows_of(field: &Field<'_>, columns: usize) -> Result<Vec<Vec<f64>>> {
    let items = field.items("rows of numbers")?;
    if items.iter().all(Field::is_list) {
        return items.iter().map(|row| row.numbers(Some(columns))).collect();
    }
    let numbers = field.numbers(None)?;
    Ok(numbers.chunks(columns).map(<[f64]>::to_vec).collect())
}

fn affine(field: &Field<'_>, count: usize) -> Result<Affine> {
    let rows = rows_of(field, count + 1)?;
    let expected = format!("rows of {} numbers", count + 1);
    Affine::of_rows(rows, count).filter(|map| map.outputs() > 0).ok_or_else(|| field.invalid(&expected))
}

fn rotation(field: &Field<'_>, count: usize) -> Result<Affine> {
    let mut rows = rows_of(field, count)?;
    let is_square = rows.len() == count && rows.iter().all(|row| row.len() == count);
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let is_one = is_square
        && (0..count)
            .all(|i| (0..count).all(|j| (dot(&rows[i], &rows[j]) - f64::from(u8::from(i == j))).abs() <= NOT_ROTATED));
    rows.iter_mut().for_each(|row| row.push(0.0));
    let map = Affine::of_rows(rows, count).filter(|_| is_one);
    map.ok_or_else(|| field.invalid(&format!("{count} rows of {count} numbers, a rotation")))
}

/// Axes by number, or by name, as in drafts.
fn axes_of(field: &Field<'_>, names: &[String]) -> Result<Vec<usize>> {
    let axis = |item: &Field<'_>| {
        let by_name = || names.iter().position(|name| Some(name.as_str()) == item.as_text());
        let number = item.as_whole().and_then(|number| usize::try_from(number).ok());
        number.or_else(by_name).ok_or_else(|| item.invalid("the number of an axis"))
    };
    field.items("numbers of axes")?.iter().map(axis).collect()
}

fn permutation(field: &Field<'_>, inputs: &[String]) -> Result<Affine> {
    // Drafts name each output, and the input behind it.
    let order = match field.as_object() {
        Some(named) => {
            let of = |name: &String| {
                let input = named.get(name)?.as_str()?;
                inputs.iter().position(|other| other == input)
            };
            inputs.iter().map(of).collect::<Option<Vec<usize>>>()
        }
        None => Some(axes_of(field, inputs)?),
    };
    let is_whole =
        |order: &Vec<usize>| order.len() == inputs.len() && (0..inputs.len()).all(|axis| order.contains(&axis));
    let expected = format!("each axis from 0 to {} once", inputs.len().saturating_sub(1));
    order.filter(is_whole).and_then(|order| Affine::permutation(&order)).ok_or_else(|| field.invalid(&expected))
}

/// Transformations of some axes each.
fn by_dimension(field: &Field<'_>, inputs: &[String], depth: usize) -> Result<Transform> {
    let items = field.need("transformations", "a list of transformations")?;
    let mut rows: Vec<Option<Vec<f64>>> = Vec::new();
    for item in items.items("a list of transformations")? {
        let axes = |name: &str, draft: &str| {
            let axes = item.get(name).or_else(|| item.get(draft));
            axes_of(&axes.map_or_else(|| item.need(name, "numbers of axes"), Ok)?, inputs)
        };
        let (from, to) = (axes("inputAxes", "input_axes")?, axes("outputAxes", "output_axes")?);
        let names: Option<Vec<String>> = from.iter().map(|axis| inputs.get(*axis).cloned()).collect();
        let names = names.ok_or_else(|| item.invalid("axes that the image has"))?;
        // Drafts have the transformation's members beside the axes.
        let of_axes = item.get("transformation").unwrap_or_else(|| item.clone());
        let map = match read_at(&of_axes, &names, depth + 1)? {
            Transform::Map(map) => map,
            other => return Ok(other),
        };
        let is_new = |axis: &usize| *axis < inputs.len() && rows.get(*axis).is_none_or(Option::is_none);
        if map.outputs() != to.len() || !to.iter().all(is_new) {
            return Err(item.invalid("one output axis for each axis of its transformation, and each axis once"));
        }
        for (output, axis) in to.iter().enumerate() {
            let mut row = vec![0.0; inputs.len() + 1];
            from.iter().enumerate().for_each(|(input, axis)| row[*axis] += map.factor(output, input));
            row[inputs.len()] = map.offset(output);
            rows.resize(rows.len().max(axis + 1), None);
            rows[*axis] = Some(row);
        }
    }
    let rows: Option<Vec<Vec<f64>>> = rows.into_iter().collect();
    let map = rows.and_then(|rows| Affine::of_rows(rows, inputs.len()));
    map.map(Transform::Map).ok_or_else(|| {
        let problem = format!("{}: leaves out an output axis", items.at());
        ImportError::invalid(field.file(), problem)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::{Value, json};
    use std::path::Path;

    fn map_of(transform: Value, inputs: &[&str]) -> Result<Vec<Vec<f64>>, String> {
        let inputs: Vec<String> = inputs.iter().map(|name| (*name).into()).collect();
        let field = Field::new(Path::new("zarr.json"), "a".into(), &transform);
        match read(&field, &inputs) {
            Ok(Transform::Map(map)) => Ok((0..map.outputs())
                .map(|row| (0..map.inputs()).map(|column| map.factor(row, column)).chain([map.offset(row)]).collect())
                .collect()),
            Ok(Transform::Other(kind)) => Err(format!("other {kind}")),
            Err(error) => Err(error.to_string()),
        }
    }

    /// The examples of the specification of 0.6.
    #[test]
    fn the_kinds_of_0_6_are_affine_maps() {
        let sequence = json!({ "type": "sequence", "input": {"name": "in"}, "output": {"name": "out"}, "transformations": [
            { "type": "translation", "translation": [0.1, 0.9] }, { "type": "scale", "scale": [2, 3] }
        ] });
        assert_eq!(map_of(sequence, &["j", "i"]).unwrap(), [[2.0, 0.0, 0.2], [0.0, 3.0, 2.7]]);
        let swapped = json!({ "type": "mapAxis", "mapAxis": [1, 0] });
        assert_eq!(map_of(swapped, &["j", "i"]).unwrap(), [[0.0, 1.0, 0.0], [1.0, 0.0, 0.0]]);
        let rotation = json!({ "type": "rotation", "rotation": [[0, -1], [1, 0]] });
        assert_eq!(map_of(rotation, &["j", "i"]).unwrap(), [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0]]);
        let affine = json!({ "type": "affine", "affine": [[1, 0, 0, 0], [0, 1, 2, 3], [0, 4, 5, 6]] });
        assert_eq!(map_of(affine, &["k", "j", "i"]).unwrap()[1], [0.0, 1.0, 2.0, 3.0]);
        let by_dimension = json!({ "type": "byDimension", "transformations": [
            { "transformation": { "type": "translation", "translation": [0.5, 1.5] }, "inputAxes": [3, 2], "outputAxes": [1, 2] },
            { "transformation": { "type": "scale", "scale": [2] }, "inputAxes": [1], "outputAxes": [0] }
        ] });
        assert_eq!(
            map_of(by_dimension, &["l", "j", "k", "i"]).unwrap(),
            [[0.0, 2.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0, 0.5], [0.0, 0.0, 1.0, 0.0, 1.5]]
        );
        let both = json!({ "type": "bijection", "forward": { "type": "scale", "scale": [4] }, "inverse": {} });
        assert_eq!(map_of(both, &["x"]).unwrap(), [[4.0, 0.0]]);
        assert_eq!(map_of(json!({ "type": "identity" }), &["x"]).unwrap(), [[1.0, 0.0]]);
    }

    /// The forms of the drafts before it, which the published conformance cases still have.
    #[test]
    fn drafts_are_read() {
        let draft = json!({ "type": "byDimension", "transformations": [
            { "type": "scale", "scale": [2], "input_axes": ["y"], "output_axes": ["y"] },
            { "type": "identity", "input_axes": ["x"], "output_axes": ["x"] }
        ] });
        assert_eq!(map_of(draft, &["y", "x"]).unwrap(), [[2.0, 0.0, 0.0], [0.0, 1.0, 0.0]]);
        let named = json!({ "type": "mapAxis", "mapAxis": { "y": "x", "x": "y" } });
        assert_eq!(map_of(named, &["y", "x"]).unwrap(), [[0.0, 1.0, 0.0], [1.0, 0.0, 0.0]]);
        let flat = json!({ "type": "affine", "affine": [1, 2, 3, 4, 5, 6] });
        assert_eq!(map_of(flat, &["y", "x"]).unwrap(), [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]);
    }

    #[test]
    fn what_is_no_affine_map_is_named_and_damage_has_its_place() {
        for (transform, expected) in [
            (json!({ "type": "displacements", "path": "d" }), "other displacements in an array"),
            (json!({ "type": "scale", "path": "d" }), "other scale in an array"),
            (json!({ "type": "warp" }), "other warp"),
            (
                json!({ "type": "scale", "scale": [1] }),
                "zarr.json: a.scale: expected 2 numbers, one for each axis, found [1]",
            ),
            (json!({ "type": "scale", "scale": [1, "2"] }), "a.scale: expected 2 numbers"),
            (json!({ "type": "scale" }), "a.scale: is missing"),
            (json!({ "scale": [1, 1] }), "a.type: is missing"),
            (json!({ "type": "mapAxis", "mapAxis": [0, 0] }), "a.mapAxis: expected each axis from 0 to 1 once"),
            (json!({ "type": "rotation", "rotation": [[2, 0], [0, 1]] }), "a.rotation: expected 2 rows of 2 numbers"),
            (json!({ "type": "affine", "affine": [[1, 2]] }), "a.affine[0]: expected 3 numbers"),
            (
                json!({ "type": "sequence", "transformations": [{ "type": "scale", "scale": [1, 2] }, { "type": "affine", "affine": [] }] }),
                "a.transformations[1].affine: expected rows of 3 numbers",
            ),
            (
                json!({ "type": "byDimension", "transformations": [
                    { "transformation": { "type": "identity" }, "inputAxes": [0], "outputAxes": [1] }
                ] }),
                "a.transformations: leaves out an output axis",
            ),
            (
                json!({ "type": "byDimension", "transformations": [
                    { "transformation": { "type": "identity" }, "inputAxes": [0], "outputAxes": [2] }
                ] }),
                "one output axis for each",
            ),
            (
                json!({ "type": "byDimension", "transformations": [
                    { "transformation": { "type": "identity" }, "inputAxes": [7], "outputAxes": [0] }
                ] }),
                "axes that the image has",
            ),
        ] {
            let message = map_of(transform, &["y", "x"]).unwrap_err();
            assert!(message.contains(expected), "{message}");
        }
        let mut deep = json!({ "type": "identity" });
        for _ in 0..40 {
            deep = json!({ "type": "sequence", "transformations": [deep] });
        }
        assert!(map_of(deep, &["x"]).unwrap_err().contains("fewer transformations within"));
    }
}
