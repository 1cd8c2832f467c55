//! ParaView's colour maps: a JSON list of objects, or a single one.
//!
//! `RGBPoints` is a sequence of `value, r, g, b`, `ColorSpace` the interpolation between them, and `Points`, if present, a
//! sequence of `value, alpha, midpoint, sharpness`. Maps of colours only have values from 0 to 1, or -1 to 1, by convention:
//! ParaView stretches them over the shown range, and so does this module.

use super::color_space::ColorSpace;
use super::curve::{self, Node};
use super::imported::{Imported, Subject};
use super::presets::RISING;
use super::{TransferError, TransferFunction, check_points};
use crate::near_name;
use serde::Deserialize;
use serde_json::Value;

const FORM: &str = "a ParaView colour map";

/// Most names in an error: ParaView's own file has hundreds.
const LISTED: usize = 12;

/// The used fields of a map.
#[derive(Deserialize)]
#[serde(rename_all = "PascalCase")]
struct ColorMap {
    color_space: Option<String>,
    #[serde(rename = "RGBPoints")]
    rgb_points: Option<Vec<f64>>,
    points: Option<Vec<f64>>,
    #[serde(rename = "HSVWrap")]
    hsv_wrap: Option<Value>,
}

/// Reads the map called `name`, or the first.
pub(super) fn read(maps: &[Value], name: Option<&str>, subject: &Subject) -> Result<Imported, TransferError> {
    let mut remarks = Vec::new();
    let map = choose(maps, name, &mut remarks)?;
    let title = title(map);
    let foreign = |problem: String| TransferError::Foreign { form: FORM, problem: format!("{title}: {problem}") };
    let map = ColorMap::deserialize(map).map_err(|error| foreign(error.to_string()))?;
    let expected = "expected 'RGBPoints', a list of value, r, g, b (colours of categories are no transfer function)";
    let rgb_points = map.rgb_points.as_deref().ok_or_else(|| foreign(expected.into()))?;
    let rgb_points = fours("RGBPoints", rgb_points).map_err(foreign)?;
    let color = colors(rgb_points, color_space(&map, &mut remarks).map_err(foreign)?)?;
    let span = (color[0][0], color[color.len() - 1][0]);
    let transfer = match map.points.as_deref() {
        Some(points) => {
            let nodes = Node::opacities("Points", &fours("Points", points).map_err(foreign)?)?;
            TransferFunction::new(color, curve::points(nodes), subject.cell_length)
        }
        None => {
            let ramp = TransferFunction::new(Vec::new(), RISING.to_vec(), subject.unit_distance);
            TransferFunction { color, ..ramp.stretched((0.0, 1.0), span) }
        }
    };
    let transfer = fit(transfer, subject, &mut remarks);
    Imported::checked(transfer, remarks)
}

fn choose<'a>(maps: &'a [Value], name: Option<&str>, remarks: &mut Vec<String>) -> Result<&'a Value, TransferError> {
    let Some(first) = maps.first() else {
        return Err(TransferError::Foreign { form: FORM, problem: "the list is empty, expected at least one".into() });
    };
    let Some(name) = name else {
        if maps.len() > 1 {
            let first_of = format!("{} is the first of {} colour maps", title(first), maps.len());
            remarks.push(format!("{first_of}: append '#' and a name to the file's for another"));
        }
        return Ok(first);
    };
    maps.iter().find(|map| name_of(map) == Some(name)).ok_or_else(|| {
        let names = || maps.iter().filter_map(name_of);
        let listed = names().take(LISTED).collect::<Vec<_>>().join(", ");
        let more = names().count().saturating_sub(LISTED);
        let more = if more > 0 { format!(", and {more} more") } else { String::new() };
        let known = format!("there are {listed}{more}");
        TransferError::UnknownName { name: name.to_string(), hint: near_name::hint(name, names()), known }
    })
}

fn name_of(map: &Value) -> Option<&str> {
    map.get("Name")?.as_str()
}

fn title(map: &Value) -> String {
    name_of(map).map_or("a map without a name".to_string(), |name| format!("'{name}'"))
}

/// Numbers by four.
fn fours(list: &str, numbers: &[f64]) -> Result<Vec<[f64; 4]>, String> {
    let (fours, rest) = numbers.as_chunks::<4>();
    if rest.is_empty() {
        return Ok(fours.to_vec());
    }
    Err(format!("'{list}' has {} numbers, expected a multiple of 4", numbers.len()))
}

fn color_space(map: &ColorMap, remarks: &mut Vec<String>) -> Result<ColorSpace, String> {
    let wrap =
        map.hsv_wrap.as_ref().is_some_and(|wrap| wrap.as_bool().unwrap_or(wrap.as_f64().is_some_and(|w| w != 0.0)));
    let Some(name) = &map.color_space else { return Ok(ColorSpace::Rgb) };
    Ok(match name.to_lowercase().as_str() {
        "rgb" => ColorSpace::Rgb,
        "hsv" => ColorSpace::Hsv { wrap },
        "wrapped" => ColorSpace::Hsv { wrap: true },
        "lab" | "cielab" => ColorSpace::Lab,
        "diverging" => ColorSpace::Diverging,
        "step" => ColorSpace::Step,
        "lab/ciede2000" | "prolab" => {
            remarks.push(format!(
                "colours between its points are interpolated in CIELAB, not in {name}: they may differ slightly"
            ));
            ColorSpace::Lab
        }
        _ => return Err(format!("'ColorSpace' is '{name}', expected RGB, HSV, Lab, Diverging or Step")),
    })
}

/// Points so close that straight lines between them are the map.
fn colors(mut points: Vec<[f64; 4]>, space: ColorSpace) -> Result<Vec<[f64; 4]>, TransferError> {
    check_points("RGBPoints", &points)?;
    points.sort_by(|a, b| a[0].total_cmp(&b[0]));
    let mut color = Vec::new();
    for pair in points.windows(2) {
        let (a, b) = (pair[0], pair[1]);
        color.push(a);
        let mixed = |t: f64| {
            let [r, g, b_] = space.mix([a[1], a[2], a[3]], [b[1], b[2], b[3]], t);
            [a[0] + t * (b[0] - a[0]), r, g, b_]
        };
        match space {
            _ if a[0] == b[0] || space == ColorSpace::Rgb => {}
            ColorSpace::Step => color.push(curve::moved(b, a[0])),
            _ => curve::follow(&mixed, 0.5, &mut color),
        }
    }
    color.extend(points.last());
    // Colour spaces round: a channel may come out a little above 1.
    color.iter_mut().for_each(|point| point[1..].iter_mut().for_each(|c| *c = c.clamp(0.0, 1.0)));
    Ok(color)
}

/// Stretches a map with conventional values over the window.
fn fit(transfer: TransferFunction, subject: &Subject, remarks: &mut Vec<String>) -> TransferFunction {
    let span = transfer.span();
    if span != (0.0, 1.0) && span != (-1.0, 1.0) {
        return transfer;
    }
    let (low, high) = subject.window;
    remarks
        .push(format!("its values run from {} to {}: stretched over the window from {low} to {high}", span.0, span.1));
    transfer.stretched(span, subject.window)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::transfer::file::read;
    use crate::transfer::file::tests::SUBJECT;
    use crate::transfer::imported::Imported;

    fn imported(text: &str) -> Imported {
        read(text, None, &SUBJECT).unwrap()
    }

    fn bad(text: &str, name: Option<&str>) -> String {
        read(text, name, &SUBJECT).unwrap_err().to_string()
    }

    #[test]
    fn colours_alone_get_the_presets_opacity_over_the_window() {
        let Imported { transfer, remarks } =
            imported(r#"[{"Name": "BW", "ColorSpace": "RGB", "RGBPoints": [-1, 0, 0, 0, 1, 1, 1, 1]}]"#);
        assert_eq!(transfer, TransferFunction::preset("gray", SUBJECT.window, SUBJECT.unit_distance).unwrap());
        assert_eq!(remarks, ["its values run from -1 to 1: stretched over the window from -100 to 300"]);
        let absolute = imported(r#"[{"RGBPoints": [5, 0, 0, 0, 9, 1, 1, 1], "Points": null}]"#);
        assert_eq!(absolute.transfer.opacity, [[5.0, 0.0], [9.0, 0.5]]);
        assert!(absolute.remarks.is_empty());
    }

    #[test]
    fn opacity_has_midpoints_and_paraviews_distance() {
        let Imported { transfer, remarks } =
            imported(r#"{"RGBPoints": [100, 1, 0, 0, 0, 0, 0, 1], "Points": [0, 0, 0.25, 0, 100, 0.8, 0.5, 0]}"#);
        assert_eq!(transfer.color, [[0.0, 0.0, 0.0, 1.0], [100.0, 1.0, 0.0, 0.0]], "sorted, as ParaView does");
        assert_eq!(transfer.opacity, [[0.0, 0.0], [25.0, 0.4], [100.0, 0.8]]);
        assert_eq!((transfer.unit_distance, remarks.len()), (SUBJECT.cell_length, 0));
    }

    #[test]
    fn one_of_several_is_chosen_by_name() {
        let maps = r#"[{"Name": "A", "RGBPoints": [2, 1, 0, 0]}, {"Name": "Blue", "RGBPoints": [2, 0, 0, 1]}]"#;
        let first = imported(maps);
        assert_eq!(first.transfer.color, [[2.0, 1.0, 0.0, 0.0]]);
        assert_eq!(
            first.remarks,
            ["'A' is the first of 2 colour maps: append '#' and a name to the file's for another"]
        );
        let blue = read(maps, Some("Blue"), &SUBJECT).unwrap();
        assert_eq!((blue.transfer.color, blue.remarks.len()), (vec![[2.0, 0.0, 0.0, 1.0]], 0));
        assert_eq!(bad(maps, Some("blu")), "no transfer function 'blu', did you mean 'Blue'?: there are A, Blue");
    }

    #[test]
    fn steps_have_the_next_points_colour() {
        let step = imported(r#"{"ColorSpace": "Step", "RGBPoints": [5, 1, 0, 0, 9, 0, 1, 0]}"#).transfer;
        assert_eq!([step.rgb(4.9), step.rgb(5.1), step.rgb(9.0)], [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 1.0, 0.0]]);
    }

    #[test]
    fn points_between_are_close_enough_for_straight_lines() {
        let (a, b) =
            ([0.23137254902, 0.298039215686, 0.752941176471], [0.705882352941, 0.0156862745098, 0.149019607843]);
        let spaces = ["HSV", "Lab", "Diverging"].into_iter();
        for (name, space) in spaces.zip([ColorSpace::Hsv { wrap: false }, ColorSpace::Lab, ColorSpace::Diverging]) {
            let [[r, g, b_], [s, t, u]] = [a, b];
            let text = format!(r#"{{"ColorSpace": "{name}", "RGBPoints": [0, {r}, {g}, {b_}, 500, {s}, {t}, {u}]}}"#);
            let map = imported(&text).transfer;
            assert!(map.color.len() < 100, "{name}: {} points", map.color.len());
            for i in 0..=1000 {
                let t = i as f64 / 1000.0;
                for (found, exact) in map.rgb(500.0 * t).into_iter().zip(space.mix(a, b, t)) {
                    // A third of a step of an 8-bit picture.
                    assert!((found - exact).abs() < 0.3 / 255.0, "{name} at {t}: {found} {exact}");
                }
            }
        }
    }

    #[test]
    fn damaged_maps_name_the_map_and_the_place() {
        let cases = [
            ("[]", "not a ParaView colour map: the list is empty"),
            (r#"[{"Name": "A"}]"#, "'A': expected 'RGBPoints'"),
            (r#"[{"Name": "A", "IndexedColors": [1, 0, 0]}]"#, "'A': expected 'RGBPoints'"),
            (r#"[{"Name": "A", "RGBPoints": [0, 1, 1]}]"#, "'A': 'RGBPoints' has 3 numbers, expected a multiple of 4"),
            (r#"[{"Name": "A", "RGBPoints": ["x", 1, 1, 1]}]"#, "'A': invalid type: string \"x\", expected f64"),
            (r#"[{"RGBPoints": []}]"#, "'RGBPoints' has no points"),
            (r#"[{"RGBPoints": [0, 0, 0, 0, 1, 1, 1.5, 1]}]"#, "'RGBPoints' point 1: [1.0, 1.5, 1.0] is outside 0..1"),
            (r#"[{"RGBPoints": [0, 0, 0, 0], "Points": []}]"#, "'Points' has no points"),
            (
                r#"[{"RGBPoints": [0, 0, 0, 0], "Points": [0, 2, 0.5, 0]}]"#,
                "'Points' point 0: [2.0, 0.5, 0.0] is outside",
            ),
            (r#"[{"RGBPoints": [0, 0, 0, 0], "ColorSpace": "CMYK"}]"#, "'ColorSpace' is 'CMYK', expected RGB"),
            ("[1, 2]", "invalid type"),
            ("[{\"RGBPoints\": [0, NaN, 0, 0]}]", "line 1, column 20: found NaN"),
        ];
        for (text, expected) in cases {
            let found = bad(text, None);
            assert!(found.contains(expected), "{text}: {found}");
        }
    }
}
