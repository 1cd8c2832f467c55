//! 3D Slicer's volume properties: the text of a `.vp` file, and the JSON of a `.vp.json` file (Slicer 5.9 and later).
//!
//! The scalar opacity and the colours of the first component become the function. Lighting is left out. Opacity is collected
//! over the file's distance, in the text form over 1 (VTK's default, unchanged by Slicer).
//!
//! Gradient opacity becomes the function's, except a constant 1, which is dropped. VTK's mappers measure gradients in units of
//! the data over the mean of the three voxel spacings (`vtkVolumeShaderComposer`, `computeGradientDeclaration`: central
//! differences by `2 * spacing / mean`), so magnitudes are divided by this mean here. Two of VTK's habits are dropped: it
//! limits all magnitudes to a quarter of the data's range, and applies the factor to the opacity of one of its steps, so
//! pictures change with the step. Here it applies to the opacity over the unit distance, with the same result for VTK steps of
//! this length.
//!
//! The text has nine lines: interpolation, shade, diffuse, ambient, specular, specular power, then scalar opacity, gradient
//! opacity and colours, each as a count of numbers and the numbers themselves (`value alpha` or `value r g b`, repeated). As in
//! Slicer, points are sorted by value, and those at one value are a step.

use super::curve::{self, Node};
use super::imported::{Imported, Subject};
use super::{TransferError, TransferFunction, check_points, interpolate};
use crate::ensure::ensure;
use serde::Deserialize;
use serde_json::Value;

const FORM: &str = "a 3D Slicer volume property";

fn foreign(problem: String) -> TransferError {
    TransferError::Foreign { form: FORM, problem }
}

/// Whether a text may be a `.vp` file.
pub(super) fn is_text(text: &str) -> bool {
    text.split_whitespace().next().is_some_and(|word| word.parse::<f64>().is_ok())
}

/// Reads a `.vp` file.
pub(super) fn read_text(text: &str, subject: &Subject) -> Result<Imported, TransferError> {
    const HEAD: [&str; 6] = ["interpolation", "shade", "diffuse", "ambient", "specular", "specular power"];
    let mut lines = text.lines();
    for (i, name) in HEAD.into_iter().enumerate() {
        let line = lines.next().unwrap_or_default().trim();
        if !line.is_empty() && line.parse::<f64>().is_err() {
            return Err(foreign(format!("line {} ({name}): found '{line}', expected a number", i + 1)));
        }
    }
    let opacity = text_points::<2>("scalar opacity (line 7)", lines.next())?;
    let gradient = text_points::<2>("gradient opacity (line 8)", lines.next())?;
    let color = text_points::<4>("colours (line 9)", lines.next())?;
    let transfer = TransferFunction {
        gradient_opacity: by_world_unit(straight(gradient), subject),
        ..TransferFunction::new(curve::points(straight(color)), curve::points(straight(opacity)), 1.0)
    };
    Imported::checked(transfer, Vec::new())
}

/// A line of points: checked, but not sorted.
fn text_points<const N: usize>(list: &'static str, line: Option<&str>) -> Result<Vec<[f64; N]>, TransferError> {
    let bad = |found: String| foreign(format!("{list}: found {found}"));
    let mut words = line.unwrap_or_default().split_whitespace();
    let count = words.next().ok_or_else(|| bad("nothing, expected a count and that many numbers".into()))?;
    let no_count = |_| bad(format!("'{count}', expected the count of the following numbers"));
    let count: usize = count.parse().map_err(no_count)?;
    let number = |word: &str| word.parse::<f64>().map_err(|_| bad(format!("'{word}', expected a number")));
    let numbers = words.map(number).collect::<Result<Vec<f64>, _>>()?;
    let (points, rest) = numbers.as_chunks::<N>();
    let found = numbers.len();
    let miscounted = || bad(format!("{found} numbers, expected {count} by its count, a multiple of {N}"));
    ensure(found == count && rest.is_empty(), miscounted)?;
    check_points(list, points)?;
    Ok(points.to_vec())
}

fn straight<const N: usize>(points: Vec<[f64; N]>) -> Vec<Node<N>> {
    points.into_iter().map(|point| Node { point, midpoint: 0.5, sharpness: 0.0 }).collect()
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct File {
    volume_properties: Vec<VolumeProperty>,
}

#[derive(Deserialize)]
struct VolumeProperty {
    components: Vec<Component>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct Component {
    #[serde(default)]
    disable_gradient_opacity: bool,
    #[serde(default = "super::unit")]
    scalar_opacity_unit_distance: f64,
    rgb_transfer_function: Function<ColorPoint>,
    scalar_opacity: Function<OpacityPoint>,
    gradient_opacity: Option<Function<OpacityPoint>>,
}

#[derive(Deserialize)]
struct Function<P> {
    points: Vec<P>,
}

#[derive(Deserialize)]
struct OpacityPoint {
    x: f64,
    y: f64,
    #[serde(default = "half")]
    midpoint: f64,
    #[serde(default)]
    sharpness: f64,
}

#[derive(Deserialize)]
struct ColorPoint {
    x: f64,
    color: [f64; 3],
    #[serde(default = "half")]
    midpoint: f64,
    #[serde(default)]
    sharpness: f64,
}

fn half() -> f64 {
    0.5
}

/// Reads a `.vp.json` file.
pub(super) fn read_json(file: Value, subject: &Subject) -> Result<Imported, TransferError> {
    let file: File = serde_json::from_value(file).map_err(|error| foreign(error.to_string()))?;
    let property = file.volume_properties.first().ok_or_else(|| foreign("'volumeProperties' is empty".into()))?;
    let component = property.components.first().ok_or_else(|| foreign("'components' is empty".into()))?;
    let mut remarks = Vec::new();
    for (list, count) in
        [("volume properties", file.volume_properties.len()), ("components", property.components.len())]
    {
        if count > 1 {
            remarks.push(format!("the first of its {count} {list} is taken"));
        }
    }
    let color: Vec<[f64; 6]> = (component.rgb_transfer_function.points.iter())
        .map(|p| [p.x, p.color[0], p.color[1], p.color[2], p.midpoint, p.sharpness])
        .collect();
    check_points("rgbTransferFunction", &color)?;
    let node = |[x, r, g, b, midpoint, sharpness]: [f64; 6]| Node { point: [x, r, g, b], midpoint, sharpness };
    let gradient = match &component.gradient_opacity {
        Some(function) if !component.disable_gradient_opacity => opacities("gradientOpacity", function)?,
        _ => Vec::new(),
    };
    let opacity = opacities("scalarOpacity", &component.scalar_opacity)?;
    let distance = component.scalar_opacity_unit_distance;
    let bad_distance = || foreign(format!("'scalarOpacityUnitDistance' is {distance}, expected a positive number"));
    ensure(distance.is_finite() && distance > 0.0, bad_distance)?;
    let color = curve::points(color.into_iter().map(node).collect());
    let transfer = TransferFunction {
        gradient_opacity: by_world_unit(gradient, subject),
        ..TransferFunction::new(color, curve::points(opacity), distance)
    };
    Imported::checked(transfer, remarks)
}

fn opacities(list: &'static str, function: &Function<OpacityPoint>) -> Result<Vec<Node<2>>, TransferError> {
    let points: Vec<[f64; 4]> = function.points.iter().map(|p| [p.x, p.y, p.midpoint, p.sharpness]).collect();
    Node::opacities(list, &points)
}

/// Gradient opacity over magnitudes in world units; none where it is 1 everywhere.
fn by_world_unit(gradient: Vec<Node<2>>, subject: &Subject) -> Vec<[f64; 2]> {
    let points = curve::points(gradient);
    if points.iter().all(|point| point[1] == 1.0) {
        return Vec::new();
    }
    // No magnitude is below 0, where a curve may begin.
    let at_zero = points.iter().any(|point| point[0] < 0.0).then(|| interpolate(&points, 0.0));
    let others = points.into_iter().filter(|point| point[0] >= 0.0);
    at_zero.into_iter().chain(others).map(|[magnitude, factor]| [magnitude / subject.mean_spacing, factor]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::transfer::file::read;
    use crate::transfer::file::tests::SUBJECT;

    /// As written by Slicer 4 and 5.
    const TEXT: &str = "1\n1\n0.9\n0.1\n0.2\n10\n8 -3024 0 -16.4458 0 641.385 0.715686 3071 0.705882\n4 0 1 255 1\n\
        16 -3024 0 0 0 -16.4458 0.729412 0.254902 0.301961 641.385 0.905882 0.815686 0.552941 3071 1 1 1\n";

    /// As written by Slicer 5.9, in part.
    const JSON: &str = r#"{"@schema": "https://example.org/volume-property-schema-v1.0.0.json#", "volumeProperties": [{
        "effectiveRange": [0, 9], "interpolationType": "linear", "components": [{
            "shade": true, "lighting": {"diffuse": 1, "ambient": 0.2, "specular": 0, "specularPower": 1},
            "disableGradientOpacity": false, "scalarOpacityUnitDistance": 2.5,
            "rgbTransferFunction": {"type": "colorTransferFunction", "points": [
                {"x": 9, "color": [1, 1, 1], "midpoint": 0.5, "sharpness": 0},
                {"x": 1, "color": [1, 0, 0], "midpoint": 0.5, "sharpness": 1}]},
            "scalarOpacity": {"type": "piecewiseLinearFunction", "points": [
                {"x": -300.0, "y": 0.0}, {"x": -150.0, "y": 1.0}, {"x": -150.0, "y": 0.0}, {"x": 2000.0, "y": 0.0}]},
            "gradientOpacity": {"points": [{"x": 0, "y": 1}, {"x": 255, "y": 1}]}}]}]}"#;

    fn bad(text: &str) -> String {
        read(text, None, &SUBJECT).unwrap_err().to_string()
    }

    #[test]
    fn text_is_read() {
        for text in [TEXT.to_string(), TEXT.replace('\n', "\r\n"), TEXT.trim_end().to_string()] {
            let Imported { transfer, remarks } = read(&text, None, &SUBJECT).unwrap();
            assert_eq!(transfer.opacity, [[-3024.0, 0.0], [-16.4458, 0.0], [641.385, 0.715686], [3071.0, 0.705882]]);
            assert_eq!((transfer.color.len(), transfer.color[2]), (4, [641.385, 0.905882, 0.815686, 0.552941]));
            assert_eq!((transfer.unit_distance, remarks.len()), (1.0, 0));
        }
    }

    #[test]
    fn json_is_read() {
        let Imported { transfer, remarks } = read(JSON, None, &SUBJECT).unwrap();
        assert_eq!(transfer.opacity, [[-300.0, 0.0], [-150.0, 1.0], [-150.0, 0.0], [2000.0, 0.0]], "a step stays one");
        // Sharpness 1 is a step at the midpoint.
        let (red, white) = ([1.0, 0.0, 0.0], [1.0; 3]);
        assert_eq!([transfer.rgb(1.0), transfer.rgb(4.9), transfer.rgb(5.1)], [red, red, white]);
        assert_eq!((transfer.unit_distance, remarks.len()), (2.5, 0));
    }

    #[test]
    fn gradients_are_measured_in_the_world() {
        let imported = |text: &str| read(text, None, &SUBJECT).unwrap();
        let points = |text: &str| imported(text).transfer.gradient_opacity;
        assert!(points(TEXT).is_empty() && points(JSON).is_empty(), "1 everywhere is none");
        // The mean of the spacings is 2: a change of 255 a voxel is one of 127.5 a world unit.
        assert_eq!(points(&TEXT.replace("4 0 1 255 1", "4 0 0.2 255 1")), [[0.0, 0.2], [127.5, 1.0]]);
        assert_eq!(points(&TEXT.replace("4 0 1 255 1", "6 -5 0 5 1 25 0.5")), [[0.0, 0.5], [2.5, 1.0], [12.5, 0.5]]);
        let edges = JSON.replace(r#"{"x": 0, "y": 1}"#, r#"{"x": 0, "y": 0.5}"#);
        assert_eq!(points(&edges), [[0.0, 0.5], [127.5, 1.0]]);
        assert!(imported(&edges).remarks.is_empty());
        let disabled = edges.replace(r#""disableGradientOpacity": false"#, r#""disableGradientOpacity": true"#);
        assert!(points(&disabled).is_empty());
        let twice = JSON.replace(r#""volumeProperties": ["#, r#""volumeProperties": [{"components": []}, "#);
        assert!(bad(&twice).contains("'components' is empty"));
    }

    #[test]
    fn damaged_files_name_the_place() {
        let text = |from: &str, to: &str| bad(&TEXT.replacen(from, to, 1));
        assert!(text("0.9", "bright").contains("line 3 (diffuse): found 'bright', expected a number"));
        assert!(text("8 -3024", "x -3024").contains("scalar opacity (line 7): found 'x', expected the count"));
        assert!(text("8 -3024", "10 -3024").contains("found 8 numbers, expected 10"));
        assert!(text("8 -3024 0", "7 -3024").contains("found 7 numbers, expected 7 by its count, a multiple of 2"));
        assert!(text("4 0 1 255 1", "").contains("gradient opacity (line 8): found nothing"));
        assert!(text("0.715686", "1.715686").contains("'scalar opacity (line 7)' point 2: [1.715686] is outside 0..1"));
        assert!(text("641.385", "nan").contains("'scalar opacity (line 7)' point 2: not a finite number"));
        assert!(text("641.385", "64l").contains("found '64l', expected a number"));
        assert!(text("8 -3024 0 -16.4458 0 641.385 0.715686 3071 0.705882", "0").contains("(line 7)' has no points"));
        assert!(bad("1\n1\n").contains("scalar opacity (line 7): found nothing"));
        let json = |from: &str, to: &str| bad(&JSON.replacen(from, to, 1));
        assert!(json(r#""color": [1, 1, 1]"#, r#""color": [1, 1]"#).contains("invalid length 2"));
        assert!(
            json(r#""y": 1.0"#, r#""y": 1.5"#).contains("'scalarOpacity' point 1: [1.5, 0.5, 0.0] is outside 0..1")
        );
        assert!(json("scalarOpacity\":", "opacity\":").contains("missing field `scalarOpacity`"));
        assert!(json("2.5", "0").contains("'scalarOpacityUnitDistance' is 0, expected a positive number"));
        assert!(json("2000.0", "NaN").contains("found NaN, expected a finite number"));
    }
}
