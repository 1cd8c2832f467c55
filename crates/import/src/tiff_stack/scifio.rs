//! SCIFIO's description, as ImageJ2 and KNIME write it: lines of `key=value`, among them the axes, fastest first, with the length, scale and unit
//! of each.

use super::description::{Declared, Description};
use super::hyperstack::is_length;
use crate::axes::Axis;

/// First characters of SCIFIO's description.
pub(super) const START: &str = "SCIFIO=";

/// Parses the text.
pub(super) fn read(text: &str) -> Description {
    let unreadable = |problem: &str| {
        Description::unreadable(format!(
            "its description (SCIFIO's) {problem}; pass `axes` (with `channels` and `times`) to order its pages, such as zyx"
        ))
    };
    let list = |key: &str| -> Vec<&str> {
        let line = text.lines().find_map(|line| line.strip_prefix(key)?.strip_prefix('='));
        line.map_or_else(Vec::new, |line| line.split(',').map(str::trim).collect())
    };
    let (names, lengths, scales, units) = (list("axes"), list("lengths"), list("scales"), list("units"));
    let lengths: Option<Vec<u32>> = lengths.iter().map(|length| length.parse().ok().filter(|n| *n > 0)).collect();
    let Some(lengths) = lengths.filter(|lengths| lengths.len() == names.len()) else {
        return unreadable("does not give a length for each axis");
    };
    let (["X", "Y", ..], [x, y, ..]) = (&names[..], &lengths[..]) else {
        return unreadable("does not begin with the axes X and Y");
    };
    let mut declared = Declared { page_axes: Vec::new(), plane: Some([*x, *y]), ..Declared::one_plane() };
    for (name, length) in names.iter().zip(&lengths).skip(2) {
        let (axis, size) = match *name {
            "Z" => (Axis::Z, &mut declared.z),
            "Channel" => (Axis::C, &mut declared.channels),
            "Time" => (Axis::T, &mut declared.times),
            _ if *length == 1 => continue,
            other => return unreadable(&format!("has an axis '{other}'")),
        };
        if declared.page_axes.contains(&axis) {
            return unreadable(&format!("has the axis '{name}' twice"));
        }
        *size = *length;
        declared.page_axes.insert(0, axis);
    }
    let scale_of = |name: &str| {
        let i = names.iter().position(|other| *other == name)?;
        let scale = scales.get(i)?.parse().ok().filter(|scale| is_length(*scale))?;
        let unit = units.get(i).filter(|unit| !unit.is_empty() && **unit != "null")?;
        Some((scale, (*unit).to_owned()))
    };
    let mut description = Description { ignores_resolution: true, ..Description::default() };
    description.set_physical_sizes(["X", "Y", "Z"].map(scale_of));
    if let Some((step, unit)) = scale_of("Time") {
        description.set_increment(step, &unit, declared.times);
    }
    Description { declared: Some(declared), ..description }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn axes_are_in_the_order_of_pages() {
        let read = |axes: &str, lengths: &str, more: &str| {
            read(&format!(
                "SCIFIO=0.42.0\naxes={axes}\nlengths={lengths}\n{more}bitsPerPixel=16\nimages=24\nchannels=2\n"
            ))
        };
        let told =
            read("X,Y,Z,Channel,Time", "9,7,4,2,3", "scales=0.5,0.25,2,1,1.5\nunits=\\u00B5m,\\u00B5m,nm,null,s\n");
        let declared = told.declared.unwrap();
        assert_eq!(declared.page_axes, [Axis::T, Axis::C, Axis::Z]);
        assert_eq!((declared.z, declared.channels, declared.times, declared.plane), (4, 2, 3, Some([9, 7])));
        let spacing = told.spacing.unwrap();
        assert_eq!((spacing.x, spacing.y, told.unit), (0.5, 0.25, Some("micrometer")));
        assert!((spacing.z.unwrap() - 0.002).abs() < 1e-12);
        assert_eq!(told.time.unwrap().step, 1.5);
        let declared = read("X,Y,Channel,Z,Lifetime", "9,7,2,4,1", "").declared.unwrap();
        assert_eq!((declared.page_axes, declared.z, declared.channels), (vec![Axis::Z, Axis::C], 4, 2));
        for (axes, lengths, words) in [
            ("X,Y,Z", "9,7", "a length for each axis"),
            ("X,Y,Z", "9,7,0", "a length for each axis"),
            ("Channel,X,Y", "3,9,7", "begin with the axes X and Y"),
            ("X,Y,Lifetime", "9,7,4", "has an axis 'Lifetime'"),
            ("X,Y,Z,Z", "9,7,4,4", "has the axis 'Z' twice"),
        ] {
            let problem = read(axes, lengths, "").problem.unwrap();
            assert!(problem.contains(words), "{problem}");
        }
    }
}
