//! Axes of a variable: their names and coordinates, and the letters that follow.

use super::Attributes;
use crate::axes::{Axis, AxisOrder};
use brickyard_volume::counted;

/// Most coordinates read along an axis.
pub(crate) const MOST_COORDINATES: u64 = 1 << 24;

/// One axis of a variable, as the file tells.
#[derive(Default)]
pub(crate) struct Dim {
    pub(crate) name: Option<String>,
    pub(crate) scale: Option<Scale>,
}

/// CF's names of the calendar in use, of which one differs before 1582 alone.
const OURS: [&str; 4] = ["", "standard", "gregorian", "proleptic_gregorian"];

/// The variable of an axis' coordinates.
pub(crate) struct Scale {
    pub(crate) name: String,
    pub(crate) units: Option<String>,
    /// Calendar of times, unless it is ours.
    pub(crate) calendar: Option<String>,
    /// The letter that its attributes tell.
    pub(super) letter: Option<Axis>,
    /// Its values; `None` if there are none, as for a dimension without a variable, or too many.
    pub(crate) coordinates: Option<Vec<f64>>,
    /// Whether its numbers are f32, off by their rounding.
    pub(crate) is_single: bool,
}

impl Scale {
    /// Creates a scale of these stored numbers.
    pub(crate) fn of(
        name: &str,
        attributes: &(impl Attributes + ?Sized),
        stored: Option<Vec<f64>>,
        is_single: bool,
    ) -> Self {
        let slope = attributes.number("scale_factor").unwrap_or(1.0);
        let intercept = attributes.number("add_offset").unwrap_or(0.0);
        let values = |numbers: Vec<f64>| numbers.into_iter().map(|n| n * slope + intercept).collect();
        Self {
            name: name.to_owned(),
            units: attributes.text("units"),
            calendar: attributes.text("calendar").filter(|name| !OURS.contains(&name.trim().to_lowercase().as_str())),
            letter: letter_in(attributes),
            coordinates: stored.map(values),
            is_single,
        }
    }
}

/// The letter by CF's `axis`, `standard_name`, `units` or `positive`.
fn letter_in(attributes: &(impl Attributes + ?Sized)) -> Option<Axis> {
    let of = |name: &str| letter_of(&attributes.text(name)?);
    let of_units = || {
        let units = attributes.text("units")?;
        // As CF spells them: degrees_north, degreeN, degrees_E and the like.
        let direction = units.strip_prefix("degrees").or_else(|| units.strip_prefix("degree"));
        match direction.map(|direction| direction.trim_start_matches('_')) {
            Some("north" | "N") => Some(Axis::Y),
            Some("east" | "E") => Some(Axis::X),
            _ => units.contains(" since ").then_some(Axis::T),
        }
    };
    let is_vertical = || attributes.text("positive").is_some_and(|way| ["up", "down"].contains(&&*way.to_lowercase()));
    of("axis").or_else(|| of("standard_name")).or_else(of_units).or_else(|| is_vertical().then_some(Axis::Z))
}

/// The letter of an axis, by its coordinates or its name.
fn letter(dim: &Dim) -> Option<Axis> {
    dim.scale.as_ref().and_then(|scale| scale.letter).or_else(|| letter_of(dim.name.as_deref()?))
}

pub(crate) fn letter_of(name: &str) -> Option<Axis> {
    Some(match name.to_lowercase().as_str() {
        "t" | "time" => Axis::T,
        "c" | "channel" | "channels" => Axis::C,
        "z" | "lev" | "level" | "depth" | "height" | "altitude" | "plev" | "air_pressure" => Axis::Z,
        "y" | "lat" | "latitude" | "projection_y_coordinate" | "grid_latitude" => Axis::Y,
        "x" | "lon" | "longitude" | "projection_x_coordinate" | "grid_longitude" => Axis::X,
        _ => return None,
    })
}

/// Assigns a letter to each axis: the user's, else the file's, else the last three as z, y, x. The error names what is missing.
pub(crate) fn order_of(dims: &[Dim], shape: &[u64], told: Option<&AxisOrder>) -> Result<Vec<Axis>, String> {
    let said: Vec<String> = (0..shape.len())
        .map(|a| format!("{}{}", dims[a].name.as_ref().map_or(String::new(), |name| format!("{name} ")), shape[a]))
        .collect();
    let said = said.join(" x ");
    if let Some(told) = told {
        return match told.axes().len() == shape.len() {
            true => Ok(told.axes().to_vec()),
            false => Err(format!("`axes` '{told}': the dataset has {}, {said}", counted(shape.len() as u64, "axis"))),
        };
    }
    let ask = || format!("axes {said} are not all known; name them with `axes`, slowest first, such as tzyx or czyx");
    let mut letters: Vec<Option<Axis>> = dims.iter().map(letter).collect();
    let is_twice = (0..letters.len()).any(|a| letters[a].is_some() && letters[..a].contains(&letters[a]));
    if is_twice
        || letters.iter().all(Option::is_some) && ![Axis::X, Axis::Y].iter().all(|a| letters.contains(&Some(*a)))
    {
        // Names such as `lat` twice, or (time, level) alone, order nothing.
        if shape.len() > 3 {
            return Err(ask());
        }
        letters = vec![None; shape.len()];
    }
    let mut free = [Axis::Z, Axis::Y, Axis::X].into_iter().filter(|a| !letters.contains(&Some(*a))).collect::<Vec<_>>();
    let mut unknown: Vec<usize> = (0..letters.len()).filter(|a| letters[*a].is_none()).collect();
    // Axes of one element, before the others, are steps or channels alike.
    for axis in [Axis::T, Axis::C] {
        if unknown.len() > free.len() && shape[unknown[0]] == 1 && !letters.contains(&Some(axis)) {
            letters[unknown.remove(0)] = Some(axis);
        }
    }
    if unknown.len() > free.len() {
        return Err(ask());
    }
    free.drain(..free.len() - unknown.len());
    for (a, axis) in unknown.into_iter().zip(free) {
        letters[a] = Some(axis);
    }
    let letters: Vec<Axis> = letters.into_iter().flatten().collect();
    match [Axis::X, Axis::Y].iter().all(|axis| letters.contains(axis)) {
        true => Ok(letters),
        false => Err(ask()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn order(names: &[&str], shape: &[u64], told: Option<&str>) -> Result<String, String> {
        let dim = |name: &&str| Dim { name: Some(name.to_string()).filter(|name| !name.is_empty()), scale: None };
        let dims: Vec<Dim> = names.iter().map(dim).collect();
        let told = told.map(|told| told.parse().unwrap());
        order_of(&dims, shape, told.as_ref()).map(|axes| AxisOrder::of(&axes).to_string())
    }

    #[test]
    fn letters_follow_names_then_places() {
        for (names, shape, expected) in [
            (&["", ""][..], &[2, 3][..], "yx"),
            (&["", "", ""], &[2, 3, 4], "zyx"),
            (&["time", "lat", "lon"], &[2, 3, 4], "tyx"),
            (&["lon", "lat", "lev"], &[2, 3, 4], "xyz"),
            (&["time", "", "", ""], &[2, 3, 4, 5], "tzyx"),
            (&["", "channel", "", ""], &[1, 3, 4, 5], "zcyx"),
            (&["", "", "", ""], &[1, 3, 4, 5], "tzyx"),
            (&["", "", "", "", ""], &[1, 1, 3, 4, 5], "tczyx"),
            (&["p", "q", "r"], &[2, 3, 4], "zyx"),
            (&["t", "y", "x", "c"], &[2, 3, 4, 5], "tyxc"),
            (&["lat", "lat", "lon"], &[2, 3, 4], "zyx"),
        ] {
            assert_eq!(order(names, shape, None).as_deref(), Ok(expected), "{names:?}");
        }
        assert!(order(&["", "", "", ""], &[2, 3, 4, 5], None).unwrap_err().contains("`axes`"));
        assert_eq!(order(&["t", "y", "x"], &[2, 3, 4], Some("xyz")).as_deref(), Ok("xyz"));
        assert!(order(&["", ""], &[2, 3], Some("zyx")).unwrap_err().contains("2 axes"));
    }

    #[test]
    fn ilastik_s_tags_are_read() {
        assert_eq!(letter_of("Latitude"), Some(Axis::Y));
        let tags = r#"{"axes": [{"key": "t", "typeFlags": 8}, {"key":"z"}, {"key": "y"}]}"#;
        let after = |part: &str| {
            Some(part.trim_start().strip_prefix(':')?.trim_start().strip_prefix('"')?.split('"').next()?.to_owned())
        };
        let keys: Vec<String> = tags.split("\"key\"").skip(1).filter_map(after).collect();
        assert_eq!(keys, ["t", "z", "y"]);
    }
}
