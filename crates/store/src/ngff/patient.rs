//! The system of a patient in OME-Zarr 0.6, of a store with an orientation: its axes, and the matrix to it from the
//! system of spacing and origin.

use crate::error::OpenError;
use crate::metadata::{parse_info, parse_placement, parse_unchecked_geometry};
use serde_json::{Value, json};
use std::path::Path;

/// Name of the system.
pub(super) const PATIENT: &str = "patient";

/// Numbers of the matrix may be rounded by another machine's arithmetic.
const TOLERANCE: f64 = 1e-9;

/// A store's place in a patient.
pub(super) struct Patient {
    /// From x, y, z of spacing and origin to millimetres to the right, front and head.
    rows: [[f64; 4]; 3],
}

impl Patient {
    /// The place said by a root document of the form of 0.5; `None` without an orientation.
    ///
    /// # Errors
    /// If it is no store's, or the orientation does not fit.
    pub(super) fn of(path: &Path, root: &Value) -> Result<Option<Self>, OpenError> {
        if root["attributes"]["brickyard"]["orientation"].is_null() {
            return Ok(None);
        }
        let info = parse_info(path, root)?;
        let geometry = parse_unchecked_geometry(path, root, &info)?;
        Ok(Some(Self { rows: parse_placement(path, &info, &geometry)?.rows() }))
    }

    /// The system with axes made of those of the store, and the transformation to it, from the system `from`.
    pub(super) fn system_and_transformation(&self, axes: &Value, from: &str) -> (Value, Value) {
        let axes = axes.as_array().map_or(&[][..], |axes| axes);
        let system = json!({ "name": PATIENT, "axes": axes.iter().map(of_patient).collect::<Vec<Value>>() });
        let transformation = json!({
            "type": "affine",
            "input": { "name": from },
            "output": { "name": PATIENT },
            "affine": affine(axes.len(), self.rows),
        });
        (system, transformation)
    }

    /// The finding of [`found`] in a document with this patient.
    pub(super) fn document(&self, axes: &Value) -> Value {
        let (system, transformation) = self.system_and_transformation(axes, "");
        json!({ "axes": system["axes"], "affine": transformation["affine"] })
    }
}

/// Axes and matrix of the patient's system in a document of 0.6; null if absent.
pub(super) fn found(root: &Value) -> Value {
    let multiscale = &root["attributes"]["ome"]["multiscales"][0];
    let one = |list: &str, is_it: fn(&Value) -> bool| {
        let found = multiscale[list].as_array().into_iter().flatten().find(|entry| is_it(entry));
        found.cloned().unwrap_or_default()
    };
    let system = one("coordinateSystems", |system| system["name"] == PATIENT);
    let transformation = one("coordinateTransformations", |transform| transform["output"]["name"] == PATIENT);
    json!({ "axes": system["axes"], "affine": transformation["affine"] })
}

/// The first difference of what [`found`] finds from the expected.
pub(super) fn difference(expected: &Value, found: &Value) -> Option<String> {
    let [system, matrix] = ["axes", "affine"].map(|part| (&expected[part], &found[part]));
    let most = numbers(matrix.0).into_iter().fold(0.0, |most: f64, number| most.max(number.abs()));
    let is_near = {
        let (a, b) = (numbers(matrix.0), numbers(matrix.1));
        a.len() == b.len() && a.iter().zip(&b).all(|(a, b)| (a - b).abs() <= TOLERANCE * most)
    };
    let field = "attributes.ome.multiscales[0]: the system 'patient'";
    if system.0 != system.1 {
        return Some(format!("{field}: expected axes {}, found {}", system.0, system.1));
    }
    (!is_near).then(|| format!("{field}: expected the matrix {}, found {}", matrix.0, matrix.1))
}

fn numbers(matrix: &Value) -> Vec<f64> {
    let rows = matrix.as_array().into_iter().flatten();
    rows.flat_map(|row| row.as_array().into_iter().flatten())
        .map(|number| number.as_f64().unwrap_or(f64::NAN))
        .collect()
}

/// An axis in the system of a patient. Directions of x, y, z are told as in RFC 4, which readers of 0.6 may ignore.
fn of_patient(axis: &Value) -> Value {
    let towards = match axis["name"].as_str() {
        Some("x") => "left-to-right",
        Some("y") => "posterior-to-anterior",
        Some("z") => "inferior-to-superior",
        _ => return axis.clone(),
    };
    let orientation = json!({ "type": "anatomical", "value": towards });
    json!({ "name": axis["name"], "type": "space", "unit": "millimeter", "orientation": orientation })
}

/// The matrix over all axes, of which z, y, x are the last: a row for each, with the offset at its end.
fn affine(axes: usize, rows: [[f64; 4]; 3]) -> Vec<Vec<f64>> {
    let others = axes.saturating_sub(3);
    let row = |i: usize| -> Vec<f64> {
        let mut row = vec![0.0; axes + 1];
        if i < others {
            row[i] = 1.0;
            return row;
        }
        let from = rows[2 - (i - others)];
        for (place, of_axis) in row[others..].iter_mut().zip([from[2], from[1], from[0], from[3]]) {
            *place = of_axis;
        }
        row
    };
    (0..axes).map(row).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_matrix_of_x_y_z_becomes_one_of_all_axes_in_their_order() {
        let rows = [[1.0, 2.0, 3.0, 4.0], [5.0, 6.0, 7.0, 8.0], [9.0, 10.0, 11.0, 12.0]];
        assert_eq!(
            affine(4, rows),
            [
                [1.0, 0.0, 0.0, 0.0, 0.0],
                [0.0, 11.0, 10.0, 9.0, 12.0],
                [0.0, 7.0, 6.0, 5.0, 8.0],
                [0.0, 3.0, 2.0, 1.0, 4.0],
            ]
        );
    }
}
