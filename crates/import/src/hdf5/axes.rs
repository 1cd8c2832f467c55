//! Axes of a dataset: their names and coordinates, as NetCDF, NeXus, h5py and ilastik say them, and the letters that follow.

use super::attributes::{named, text, texts};
use super::tree::{Entry, Tree, join, last_of, parent_of};
use crate::axes::{Axis, AxisOrder};
use hdf5_reader::{Attribute, Datatype, ReferenceType};

/// One axis of a dataset, as the file tells.
#[derive(Default)]
pub(super) struct Dim<'a> {
    pub(super) name: Option<String>,
    /// Dataset of the coordinates along the axis.
    pub(super) scale: Option<&'a Entry>,
}

/// Everything known of a dataset's axes, slowest first.
pub(super) fn dims_of<'a>(tree: &'a Tree, entry: &Entry) -> Vec<Dim<'a>> {
    let shape = entry.set.shape();
    let group = parent_of(&entry.path);
    let mut dims: Vec<Dim<'a>> = shape.iter().map(|_| Dim::default()).collect();
    for (dim, scale) in dims.iter_mut().zip(attached(tree, entry)) {
        dim.name = scale.map(|scale| last_of(&scale.path).to_owned());
        dim.scale = scale;
    }
    let labels = texts(&entry.attributes, "DIMENSION_LABELS");
    let keys = vigra_keys(&entry.attributes);
    let nexus = nexus_names(tree, entry, group);
    for names in [keys, nexus, labels] {
        if names.len() != dims.len() {
            continue;
        }
        for (dim, name) in dims.iter_mut().zip(names) {
            if dim.name.is_none() && !name.is_empty() && name != "." {
                dim.name = Some(name);
            }
        }
    }
    for (dim, size) in dims.iter_mut().zip(shape) {
        // Coordinates of a name have that name, and as many elements.
        let fits = |scale: &&Entry| *scale.set.shape() == [*size];
        let of_name = || tree.set(&join(group, dim.name.as_deref()?));
        dim.scale = dim.scale.or_else(of_name).filter(fits);
    }
    dims
}

/// Scales attached to the axes, by DIMENSION_LIST.
fn attached<'a>(tree: &'a Tree, entry: &Entry) -> Vec<Option<&'a Entry>> {
    let Some(list) = named(&entry.attributes, "DIMENSION_LIST") else { return Vec::new() };
    let Datatype::VarLen { base, .. } = &list.datatype else { return Vec::new() };
    let Datatype::Reference { ref_type: ReferenceType::Object, size } = **base else { return Vec::new() };
    let each = entry.set.vlen_reference_size();
    let scale_of = |reference: &[u8]| {
        let bytes = entry.set.resolve_vlen_reference_bytes(reference, size.into()).ok()?;
        let mut address = [0; 8];
        let first = bytes.get(..usize::from(size).min(8))?;
        address[..first.len()].copy_from_slice(first);
        let address = u64::from_le_bytes(address);
        tree.sets.iter().find(|entry| entry.set.address() == address)
    };
    list.raw_data.chunks_exact(each).map(scale_of).collect()
}

/// Axis letters of ilastik's and vigra's `axistags`, JSON with a key for each axis.
fn vigra_keys(attributes: &[Attribute]) -> Vec<String> {
    let Some(tags) = text(attributes, "axistags") else { return Vec::new() };
    let after = |part: &str| {
        Some(part.trim_start().strip_prefix(':')?.trim_start().strip_prefix('"')?.split('"').next()?.to_owned())
    };
    tags.split("\"key\"").skip(1).filter_map(after).collect()
}

/// Names of axes of a NeXus plot: the group's `axes`, or the dataset's own, with colons in old files.
fn nexus_names(tree: &Tree, entry: &Entry, group: &str) -> Vec<String> {
    let of_group = tree
        .group(group)
        .filter(|group| text(&group.attributes, "signal").is_none_or(|signal| signal == last_of(&entry.path)));
    let names = of_group.map(|group| texts(&group.attributes, "axes")).unwrap_or_default();
    let names = if names.is_empty() { texts(&entry.attributes, "axes") } else { names };
    match &names[..] {
        [one] if one.contains([':', ',']) => {
            let inside = one.trim_matches(['[', ']']);
            inside.split([':', ',']).map(|name| name.trim().to_owned()).collect()
        }
        _ => names,
    }
}

/// The letter of an axis, by CF's `axis` and `standard_name` of its coordinates, or by its name.
fn letter(dim: &Dim<'_>) -> Option<Axis> {
    let of_scale = |name: &str| dim.scale.and_then(|scale| text(&scale.attributes, name));
    let by_axis = of_scale("axis").and_then(|axis| letter_of(&axis));
    by_axis.or_else(|| letter_of(&of_scale("standard_name")?)).or_else(|| letter_of(dim.name.as_deref()?))
}

fn letter_of(name: &str) -> Option<Axis> {
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
pub(super) fn order_of(dims: &[Dim<'_>], shape: &[u64], told: Option<&AxisOrder>) -> Result<Vec<Axis>, String> {
    let said: Vec<String> = (0..shape.len())
        .map(|a| format!("{}{}", dims[a].name.as_ref().map_or(String::new(), |name| format!("{name} ")), shape[a]))
        .collect();
    let said = said.join(" x ");
    if let Some(told) = told {
        return match told.axes().len() == shape.len() {
            true => Ok(told.axes().to_vec()),
            false => Err(format!("`axes` '{told}': the dataset has {} axes, {said}", shape.len())),
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
        let dims: Vec<Dim<'_>> = names.iter().map(dim).collect();
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
