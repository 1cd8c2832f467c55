//! Places of voxels from the coordinates of their axes: spacing, origin, unit and times, where these are even.

use super::axes::{Dim, Scale};
use crate::axes::Axis;
use crate::note::{Note, Setting};
use crate::source::SourceInfo;
use crate::step_time::{StepTime, TimeSpan, is_moment};
use brickyard_volume::units::{LengthUnit, degree_of_text};
use brickyard_volume::{TimeAxis, time_unit};

/// Largest difference of even coordinates from their line, as a part of the spacing.
const EVEN: f64 = 1e-3;

/// Coordinates along an axis.
struct Line {
    /// The variable of the coordinates.
    name: String,
    first: f64,
    last: f64,
    /// Distance from one to the next; negative if they descend.
    step: f64,
    units: Option<String>,
}

/// Sets spacing, origin, unit and times from the coordinates of the axes; spacing and origin only where nothing else has. Sets the
/// axes along x, y, z whose coordinates descend: the volume is to be mirrored along them. Returns the time of a single step.
pub(crate) fn place(info: &mut SourceInfo, dims: &[Dim], axes: &[Axis]) -> StepTime {
    let mut lines: [Option<Line>; 3] = [None, None, None];
    let (mut notes, mut stamp) = (Vec::new(), None);
    for (dim, axis) in dims.iter().zip(axes) {
        let Some(scale) = &dim.scale else { continue };
        let Some(coordinates) = &scale.coordinates else { continue };
        match axis {
            Axis::T => stamp = time(info, coordinates, scale, &mut notes),
            Axis::C => {}
            axis => {
                let at = [Axis::X, Axis::Y, Axis::Z].iter().position(|a| a == axis).unwrap_or(0);
                lines[at] = line(scale, coordinates, *axis, &mut notes);
            }
        }
    }
    info.turned = if info.calibrated { [false; 3] } else { of_lines(info, &lines, &mut notes) };
    info.notes.append(&mut notes);
    StepTime { stamp, increment: None }
}

fn line(scale: &Scale, coordinates: &[f64], axis: Axis, notes: &mut Vec<Note>) -> Option<Line> {
    let (first, last) = (*coordinates.first()?, *coordinates.last()?);
    let units = scale.units.clone();
    let count = coordinates.len();
    if count == 1 {
        return first.is_finite().then_some(Line { name: scale.name.clone(), first, last: first, step: 0.0, units });
    }
    let step = (last - first) / (count - 1) as f64;
    // Single-precision coordinates are off by their rounding.
    let rounding = if scale.is_single { f64::from(f32::EPSILON) * first.abs().max(last.abs()) } else { 0.0 };
    let is_even = coordinates
        .iter()
        .enumerate()
        .all(|(i, at)| (first + step * i as f64 - at).abs() <= EVEN * step.abs() + rounding);
    if !is_even || step == 0.0 || !step.is_finite() {
        let (name, axis) = (&scale.name, axis.letter());
        notes.push(
            Note::warning(format!("The coordinates {name} are not evenly spaced: {axis} is not calibrated."))
                .settled_by(Setting::Spacing),
        );
        return None;
    }
    Some(Line { name: scale.name.clone(), first, last, step, units })
}

/// Even coordinates that are of no use without those of the other axes, and how to use them.
fn left_out(lines: &[Option<Line>; 3]) -> Vec<Note> {
    let (mut told, mut turns) = (Vec::new(), Vec::new());
    for (at, axis) in ["x", "y", "z"].into_iter().enumerate() {
        let Some(line) = lines[at].as_ref().filter(|line| line.step != 0.0) else { continue };
        let Line { name, first, last, step, units } = line;
        let units = units.as_ref().map_or(String::new(), |units| format!(" {units}"));
        told.push(format!("{axis} from {first} by {step}{units}"));
        if *step < 0.0 {
            let turn =
                format!("The coordinates {name} descend from {first} to {last}: `flip` {axis} makes them ascend.");
            turns.push(Note::warning(turn).settled_by(Setting::Flip(at)));
        }
    }
    let told = (!told.is_empty()).then(|| {
        let told = told.join(", ");
        let note = format!(
            "Not every axis has even coordinates, so these are left out, too: {told}. `spacing`, `origin` and `unit` give a place."
        );
        Note::warning(note).settled_by(Setting::Place)
    });
    told.into_iter().chain(turns).collect()
}

/// Calibrates the volume if every axis of more than one voxel has even coordinates, each axis in its own unit. Returns the
/// axes whose coordinates descend.
fn of_lines(info: &mut SourceInfo, lines: &[Option<Line>; 3], notes: &mut Vec<Note>) -> [bool; 3] {
    let mut descend = [false; 3];
    let extent = info.extent.to_array();
    let is_known = |a: usize| lines[a].as_ref().is_some_and(|line| extent[a] == 1 || line.step != 0.0);
    if (0..3).any(|a| extent[a] > 1 && !is_known(a)) {
        notes.extend(left_out(lines));
        return descend;
    }
    if lines.iter().all(Option::is_none) {
        return descend;
    }
    let units = lines.each_ref().map(|line| match line.as_ref().and_then(|line| line.units.as_deref()) {
        Some(unit) => degree_of_text(unit).unwrap_or(unit),
        None => "",
    });
    let Some(first) = (0..3).find(|a| extent[*a] > 1) else { return descend };
    let is_length = |a: usize| LengthUnit::of_text(units[a]).is_some();
    // Along an axis of one voxel, unlike units are no reason to give up a common unit.
    let is_left_out = |a: usize| extent[a] == 1 && (lines[a].is_none() || is_length(first) && !is_length(a));
    for a in (0..3).filter(|a| !is_left_out(*a)) {
        let Some(line) = &lines[a] else { continue };
        if extent[a] > 1 {
            info.geometry.spacing[a] = line.step.abs();
        }
        info.geometry.origin[a] = line.first.min(line.last);
        if line.step < 0.0 {
            descend[a] = true;
            let (Line { name, first, last, .. }, axis) = (line, [Axis::X, Axis::Y, Axis::Z][a].letter());
            notes.push(Note::new(format!(
                "The coordinates {name} descend from {first} to {last}: the volume is turned round along {axis}, so that they ascend."
            )));
        }
    }
    info.take_axis_units(std::array::from_fn(|a| if is_left_out(a) { units[first] } else { units[a] }));
    (0..3).filter(|a| extent[*a] == 1).for_each(|a| info.geometry.spacing[a] = 1.0);
    info.calibrated = true;
    descend
}

/// The unit of times such as `hours since 2000-01-01`; also in capitals and short plurals, as `Hrs`.
fn unit_of_time(units: &str) -> Option<&'static str> {
    let name = units.split(" since ").next()?.trim();
    let lower = name.to_lowercase();
    let singular = lower.strip_suffix('s').unwrap_or(&lower);
    [name, &lower, singular].into_iter().find_map(|name| time_unit(name).ok())
}

/// The moment in units such as `hours since 2000-01-01 00:00:0.0`, in one spelling: a date with all digits, and no midnight. Moments in
/// two spellings are two.
fn moment_of(units: &str) -> Option<String> {
    let (_, moment) = units.split_once(" since ")?;
    let moment = moment.trim();
    let (date, time) = moment.split_once([' ', 'T']).unwrap_or((moment, ""));
    let numbers: Option<Vec<u32>> = date.split('-').map(|number| number.parse().ok()).collect();
    Some(match numbers.as_deref() {
        Some([year, month, day]) => {
            let is_midnight = time.chars().all(|letter| "0:.Z ".contains(letter));
            let time = if is_midnight { String::new() } else { format!(" {}", time.trim()) };
            format!("{year:04}-{month:02}-{day:02}{time}")
        }
        _ => moment.to_owned(),
    })
}

/// Sets the times of the steps, in a unit such as `hours since 2000-01-01`. Returns that of a single step, which makes no axis.
fn time(info: &mut SourceInfo, coordinates: &[f64], scale: &Scale, notes: &mut Vec<Note>) -> Option<TimeSpan> {
    let units = scale.units.as_deref();
    let unit = units.and_then(unit_of_time);
    // A number in no known unit counts from no moment. Moments of two calendars are two.
    let since = unit.and(units).and_then(moment_of).map(|moment| match &scale.calendar {
        Some(calendar) => format!("{moment} ({})", calendar.trim()),
        None => moment,
    });
    if since.as_ref().is_some_and(|since| !is_moment(since)) {
        notes.push(Note::warning("The moment from which the file's times count is no short text: they are left out."));
        return None;
    }
    if coordinates.is_empty() {
        return None;
    }
    if let (Some(units), None) = (units, unit) {
        notes.push(
            Note::warning(format!("Times are in {units}, which is no known unit: it is left out."))
                .settled_by(Setting::TimeUnit),
        );
    }
    if let [at] = coordinates {
        if !at.is_finite() {
            let note = Note::warning(format!("The file's time is {at}: it is left out."));
            notes.push(note.settled_by(Setting::Times));
        }
        return at.is_finite().then_some(TimeSpan { number: *at, unit, since });
    }
    if let Some(units) = units.filter(|units| unit.is_some() && units.contains(" since ")) {
        notes.push(Note::new(format!("Times are in {units}.")));
    }
    match TimeAxis::of_stamps(coordinates.to_vec(), unit.map(str::to_owned)) {
        Ok(axis) => info.time = Some(TimeAxis { since, ..axis }),
        Err(problem) => {
            notes.push(Note::warning(format!("The file's times are left out: {problem}.")).settled_by(Setting::Times))
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::axes::Sizes;
    use crate::options::OpenOptions;
    use brickyard_volume::{Extent, Geometry, VoxelType};

    fn placed(extent: [u32; 3], lines: [Option<(f64, f64, &str)>; 3]) -> Geometry {
        let sizes = Sizes { extent: Extent::from_array(extent), channels: 1, times: 1 };
        let mut info = SourceInfo::plain(sizes, VoxelType::F32);
        let line = |(first, step, unit): (f64, f64, &str)| {
            let (name, last) = ("a".into(), first + 8.0 * step);
            Line { name, first, last, step, units: Some(unit.into()) }
        };
        of_lines(&mut info, &lines.map(|told| told.map(line)), &mut Vec::new());
        assert!(info.calibrated);
        info.geometry
    }

    #[test]
    fn units_of_time_are_known_as_udunits_spells_them() {
        for (units, unit) in [
            ("hours since 1900-01-01", "hour"),
            ("Hours since 1900-01-01 00:00:0.0", "hour"),
            ("hrs since 2001-01-01", "hour"),
            ("mins since 2001-01-01", "minute"),
            ("msecs since 2001-01-01", "millisecond"),
            ("d since 2001-01-01", "day"),
            ("seconds", "second"),
        ] {
            assert_eq!(unit_of_time(units), Some(unit), "{units}");
        }
        for none in ["months since 2000-01-01", "years since 0001-01-01", "day as %Y%m%d.%f", ""] {
            assert_eq!(unit_of_time(none), None, "{none}");
        }
    }

    #[test]
    fn moments_are_one_in_their_usual_spellings() {
        for units in ["hours since 1900-01-01", "days since 1900-1-1 00:00:0.0", "hours since 1900-01-01T00:00:00Z"] {
            assert_eq!(moment_of(units).as_deref(), Some("1900-01-01"), "{units}");
        }
        for (units, moment) in [
            ("hours since 1900-01-01 06:00", "1900-01-01 06:00"),
            ("hours since 1900-01-01 00:00 +01:00", "1900-01-01 00:00 +01:00"),
            ("hours since launch", "launch"),
        ] {
            assert_eq!(moment_of(units).as_deref(), Some(moment), "{units}");
        }
        assert_eq!(moment_of("hours"), None);
    }

    #[test]
    fn the_time_of_a_single_step_is_told() {
        let sizes = Sizes { extent: Extent::new(2, 2, 2), channels: 1, times: 1 };
        let (mut info, mut notes) = (SourceInfo::plain(sizes, VoxelType::F32), Vec::new());
        let scale = |units: &str, calendar: Option<&str>| Scale {
            name: "time".into(),
            units: Some(units.into()),
            calendar: calendar.map(str::to_owned),
            letter: None,
            coordinates: None,
            is_single: false,
        };
        let hours = scale("hours since 2026-01-01", None);
        let stamp = time(&mut info, &[4.5], &hours, &mut notes);
        assert!(info.time.is_none() && notes.is_empty(), "{notes:?}");
        let said = StepTime { stamp, increment: None }.left_out().unwrap();
        assert!(said.starts_with("The time of the only step, 4.5 hour since 2026-01-01, is left out: "), "{said:?}");
        assert_eq!(time(&mut info, &[4.5, 5.0], &hours, &mut notes), None);
        assert_eq!(info.time.take().unwrap().since.as_deref(), Some("2026-01-01"));
        assert!(notes[0].starts_with("Times are in hours since"), "{notes:?}");
        // Days of another calendar count otherwise.
        let stamp = time(&mut info, &[4.5], &scale("days since 2026-01-01", Some("noleap")), &mut notes).unwrap();
        assert_eq!(stamp.since.as_deref(), Some("2026-01-01 (noleap)"));
        notes.clear();
        let stamp = time(&mut info, &[4.5], &scale("months since 2026-01-01", None), &mut notes).unwrap();
        assert_eq!((stamp.number, stamp.unit, stamp.since), (4.5, None, None));
        assert!(time(&mut info, &[f64::NAN], &hours, &mut notes).is_none());
        for (note, words) in notes.iter().zip(["which is no known unit", "The file's time is NaN"]) {
            assert!(note.is_warning() && note.contains(words), "{note:?}");
        }
        assert_eq!(notes.len(), 2);
    }

    #[test]
    fn even_axes_beside_an_uneven_one_are_told() {
        let line = |name: &str, first, last, step, units: &str| {
            Some(Line { name: name.into(), first, last, step, units: Some(units.into()) })
        };
        let lines =
            [line("lon", 0.0, 357.5, 2.5, "degrees_east"), line("lat", 90.0, -90.0, -2.5, "degrees_north"), None];
        let sizes = Sizes { extent: Extent::new(144, 73, 6), channels: 1, times: 1 };
        let (mut info, mut notes) = (SourceInfo::plain(sizes, VoxelType::F32), Vec::new());
        assert_eq!(of_lines(&mut info, &lines, &mut notes), [false; 3]);
        assert!(!info.calibrated && notes.len() == 2 && notes.iter().all(Note::is_warning));
        let told = "x from 0 by 2.5 degrees_east, y from 90 by -2.5 degrees_north. ";
        assert!(notes[0].contains(told), "{}", &*notes[0]);
        assert!(notes[1].contains("lat descend from 90 to -90: `flip` y"), "{}", &*notes[1]);
        // Each is stale once the caller has done it.
        let stale = |options: &OpenOptions| [0, 1].map(|i: usize| options.settle(&notes[i]));
        let plain = OpenOptions::default();
        let spacing = OpenOptions { spacing: Some(glam::DVec3::ONE), ..plain.clone() };
        let place = OpenOptions { origin: Some(glam::DVec3::ZERO), ..spacing.clone() };
        let turned = OpenOptions { flip: Some([false, true, false]), ..plain.clone() };
        assert_eq!(
            [&plain, &spacing, &place, &turned].map(stale),
            [[false, false], [false, false], [true, false], [false, true]]
        );
    }

    #[test]
    fn each_axis_has_its_own_unit_and_lengths_one() {
        let map = placed(
            [9; 3],
            [(10.0, 0.25, "degrees_east"), (60.0, -0.5, "degrees_north"), (50.0, 25.0, "hPa")].map(Some),
        );
        assert_eq!((map.spacing, map.origin), (glam::DVec3::new(0.25, 0.5, 25.0), glam::DVec3::new(10.0, 56.0, 50.0)));
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
