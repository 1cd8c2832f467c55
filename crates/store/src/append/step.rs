//! A step of a source under way into a store: its fit with the existing steps, time and description.

use super::AppendError;
use crate::metadata::StoreInfo;
use crate::pack::plan::MAX_STAMPS;
use crate::store::Store;
use brickyard_import::{Described, Source, SourceInfo, TimeSpan, axes_in_words};
use brickyard_volume::{Geometry, TimeAxis, counted};

/// Allowed deviation of steps' spacings and origins, as a fraction of a voxel.
const TOLERANCE: f64 = 1e-4;

/// A source of a single time step, under the step's number in a store.
pub(super) type Step<'a> = Described<&'a dyn Source>;

/// The first step of a new store, taken at `stamp`, otherwise at the source's time; if neither is known, at 0, each
/// step 1 after the last.
pub(super) fn first_step(source: &dyn Source, stamp: Option<f64>) -> Result<Step<'_>, AppendError> {
    let mut info = one_step(source)?.clone();
    // A time in no known unit may be a mere number.
    let own = source.step_time().stamp.filter(|own| stamp.is_none() && info.time.is_none() && own.unit.is_some());
    info.notes.extend(own.as_ref().map(TimeSpan::taken));
    let axis = info.time.take().or_else(|| own.map(|own| own.axis())).unwrap_or_default();
    info.time = Some(TimeAxis { start: stamp.unwrap_or(axis.start), ..axis });
    Ok(Step { info, source, first: 0 })
}

/// The next step of a store: its voxels have the same meaning as the others'.
pub(super) fn next_step<'a>(source: &'a dyn Source, store: &Store) -> Result<Step<'a>, AppendError> {
    let mut info = one_step(source)?.clone();
    check(&info, store)?;
    info.nodata = store.info().source_nodata();
    Ok(Step { info, source, first: store.times() })
}

fn one_step(source: &dyn Source) -> Result<&SourceInfo, AppendError> {
    match source.info() {
        info if info.times == 1 => Ok(info),
        info => Err(AppendError::Several { times: info.times }),
    }
}

/// Checks `count`, the step's voxels with the store's no-data value, which the source may declare data.
pub(super) fn check_nodata(step: &SourceInfo, store: &Store, count: u64) -> Result<(), AppendError> {
    match store.info().source_nodata() {
        Some(value) if step.knows_nodata && step.nodata.is_none() && count > 0 && !step.voxel_type.is_float() => {
            Err(AppendError::Mismatch {
                store: store.path().into(),
                step: store.times(),
                what: "value for no data",
                found: format!("{} of {value}, which is data there", counted(count, "voxel")),
                expected: format!("{value}, which is never data; pack all steps at once into another store"),
            })
        }
        _ => Ok(()),
    }
}

/// Checks a step against a store's volume: shape and type, and, if given, place, unit and no data.
fn check(step: &SourceInfo, store: &Store) -> Result<(), AppendError> {
    let differs = |what, found: String, expected: String| {
        let (store, step) = (store.path().into(), store.times());
        Err(AppendError::Mismatch { store, step, what, expected, found })
    };
    let (ours, theirs) = (store.geometry(), &step.geometry);
    let extent = store.layout().pyramid.levels()[0].extent;
    if step.extent != extent {
        return differs("shape (x, y, z)", step.extent.to_string(), extent.to_string());
    }
    if step.voxel_type != store.voxel_type() {
        let expected = format!("{0} (`to_voxel_type` {0} converts the step)", store.voxel_type());
        return differs("voxel type", step.voxel_type.to_string(), expected);
    }
    if step.channels != store.channels() {
        return differs("number of channels", step.channels.to_string(), store.channels().to_string());
    }
    let is_near =
        |a: glam::DVec3, b: glam::DVec3| (a - b).abs().max_element() <= TOLERANCE * ours.spacing.min_element();
    let in_words = |v: glam::DVec3| format!("{:?}", v.to_array());
    if step.calibrated && !is_near(theirs.spacing, ours.spacing) {
        return differs("voxel spacing (x, y, z)", in_words(theirs.spacing), in_words(ours.spacing));
    }
    let says_origin = step.says_origin || step.calibrated || theirs.origin != Geometry::default().origin;
    if says_origin && !is_near(theirs.origin, ours.origin) {
        return differs("origin (x, y, z)", in_words(theirs.origin), in_words(ours.origin));
    }
    let or_none = |word: &Option<String>| word.clone().unwrap_or_else(|| "not known".into());
    let [units, store_units] = [theirs, ours].map(Geometry::units_in_words);
    // A store without units, as of former versions, takes steps whose axes have any but lengths.
    let is_new = store_units.is_none() && theirs.unit.is_none();
    if units.is_some() && units != store_units && !is_new {
        return differs("unit of length", or_none(&units), or_none(&store_units));
    }
    if let Some(theirs) = step.orientation
        && !store.info().orientation.is_some_and(|ours| theirs.agrees(&ours, extent))
    {
        let rows = |orientation: brickyard_volume::Orientation| format!("{:?}", orientation.rows());
        return differs("orientation", rows(theirs), store.info().orientation.map_or("not known".into(), rows));
    }
    for (channel, look) in store.info().channels.iter().zip(&step.channel_looks) {
        if look.unit.is_some() && channel.unit.is_some() && look.unit != channel.unit {
            let expected = format!("{} (`value_unit` gives it)", or_none(&channel.unit));
            return differs("unit of values", or_none(&look.unit), expected);
        }
    }
    let ours = store.info().channels.iter().map(|channel| channel.name.as_deref());
    let theirs = step.channel_looks.iter().map(|look| look.name.as_deref());
    let differ = |(ours, theirs): (Option<&str>, Option<&str>)| ours.is_some() && theirs.is_some() && ours != theirs;
    if ours.clone().zip(theirs.clone()).any(differ) {
        let found = in_a_row(theirs);
        let expected = format!("{} (write the step with these channels, in this order)", in_a_row(ours));
        return differs("list of channels", found, expected);
    }
    if let Some((found, expected)) = unlike_order(step, store) {
        return differs("order of voxels", found, expected);
    }
    let nodata = store.info().source_nodata();
    // If the source declares a no-data value, this one only means that some floats are left out, as they are here.
    let is_left_out = step.knows_nodata && step.voxel_type.is_float() && nodata.is_some();
    if let Some(found) = step.nodata.filter(|found| Some(*found) != nodata && !is_left_out) {
        let none = match step.knows_nodata {
            true => {
                "none, as it is data in all steps so far; pass `nodata` none if it is data here, too, or pack all \
                 steps at once into another store"
            }
            false => "none; pass `nodata` none to take it as data",
        };
        let expected = nodata.map_or(none.into(), |ours| ours.to_string());
        return differs("value for no data", found.to_string(), expected);
    }
    Ok(())
}

/// The order in which a step's voxels come, and the one expected, if they may lie in other places than those of one
/// number in the store's files. An orientation, and coordinates, tell the places; a flip of the store is the caller's.
fn unlike_order(step: &SourceInfo, store: &Store) -> Option<(String, String)> {
    let StoreInfo { turned, flipped, calibrated, .. } = *store.info();
    if step.orientation.is_some() {
        return None;
    }
    if flipped != [false; 3] && step.flip.is_none() {
        let axes = axes_in_words(flipped);
        let expected = format!(
            "turned round by `flip` {axes}: pass `flip` {axes} for a file in the order of the first one, `flip` none for \
             one in the order of the store"
        );
        return Some(("its file's".into(), expected));
    }
    let has_place = step.calibrated || step.says_origin;
    if step.turned == turned || has_place && calibrated {
        return None;
    }
    let in_words = |turned: [bool; 3]| match turned {
        [false, false, false] => "that of the file".to_owned(),
        turned => format!("turned round along {}, as the coordinates descend", axes_in_words(turned)),
    };
    let way_on = "give the file such coordinates, or pack it by itself";
    Some((in_words(step.turned), format!("{}; {way_on}", in_words(turned))))
}

fn in_a_row<'a>(names: impl Iterator<Item = Option<&'a str>>) -> String {
    names.map(|name| name.unwrap_or("(no name)")).collect::<Vec<_>>().join(", ")
}

/// The time of a file's only step in a store, and a remark on it. It is left out, `None`, unless it counts as the
/// store's times do; one no later than the last step's is then refused, as that of a file appended before.
pub(super) fn own_time(store: &Store, source: &dyn Source) -> Option<(Option<f64>, String)> {
    let own = source.step_time().stamp.filter(|own| own.unit.is_some() || own.since.is_some())?;
    let words = own.in_words();
    let problem = match store.time_axis() {
        Some(axis) if own.is_on(axis) => return Some((Some(own.number), own.taken().to_string())),
        Some(TimeAxis { unit, since, .. }) => {
            let since = since.as_deref().unwrap_or("no known moment");
            format!("the store's times are in {} and count from {since}", unit.as_deref().unwrap_or("no unit"))
        }
        None => return None,
    };
    Some((None, format!("The file's own time, {words}, is left out: {problem}; `stamp` gives the step's time.")))
}

/// The time axis of a store with one more step, taken at `stamp`. `said` is the source's own axis: if its start equals
/// the store's, it is the store's own axis; otherwise its start is the step's time.
pub(super) fn next_axis(
    store: &Store,
    said: Option<&TimeAxis>,
    stamp: Option<f64>,
) -> Result<Option<TimeAxis>, AppendError> {
    let (step, times) = (store.times(), store.times());
    let time = |expected: String, found: String| Err(AppendError::Time { step, expected, found });
    let Some(axis) = store.time_axis() else {
        return match stamp.or(said.map(|said| said.start)) {
            None => Ok(None),
            Some(stamp) => time("none, as the store has no times of its steps".into(), stamp.to_string()),
        };
    };
    if let Some(unit) = said.and_then(|said| said.unit.as_ref()).filter(|unit| Some(*unit) != axis.unit.as_ref()) {
        let ours = axis.unit.as_deref().unwrap_or("no unit");
        return time(format!("the unit of the store, {ours}"), unit.clone());
    }
    let is_since = |since: &&String| Some(*since) != axis.since.as_ref() && stamp.is_none();
    if let Some(since) = said.and_then(|said| said.since.as_ref()).filter(is_since) {
        let ours = axis.since.as_deref().unwrap_or("no known moment");
        return time(format!("one since {ours}, as in the store (`stamp` gives it)"), format!("one since {since}"));
    }
    let stamp = match (stamp, said) {
        (Some(stamp), _) => stamp,
        (None, Some(said)) if said.start != axis.start => said.start,
        (None, _) if !axis.stamps.is_empty() => {
            return time("one, as the steps are not evenly spaced (`stamp` gives it)".into(), "none".into());
        }
        (None, Some(said)) if (said.step - axis.step).abs() > TOLERANCE * axis.step => {
            return time(format!("steps {} apart", axis.in_words(axis.step)), axis.in_words(said.step));
        }
        (None, _) => axis.at(times),
    };
    let next = match axis.followed_by(times, stamp) {
        Ok(next) => next,
        Err(problem) => return time(problem.expected, problem.found),
    };
    if next.stamps.len() > MAX_STAMPS {
        return time(
            format!("evenly spaced steps, or at most {MAX_STAMPS} unevenly spaced ones"),
            next.stamps.len().to_string(),
        );
    }
    Ok(Some(next))
}
