//! Meaning of a dataset's numbers and places by the CF conventions of NetCDF: fill values, packed numbers, coordinates, units; and
//! ilastik's voxel size.

use super::attributes::{named, number, numbers, text};
use super::axes::Dim;
use super::tree::{Entry, Tree};
use super::types::Stored;
use crate::axes::Axis;
use crate::element::{Decode, Element, Scale};
use crate::note::Note;
use crate::source::SourceInfo;
use brickyard_volume::units::LengthUnit;
use brickyard_volume::{TimeAxis, VoxelType, time_unit};

/// Largest difference of even coordinates from their line, as a part of the spacing.
const EVEN: f64 = 1e-3;

/// Most coordinates read along an axis.
const MOST_COORDINATES: u64 = 1 << 24;

/// The fill value of NetCDF's floats, which says that nothing was written.
const NC_FILL_FLOAT: f64 = 9.969_209_968_386_869e36;

/// How stored numbers become values.
pub(super) struct Values {
    pub(super) decode: Decode,
    /// Value of voxels without data, and its name in the file.
    pub(super) nodata: Option<(f64, &'static str)>,
    /// Unit of the values.
    pub(super) unit: Option<String>,
    pub(super) notes: Vec<Note>,
}

/// The values of a dataset.
pub(super) fn values_of(tree: &Tree, entry: &Entry, stored: &Stored) -> Values {
    let attributes = &entry.attributes;
    let mut notes = Vec::new();
    let is_unsigned = text(attributes, "_Unsigned").is_some_and(|said| said.eq_ignore_ascii_case("true"));
    let element = if is_unsigned { unsigned(stored.element) } else { stored.element };
    let slope = number(attributes, "scale_factor").unwrap_or(1.0);
    let intercept = number(attributes, "add_offset").unwrap_or(0.0);
    let is_scaled = slope.is_finite() && slope != 0.0 && intercept.is_finite();
    let scale = match is_scaled {
        true => Scale::exact(element, slope, intercept),
        false => {
            notes.push(Note::warning(format!(
                "scale_factor {slope} and add_offset {intercept} make no values: the stored numbers are kept."
            )));
            None
        }
    };
    let (slope, intercept) = scale.map_or((1.0, 0.0), |scale| (scale.slope, scale.intercept));
    let value = |stored: f64| {
        let [_, greatest] = element.limits();
        // A negative fill value of numbers read as unsigned stands for their upper half.
        let stored = if is_unsigned && stored < 0.0 { stored + greatest + 1.0 } else { stored };
        stored * slope + intercept
    };
    let fill = number(attributes, "_FillValue").map(|fill| (fill, "_FillValue"));
    let missing = numbers(attributes, "missing_value").unwrap_or_default();
    let nodata =
        fill.or_else(|| Some((*missing.first()?, "missing_value"))).or_else(|| default_fill(tree, entry, element));
    for other in missing.iter().filter(|other| nodata.is_some_and(|(value, _)| value != **other && !other.is_nan())) {
        notes.push(Note::warning(format!(
            "Voxels of {other} hold no data either (missing_value): they are kept as data."
        )));
    }
    for name in ["valid_range", "valid_min", "valid_max"] {
        if let Some(limits) = numbers(attributes, name) {
            notes.push(Note::new(format!(
                "Values beyond {name} {limits:?} hold no data, according to the file: they are kept."
            )));
        }
    }
    // A scale that makes no values leaves stored numbers, which are in no unit. 1 is CF's word for none.
    let unit = text(attributes, "units").filter(|units| units != "1" && is_scaled);
    let decode = Decode { element, endian: stored.endian, scale };
    Values { decode, nodata: nodata.map(|(stored, name)| (value(stored), name)), unit, notes }
}

fn unsigned(element: Element) -> Element {
    match element {
        Element::Voxel(VoxelType::I8) => Element::Voxel(VoxelType::U8),
        Element::Voxel(VoxelType::I16) => Element::Voxel(VoxelType::U16),
        Element::Voxel(VoxelType::I32) => Element::Voxel(VoxelType::U32),
        Element::I64 => Element::U64,
        other => other,
    }
}

/// The value of numbers never written, in files of NetCDF's library, if the dataset has it.
fn default_fill(tree: &Tree, entry: &Entry, element: Element) -> Option<(f64, &'static str)> {
    let root = tree.group("/")?;
    named(&root.attributes, "_NCProperties")?;
    let expected = match element {
        Element::Voxel(VoxelType::I16) => -32767.0,
        Element::Voxel(VoxelType::U16) => 65535.0,
        Element::Voxel(VoxelType::I32) => -2147483647.0,
        Element::Voxel(VoxelType::U32) => 4294967295.0,
        Element::Voxel(VoxelType::F32) => f64::from(NC_FILL_FLOAT as f32),
        Element::F64 => NC_FILL_FLOAT,
        _ => return None,
    };
    let fill = entry.set.fill_value()?.value.as_ref()?;
    let fill = *entry.stored.as_ref().ok()?.numbers(fill).first()?;
    (fill == expected).then_some((expected, "the fill value of NetCDF"))
}

/// Coordinates along an axis.
struct Line {
    first: f64,
    /// Distance from one to the next; negative if they descend.
    step: f64,
    units: Option<String>,
}

/// Sets spacing, origin, unit and times from the coordinates of the axes, or from ilastik's voxel size.
pub(super) fn place(info: &mut SourceInfo, tree: &Tree, entry: &Entry, dims: &[Dim<'_>], axes: &[Axis]) {
    let mut lines: [Option<Line>; 3] = [None, None, None];
    let mut notes = Vec::new();
    for (dim, axis) in dims.iter().zip(axes) {
        let Some(scale) = dim.scale else { continue };
        let Some(coordinates) = coordinates(scale) else { continue };
        match axis {
            Axis::T => time(info, &coordinates, text(&scale.attributes, "units").as_deref(), &mut notes),
            Axis::C => {}
            axis => {
                let at = [Axis::X, Axis::Y, Axis::Z].iter().position(|a| a == axis).unwrap_or(0);
                lines[at] = line(scale, &coordinates, *axis, &mut notes);
            }
        }
    }
    if !of_ilastik(info, tree, entry, axes) {
        of_lines(info, &lines);
    }
    info.notes.append(&mut notes);
}

/// A scale's numbers; `None` if it holds none, as a NetCDF dimension without a variable.
fn coordinates(scale: &Entry) -> Option<Vec<f64>> {
    let stored = scale.stored.as_ref().ok().filter(|stored| stored.members.is_empty())?;
    let is_blank = text(&scale.attributes, "NAME")
        .is_some_and(|name| name.starts_with("This is a netCDF dimension but not a netCDF variable"));
    if is_blank || scale.set.shape().iter().product::<u64>() > MOST_COORDINATES {
        return None;
    }
    let stored_numbers = stored.numbers(&scale.set.read_raw_bytes().ok()?);
    let slope = number(&scale.attributes, "scale_factor").unwrap_or(1.0);
    let intercept = number(&scale.attributes, "add_offset").unwrap_or(0.0);
    Some(stored_numbers.into_iter().map(|n| n * slope + intercept).collect())
}

fn line(scale: &Entry, coordinates: &[f64], axis: Axis, notes: &mut Vec<Note>) -> Option<Line> {
    let (first, last) = (*coordinates.first()?, *coordinates.last()?);
    let units = text(&scale.attributes, "units");
    let count = coordinates.len();
    if count == 1 {
        return first.is_finite().then_some(Line { first, step: 0.0, units });
    }
    let step = (last - first) / (count - 1) as f64;
    // Single-precision coordinates are off by their rounding.
    let is_single = scale.stored.as_ref().is_ok_and(|stored| stored.element == Element::Voxel(VoxelType::F32));
    let rounding = if is_single { f64::from(f32::EPSILON) * first.abs().max(last.abs()) } else { 0.0 };
    let is_even = coordinates
        .iter()
        .enumerate()
        .all(|(i, at)| (first + step * i as f64 - at).abs() <= EVEN * step.abs() + rounding);
    if !is_even || step == 0.0 || !step.is_finite() {
        let (name, axis) = (&scale.path, axis.letter());
        notes.push(Note::warning(format!("The coordinates {name} are not evenly spaced: {axis} is not calibrated.")));
        return None;
    }
    if step < 0.0 {
        notes.push(Note::warning(format!(
            "The coordinates {} descend from {first} to {last}: voxels are kept in the file's order, and positions along {} count from the first.",
            scale.path,
            axis.letter()
        )));
    }
    Some(Line { first, step, units })
}

/// Whether units are degrees of any direction.
fn is_angle(unit: &str) -> bool {
    unit == "deg" || unit.starts_with("degree")
}

/// Calibrates the volume if every axis of more than one voxel has even coordinates, each axis in its own unit.
fn of_lines(info: &mut SourceInfo, lines: &[Option<Line>; 3]) {
    let extent = info.extent.to_array();
    let is_known = |a: usize| lines[a].as_ref().is_some_and(|line| extent[a] == 1 || line.step != 0.0);
    if lines.iter().all(Option::is_none) || (0..3).any(|a| extent[a] > 1 && !is_known(a)) {
        return;
    }
    let units = lines.each_ref().map(|line| match line.as_ref().and_then(|line| line.units.as_deref()) {
        Some(unit) if is_angle(unit) => "degree",
        Some(unit) => unit,
        None => "",
    });
    let Some(first) = (0..3).find(|a| extent[*a] > 1) else { return };
    let is_length = |a: usize| LengthUnit::of_text(units[a]).is_some();
    // Along an axis of one voxel, unlike units are no reason to give up a common unit.
    let is_left_out = |a: usize| extent[a] == 1 && (lines[a].is_none() || is_length(first) && !is_length(a));
    for a in (0..3).filter(|a| !is_left_out(*a)) {
        let Some(line) = &lines[a] else { continue };
        if extent[a] > 1 {
            info.geometry.spacing[a] = line.step.abs();
        }
        if line.step >= 0.0 {
            info.geometry.origin[a] = line.first;
        }
    }
    info.take_axis_units(std::array::from_fn(|a| if is_left_out(a) { units[first] } else { units[a] }));
    (0..3).filter(|a| extent[*a] == 1).for_each(|a| info.geometry.spacing[a] = 1.0);
    info.calibrated = true;
}

/// Voxel size of ilastik and Fiji's plugins: micrometres along z, y, x.
fn of_ilastik(info: &mut SourceInfo, tree: &Tree, entry: &Entry, axes: &[Axis]) -> bool {
    const NAME: &str = "element_size_um";
    let of_root = || numbers(&tree.group("/")?.attributes, NAME);
    let Some(mut sizes) = numbers(&entry.attributes, NAME).or_else(of_root) else { return false };
    if sizes.len() == 2 && !axes.contains(&Axis::Z) {
        sizes.insert(0, 1.0);
    }
    let [z, y, x] = sizes[..] else {
        info.notes
            .push(Note::warning(format!("{NAME} has {} numbers in place of z, y, x: it is left out.", sizes.len())));
        return false;
    };
    if [x, y, z].iter().any(|size| !(size.is_finite() && *size > 0.0)) {
        info.notes.push(Note::warning(format!("{NAME} {z}, {y}, {x} is no voxel size: it is left out.")));
        return false;
    }
    info.geometry.spacing = glam::DVec3::new(x, y, z);
    info.geometry.unit = Some("micrometer".into());
    info.calibrated = true;
    true
}

/// Sets the times of the steps, in a unit such as `hours since 2000-01-01`.
fn time(info: &mut SourceInfo, coordinates: &[f64], units: Option<&str>, notes: &mut Vec<Note>) {
    let name = units.and_then(|units| units.split(" since ").next()).map(str::trim);
    let unit = name.and_then(|name| time_unit(name).ok());
    if let (Some(units), None) = (units, unit) {
        notes.push(Note::warning(format!("Times are in {units}, which is no known unit: it is left out.")));
    } else if let Some(units) = units.filter(|units| units.contains(" since ")) {
        notes.push(Note::new(format!("Times are in {units}.")));
    }
    if coordinates.len() < 2 {
        return;
    }
    match TimeAxis::of_stamps(coordinates.to_vec(), unit.map(str::to_owned)) {
        Ok(axis) => info.time = Some(axis),
        Err(problem) => notes.push(Note::warning(format!("The file's times are left out: {problem}."))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::axes::Sizes;
    use brickyard_volume::{Extent, Geometry};

    fn placed(extent: [u32; 3], lines: [Option<(f64, f64, &str)>; 3]) -> Geometry {
        let sizes = Sizes { extent: Extent::from_array(extent), channels: 1, times: 1 };
        let mut info = SourceInfo::plain(sizes, VoxelType::F32);
        let line = |(first, step, unit): (f64, f64, &str)| Line { first, step, units: Some(unit.into()) };
        of_lines(&mut info, &lines.map(|told| told.map(line)));
        assert!(info.calibrated);
        info.geometry
    }

    #[test]
    fn each_axis_has_its_own_unit_and_lengths_one() {
        let map = placed(
            [9; 3],
            [(10.0, 0.25, "degrees_east"), (60.0, -0.5, "degrees_north"), (50.0, 25.0, "hPa")].map(Some),
        );
        assert_eq!((map.spacing, map.origin), (glam::DVec3::new(0.25, 0.5, 25.0), glam::DVec3::new(10.0, 0.0, 50.0)));
        assert_eq!(map.units_in_words().as_deref(), Some("degree, degree, hPa"));
        let lengths = placed([9; 3], [(0.0, 2.0, "km"), (4.0, 2.0, "km"), (300.0, 50.0, "m")].map(Some));
        assert_eq!((lengths.spacing, lengths.unit.as_deref()), (glam::DVec3::new(2.0, 2.0, 0.05), Some("kilometer")));
        assert_eq!(lengths.origin.z, 0.3);
        // One level of pressure does not take the lengths their unit; one of a length does have its place.
        let flat = placed([9, 9, 1], [(0.0, 2.0, "km"), (0.0, 2.0, "km"), (500.0, 0.0, "hPa")].map(Some));
        assert_eq!((flat.spacing.z, flat.origin.z, flat.unit.as_deref()), (1.0, 0.0, Some("kilometer")));
        let low = placed([9, 9, 1], [(0.0, 2.0, "km"), (0.0, 2.0, "km"), (500.0, 0.0, "m")].map(Some));
        assert_eq!((low.spacing.z, low.origin.z, low.unit.as_deref()), (1.0, 0.5, Some("kilometer")));
    }
}
