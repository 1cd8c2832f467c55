//! Volumes of one stack: slices of one position, told apart as channels and time steps by their [attributes](super::attributes).
//!
//! First each attribute of the kind of image that differs within positions makes channels. Then the first attribute of time that tells apart all
//! slices left at each position, and pairs those of different positions beyond doubt, makes time steps. Nothing is paired by guess: slices
//! that no attribute tells apart are refused. Costs a few numbers for each slice, while a series is opened.

use super::attributes::{At, KINDS, Rule, TIMES, When};
use super::frames::Frames;
use super::header::Header;
use super::stack::{Names, Slice, show};
use crate::error::Result;
use crate::note::{Note, Setting};
use crate::options::Gaps;
use brickyard_volume::{TimeAxis, counted};
use dicom_dictionary_std::tags;
use std::collections::{BTreeMap, BTreeSet, HashMap};

/// Largest difference of the steps of a heart beat at one position, and of its beginnings, as a part of a step.
const PHASE_TOLERANCE: f64 = 0.25;

/// Slices sorted along z, and the place of each.
#[derive(Clone, Copy)]
pub(super) struct Stacked<'a> {
    pub(super) slices: &'a [Slice],
    pub(super) levels: &'a [u32],
    pub(super) files: &'a [(Header, Frames)],
    pub(super) names: &'a Names<'a>,
}

/// Channel and time step of a slice.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(super) struct Cell {
    pub(super) time: u32,
    pub(super) channel: u32,
}

/// The volumes of a stack.
#[derive(Debug)]
pub(super) struct Volumes {
    /// A name for each channel; empty for a single one.
    pub(super) channels: Vec<String>,
    pub(super) times: u32,
    pub(super) time: Option<TimeAxis>,
    /// Volume of each slice.
    pub(super) cells: Vec<Cell>,
    pub(super) notes: Vec<Note>,
}

/// Channels and steps found so far.
struct Found {
    /// Channel of each slice, as an index in `names`.
    channels: Vec<usize>,
    names: Vec<String>,
    /// Attributes that differ.
    by: Vec<&'static str>,
}

/// Time step of each slice, and the number of steps of each channel.
struct Ranks {
    of_slice: Vec<u32>,
    counts: Vec<u32>,
}

impl<'a> Stacked<'a> {
    fn at(&self, slice: usize) -> At<'a> {
        let Slice { file, frame, .. } = self.slices[slice];
        At { header: &self.files[file].0, frame }
    }

    fn all(&self) -> impl Iterator<Item = At<'a>> {
        (0..self.slices.len()).map(|slice| self.at(slice))
    }

    fn positions(&self) -> usize {
        self.levels.chunk_by(|a, b| a == b).count()
    }

    /// Slices of each channel at each position: its indices, by channel and place.
    fn groups(&self, channels: &[usize]) -> BTreeMap<(usize, u32), Vec<usize>> {
        let mut groups: BTreeMap<_, Vec<usize>> = BTreeMap::new();
        for (slice, (channel, level)) in channels.iter().zip(self.levels).enumerate() {
            groups.entry((*channel, *level)).or_default().push(slice);
        }
        groups
    }
}

/// Finds the volumes of a stack. With `gaps` blank, slices may be missing in some of them.
///
/// # Errors
/// If slices of one position cannot be told apart, or some are missing.
pub(super) fn tell_apart(stacked: &Stacked<'_>, gaps: Gaps) -> Result<Volumes> {
    let count = stacked.slices.len();
    if stacked.positions() == count {
        let cells = vec![Cell::default(); count];
        return Ok(Volumes { channels: Vec::new(), times: 1, time: None, cells, notes: Vec::new() });
    }
    check_copies(stacked)?;
    let mut found = Found { channels: vec![0; count], names: vec![String::new()], by: Vec::new() };
    for kind in KINDS {
        refine(&mut found, kind.name, &|at| kind.value(at), &|value, all| kind.label(value, all), stacked)?;
    }
    for dimension in other_dimensions(stacked) {
        let value = |at: At| dimension_index(at, dimension).into_iter().collect();
        let label = |value: &[String], _: &[&Vec<String>]| format!("index {}", value.join(" "));
        refine(&mut found, "DimensionIndexValues", &value, &label, stacked)?;
    }
    let groups = stacked.groups(&found.channels);
    let is_told = groups.values().all(|group| group.len() == 1);
    let (when, ranks) = if is_told {
        (None, Ranks { of_slice: vec![0; count], counts: vec![1; found.names.len()] })
    } else {
        let ranked = TIMES.iter().find_map(|when| Some((when, ranks_by(when, &groups, &found, stacked)?)));
        let (when, ranks) = ranked.ok_or_else(|| alike(&groups, stacked))?;
        (Some(when), ranks)
    };
    let volumes = volumes_of(found, when, &ranks, stacked);
    check_whole(&volumes, gaps, stacked)?;
    Ok(volumes)
}

/// Names a value for a channel's name, given all values.
type Label<'a> = &'a dyn Fn(&[String], &[&Vec<String>]) -> String;

/// Splits channels by an attribute, if it differs within positions.
fn refine(
    found: &mut Found,
    name: &'static str,
    value: &dyn Fn(At) -> Vec<String>,
    label: Label<'_>,
    stacked: &Stacked<'_>,
) -> Result<()> {
    let values: Vec<Vec<String>> = stacked.all().map(value).collect();
    let groups = stacked.groups(&found.channels);
    let differs = |group: &Vec<usize>| group.iter().any(|slice| values[*slice] != values[group[0]]);
    if !groups.values().any(differs) {
        return Ok(());
    }
    let mut all: Vec<&Vec<String>> = values.iter().collect();
    all.sort_by(|a, b| by_number(a, b));
    all.dedup();
    let place: HashMap<&Vec<String>, usize> = all.iter().enumerate().map(|(i, value)| (*value, i)).collect();
    let keys: Vec<(usize, usize)> =
        found.channels.iter().zip(&values).map(|(channel, value)| (*channel, place[value])).collect();
    let distinct: Vec<(usize, usize)> = keys.iter().copied().collect::<BTreeSet<_>>().into_iter().collect();
    let new: Vec<usize> = keys.iter().map(|key| distinct.partition_point(|other| other < key)).collect();
    let mut at_level: BTreeMap<u32, BTreeSet<usize>> = BTreeMap::new();
    for (channel, level) in new.iter().zip(stacked.levels) {
        at_level.entry(*level).or_default().insert(*channel);
    }
    let whole = at_level.values().filter(|channels| channels.len() == distinct.len()).count();
    if 2 * whole < at_level.len() {
        let odd = groups.values().find(|group| differs(group)).map_or(0, |group| group[0]);
        let (values, positions) = (counted(all.len() as u64, "value"), at_level.len());
        let problem = format!(
            "slices of one position differ in {name}, but not by the same values everywhere: {values}, all of them at \
             {whole} of {positions} positions; name the files of one value"
        );
        return Err(stacked.names.refuse(&stacked.slices[odd], problem));
    }
    found.names = distinct
        .iter()
        .map(|(old, value)| {
            [found.names[*old].clone(), label(all[*value], &all)]
                .iter()
                .filter(|name| !name.is_empty())
                .cloned()
                .collect::<Vec<_>>()
                .join(", ")
        })
        .collect();
    found.channels = new;
    found.by.push(name);
    Ok(())
}

/// The order of values: those of numbers by these, then those of texts.
fn by_number(a: &[String], b: &[String]) -> std::cmp::Ordering {
    let numbers = |value: &[String]| value.iter().map(|part| part.parse::<f64>().ok()).collect::<Option<Vec<f64>>>();
    match (numbers(a), numbers(b)) {
        (Some(x), Some(y)) => {
            let parts = x.iter().zip(&y).map(|(x, y)| x.total_cmp(y));
            parts.fold(std::cmp::Ordering::Equal, std::cmp::Ordering::then).then(x.len().cmp(&y.len()))
        }
        // Numbers among texts as texts would be no order at all: 9, 10, 1a, 9.
        (x, y) => y.is_some().cmp(&x.is_some()).then_with(|| a.cmp(b)),
    }
    .then_with(|| a.cmp(b))
}

/// Dimensions of an enhanced file, besides those of place, time and kind read as elements of their own.
fn other_dimensions(stacked: &Stacked<'_>) -> Vec<usize> {
    let of_place = [
        tags::STACK_ID,
        tags::IN_STACK_POSITION_NUMBER,
        tags::IMAGE_POSITION_PATIENT,
        tags::IMAGE_ORIENTATION_PATIENT,
        tags::TEMPORAL_POSITION_INDEX,
        tags::TEMPORAL_POSITION_TIME_OFFSET,
        tags::NOMINAL_CARDIAC_TRIGGER_DELAY_TIME,
        tags::NOMINAL_PERCENTAGE_OF_CARDIAC_PHASE,
        tags::FRAME_ACQUISITION_DATE_TIME,
        tags::FRAME_REFERENCE_DATE_TIME,
    ]
    .map(|tag| tag.to_string());
    let Some((header, _)) = stacked.files.first() else { return Vec::new() };
    let pointers = header.listed(tags::DIMENSION_INDEX_SEQUENCE, tags::DIMENSION_INDEX_POINTER);
    let is_other = |pointer: &Option<String>| pointer.as_ref().is_some_and(|pointer| !of_place.contains(pointer));
    pointers.iter().enumerate().filter(|(_, pointer)| is_other(pointer)).map(|(i, _)| i).collect()
}

fn dimension_index(at: At, dimension: usize) -> Option<String> {
    let numbers = at.header.numbers(at.frame, tags::DIMENSION_INDEX_VALUES)?;
    numbers.get(dimension).map(f64::to_string)
}

/// Ranks the slices of each channel at each position by a time; `None` unless it tells them apart and pairs them by its rule.
fn ranks_by(
    when: &When,
    groups: &BTreeMap<(usize, u32), Vec<usize>>,
    found: &Found,
    stacked: &Stacked<'_>,
) -> Option<Ranks> {
    let values = when.values(stacked.all())?;
    let mut ranks = Ranks { of_slice: vec![0; values.len()], counts: Vec::new() };
    for channel in 0..found.names.len() {
        let mut sorted: Vec<Vec<usize>> =
            groups.range((channel, 0)..=(channel, u32::MAX)).map(|(_, group)| group.clone()).collect();
        sorted.iter_mut().for_each(|group| group.sort_by(|a, b| values[*a].total_cmp(&values[*b])));
        let is_apart = |group: &Vec<usize>| group.windows(2).all(|pair| values[pair[0]] < values[pair[1]]);
        if !sorted.iter().all(is_apart) {
            return None;
        }
        let mut all: Vec<f64> = sorted.iter().flatten().map(|slice| values[*slice]).collect();
        all.sort_by(f64::total_cmp);
        all.dedup();
        let whole = sorted.iter().filter(|group| group.len() == all.len()).count();
        let count = if when.rule != Rule::Count && 2 * whole >= sorted.len() {
            for slice in sorted.iter().flatten() {
                ranks.of_slice[*slice] = all.partition_point(|value| *value < values[*slice]) as u32;
            }
            all.len()
        } else if is_paired(when.rule, &sorted, &values) {
            for (rank, slice) in sorted.iter().flat_map(|group| (0..).zip(group)) {
                ranks.of_slice[*slice] = rank;
            }
            sorted.first().map_or(0, Vec::len)
        } else {
            return None;
        };
        ranks.counts.push(count as u32);
    }
    Some(ranks)
}

/// Whether the steps of different positions, each position's in order, belong together.
fn is_paired(rule: Rule, sorted: &[Vec<usize>], values: &[f64]) -> bool {
    let Some(count) = sorted.first().map(Vec::len) else { return true };
    if rule == Rule::Same || sorted.iter().any(|group| group.len() != count) {
        return false;
    }
    let of_rank = |rank: usize| sorted.iter().map(move |group| values[group[rank]]);
    let least = |rank: usize| of_rank(rank).fold(f64::INFINITY, f64::min);
    let greatest = |rank: usize| of_rank(rank).fold(f64::NEG_INFINITY, f64::max);
    if (1..count).all(|rank| greatest(rank - 1) < least(rank)) {
        return true;
    }
    let steps = |group: &Vec<usize>| group.windows(2).map(|pair| values[pair[1]] - values[pair[0]]).collect::<Vec<_>>();
    match rule {
        Rule::Count => sorted.iter().all(|group| steps(group).iter().all(|step| *step == 1.0)),
        Rule::Phase => {
            let mean =
                (of_rank(count - 1).sum::<f64>() - of_rank(0).sum::<f64>()) / (sorted.len() * (count - 1)) as f64;
            let is_even = |group: &Vec<usize>| {
                let (first, last) = (values[group[0]], values[group[count - 1]]);
                let own = (last - first) / (count - 1) as f64;
                steps(group).iter().all(|step| (step - own).abs() <= PHASE_TOLERANCE * own)
            };
            greatest(0) - least(0) <= PHASE_TOLERANCE * mean && sorted.iter().all(is_even)
        }
        Rule::Same | Rule::Time => false,
    }
}

/// Volumes by channel and step. Channels with different numbers of steps have none: each of their steps is a channel.
fn volumes_of(found: Found, when: Option<&When>, ranks: &Ranks, stacked: &Stacked<'_>) -> Volumes {
    let Found { channels, names, by } = found;
    let steps = ranks.counts.first().copied().unwrap_or(1);
    let is_regular = ranks.counts.iter().all(|count| *count == steps);
    let mut first = vec![0u32; names.len()];
    if !is_regular {
        for channel in 1..names.len() {
            first[channel] = first[channel - 1] + ranks.counts[channel - 1];
        }
    }
    let cells: Vec<Cell> = channels
        .iter()
        .zip(&ranks.of_slice)
        .map(|(channel, rank)| match is_regular {
            true => Cell { time: *rank, channel: *channel as u32 },
            false => Cell { time: 0, channel: first[*channel] + rank },
        })
        .collect();
    let named = |(name, count): (&String, &u32)| -> Vec<String> {
        match is_regular || *count == 1 {
            true => vec![name.clone()],
            false => (1..=*count).map(|number| format!("{name} ({number})")).collect(),
        }
    };
    let channels: Vec<String> = names.iter().zip(&ranks.counts).flat_map(named).collect();
    let times = if is_regular { steps } else { 1 };
    let (mut notes, mut time) = (Vec::new(), None);
    let slices = counted(stacked.slices.len() as u64, "slice");
    let at = format!("{slices} at {}", counted(stacked.positions() as u64, "position"));
    if channels.len() > 1 {
        let by = if is_regular {
            by.join(", ")
        } else {
            [by, when.iter().map(|when| when.name).collect()].concat().join(", ")
        };
        notes.push(Note::new(format!("{at}: {} channels, told apart by {by}.", channels.len())));
    }
    if let Some(when) = when.filter(|_| times > 1) {
        notes.push(Note::new(format!("{at}: {times} time steps, told apart by {}.", when.name)));
        let (axis, note) = axis_of(when, &cells, times, stacked);
        time = axis;
        notes.push(note);
    }
    Volumes { channels: if channels.len() > 1 { channels } else { Vec::new() }, times, time, cells, notes }
}

/// The times of the steps: the earliest of each step, in the first channel.
fn axis_of(when: &When, cells: &[Cell], times: u32, stacked: &Stacked<'_>) -> (Option<TimeAxis>, Note) {
    // The time of an image's making, ContentTime, may be long after.
    let others = TIMES.iter().filter(|other| other.is_time() && other.name != "ContentTime");
    let tried = std::iter::once(when).filter(|when| when.is_time()).chain(others);
    for when in tried {
        let Some(values) = when.values(stacked.all()) else { continue };
        let mut stamps = vec![f64::INFINITY; times as usize];
        for (cell, value) in cells.iter().zip(&values).filter(|(cell, _)| cell.channel == 0) {
            let stamp = &mut stamps[cell.time as usize];
            *stamp = stamp.min(*value);
        }
        if let Ok(axis) = TimeAxis::of_stamps(stamps, Some("second".into())) {
            let note = format!("Times are by {}: {}.", when.name, axis.describe());
            return (Some(axis), Note::new(note));
        }
    }
    (None, Note::warning("The steps have no times: `time_step` or `time_stamps` give them.").settled_by(Setting::Times))
}

/// Refuses copies of an image.
fn check_copies(stacked: &Stacked<'_>) -> Result<()> {
    let mut seen = HashMap::new();
    for (i, slice) in stacked.slices.iter().enumerate() {
        let At { header, frame } = stacked.at(i);
        let Some(uid) = header.text(tags::SOP_INSTANCE_UID).filter(|uid| !uid.is_empty()) else { continue };
        if let Some(other) = seen.insert((uid, frame), slice) {
            let other = stacked.names.of(other);
            let problem = format!("is the same image as {other} (SOPInstanceUID): name it once, or take it out");
            return Err(stacked.names.refuse(slice, problem));
        }
    }
    Ok(())
}

/// Refuses slices that nothing tells apart.
fn alike(groups: &BTreeMap<(usize, u32), Vec<usize>>, stacked: &Stacked<'_>) -> crate::error::ImportError {
    let Stacked { slices, names, .. } = *stacked;
    let group = groups.values().find(|group| group.len() > 1);
    let [a, b] = [0, 1].map(|i| &slices[group.and_then(|group| group.get(i)).copied().unwrap_or(0)]);
    let (other, position) = (names.of(a), show(b.position));
    let (count, positions) = (slices.len(), stacked.positions());
    let tried: Vec<&str> = TIMES.iter().map(|when| when.name).collect();
    let uneven = uneven_counts(stacked);
    let problem = format!(
        "has the position of {other}, {position}: {count} slices at {positions} positions{uneven}; none of {} tells all \
         slices of each position apart, and pairs them with those of others; name the files of one time step, echo or phase only, \
         each once",
        tried.join(", ")
    );
    names.refuse(b, problem)
}

/// Numbers of slices at a usual position and at an unusual one, for messages.
fn uneven_counts(stacked: &Stacked<'_>) -> String {
    let Stacked { slices, levels, names, .. } = *stacked;
    let mut first = 0;
    let mut runs: Vec<(usize, usize)> = Vec::new();
    for run in levels.chunk_by(|a, b| a == b) {
        runs.push((first, run.len()));
        first += run.len();
    }
    let mut counts: BTreeMap<usize, usize> = BTreeMap::new();
    runs.iter().for_each(|(_, count)| *counts.entry(*count).or_default() += 1);
    let usual = counts.iter().max_by_key(|(_, often)| **often).map_or(0, |(count, _)| *count);
    match runs.iter().find(|(_, count)| *count != usual) {
        Some((at, count)) => {
            let slice = &slices[*at];
            format!(", {usual} at most of them, {count} at {} ({})", show(slice.position), names.of(slice))
        }
        None => String::new(),
    }
}

/// Checks that no slice is missing from any volume, unless gaps are blank.
fn check_whole(volumes: &Volumes, gaps: Gaps, stacked: &Stacked<'_>) -> Result<()> {
    let Stacked { slices, levels, names, .. } = *stacked;
    let count = (volumes.channels.len().max(1) as u64) * u64::from(volumes.times);
    let expected = count.saturating_mul(stacked.positions() as u64);
    let missing = expected.saturating_sub(slices.len() as u64);
    if missing == 0 {
        return Ok(());
    }
    let present: BTreeSet<(Cell, u32)> = volumes.cells.iter().copied().zip(levels.iter().copied()).collect();
    let mut first = 0;
    for run in levels.chunk_by(|a, b| a == b) {
        if run.len() as u64 == count {
            first += run.len();
            continue;
        }
        let cells = (0..volumes.times)
            .flat_map(|time| (0..volumes.channels.len().max(1) as u32).map(move |channel| Cell { time, channel }));
        let lost = cells.into_iter().find(|cell| !present.contains(&(*cell, run[0]))).unwrap_or_default();
        if gaps == Gaps::Blank && missing <= slices.len() as u64 {
            return Ok(());
        }
        let channel = volumes.channels.get(lost.channel as usize).map_or(String::new(), |name| format!(" of {name}"));
        let step = if volumes.times > 1 { format!(" of time step {}", lost.time) } else { String::new() };
        let (found, positions) = (slices.len(), stacked.positions());
        let are = if missing == 1 { "is" } else { "are" };
        let advice = match gaps {
            Gaps::Blank => "name the files of whole volumes",
            Gaps::Refuse => "add the missing files, or pass `gaps` blank to leave their places without data",
        };
        let problem = format!(
            "{missing} of {expected} slices {are} missing: {positions} positions with {count} slices each were expected, found {found} slices; \
             at {}, the position of this file, {} of {count} are there, and the slice{step}{channel} is not; {advice}",
            show(slices[first].position),
            run.len()
        );
        return Err(names.refuse(&slices[first], problem));
    }
    Ok(())
}
