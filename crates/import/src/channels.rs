//! Several sources as the channels of one: variables of a file, or files, each under its name, on one grid at the same times. Boxes pass through as
//! they are, or converted to one voxel type and one mark for no data; costs nothing besides the sources, all of which stay open.

mod one_type;
#[cfg(test)]
mod tests;

use crate::error::{ImportError, Result};
use crate::labels::SaidKind;
use crate::mirrored::Mirrored;
use crate::note::Note;
use crate::options::OpenOptions;
use crate::series::Remarks;
use crate::source::{Access, Source, SourceInfo, Take};
use crate::step_time::StepTime;
use brickyard_volume::{ChannelLook, Extent, Geometry, VoxelBox, counted};
use std::collections::HashSet;
use std::path::PathBuf;

/// Most channels joined: each has a name in memory.
const MOST_CHANNELS: u32 = 1 << 16;

/// Largest distance between two places of a voxel that count as one, in voxels.
const SAME_PLACE_VOXELS: f64 = 1e-3;

/// A source to be joined, and its name.
pub(crate) struct NamedArray {
    pub(crate) name: String,
    /// Its file, for messages.
    pub(crate) path: PathBuf,
    pub(crate) source: Box<dyn Source>,
}

/// Sources as the channels of one, in their order. A source of several channels keeps them side by side.
pub(crate) struct Channels {
    info: SourceInfo,
    parts: Vec<Placed>,
}

/// A source, and its first channel among all.
struct Placed {
    first: u32,
    source: Box<dyn Source>,
}

impl Channels {
    /// Joins sources, those of several voxel types converted to one. In floats, voxels without data have no common value unless the sources
    /// have one: all are NaN.
    ///
    /// # Errors
    /// If there are none, two have one name, they differ in extent, times, place or value for no data, or no voxel type holds the values of all.
    pub(crate) fn new(parts: Vec<NamedArray>, options: &OpenOptions) -> Result<Self> {
        let kinds = parts.iter().map(|part| (part.path.as_path(), part.source.info().kind));
        let kind = SaidKind::of_all(kinds, options.are_labels.is_some())?;
        let mut parts = turned_alike(parts, options)?;
        let mut info = described(&parts)?;
        let are_marked_alike = one_type::are_marked_alike(&parts);
        if one_type::are_unlike(&parts) || !are_marked_alike {
            parts = one_type::in_one_type(parts, &info, options)?;
            info = described(&parts)?;
        }
        info.kind = kind;
        if !are_marked_alike {
            (info.nodata, info.knows_nodata) = (None, true);
        }
        let mut first = 0;
        let placed = parts.into_iter().map(|NamedArray { source, .. }| {
            let channels = source.info().channels;
            let placed = Placed { first, source };
            first += channels;
            placed
        });
        Ok(Self { info, parts: placed.collect() })
    }

    /// The source of a channel, and the channel's number there.
    fn part(&self, channel: u32) -> (&dyn Source, u32) {
        let after = self.parts.partition_point(|part| part.first <= channel);
        let part = &self.parts[after - 1];
        (&*part.source, channel - part.first)
    }

    /// The sum of an amount over the sources.
    fn sum(&self, of: impl Fn(&dyn Source) -> u64) -> u64 {
        self.parts.iter().fold(0, |sum, part| sum.saturating_add(of(&*part.source)))
    }
}

impl Source for Channels {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    /// Whole planes if one source decodes them.
    fn access(&self) -> Access {
        let has_planes = self.parts.iter().any(|part| part.source.access() == Access::Planes);
        if has_planes { Access::Planes } else { Access::Box }
    }

    fn reader_bytes(&self) -> u64 {
        self.parts.iter().map(|part| part.source.reader_bytes()).max().unwrap_or(0)
    }

    fn held_bytes(&self) -> u64 {
        self.sum(|source| source.held_bytes())
    }

    fn scratch_bytes(&self) -> u64 {
        self.sum(|source| source.scratch_bytes())
    }

    /// The time of those that say one, if it is one time.
    fn step_time(&self) -> StepTime {
        let mut said =
            self.parts.iter().map(|part| part.source.step_time()).filter(|time| *time != StepTime::default());
        let first = said.next().unwrap_or_default();
        if said.all(|time| time == first) { first } else { StepTime::default() }
    }

    fn read_box(&self, time: u32, channel: u32, region: VoxelBox, out: &mut [u8]) -> Result<(), ImportError> {
        self.info.check_box(time, channel, region, out);
        let (source, own) = self.part(channel);
        source.read_box(time, own, region, out)
    }

    fn lend(&self, time: u32, channel: u32, region: VoxelBox, take: Take<'_>) -> Result<bool, ImportError> {
        let (source, own) = self.part(channel);
        source.lend(time, own, region, take)
    }

    fn announce(&self, time: u32, channel: u32, region: VoxelBox) {
        let (source, own) = self.part(channel);
        source.announce(time, own, region);
    }

    fn constant_in(&self, time: u32, channel: u32, region: VoxelBox) -> Option<f64> {
        let (source, own) = self.part(channel);
        source.constant_in(time, own, region)
    }
}

/// Turns sources without a place as those are turned from which they take it: voxels of one number in their files lie in one place.
///
/// # Errors
/// If the caller gives all a place, and some are turned: in which order the others are meant is not known.
fn turned_alike(parts: Vec<NamedArray>, options: &OpenOptions) -> Result<Vec<NamedArray>> {
    let Some(by) = parts.iter().find(|part| part.source.info().turned != [false; 3]) else { return Ok(parts) };
    let (turned, shown) = (by.source.info().turned, shown(by));
    let is_placed_by_caller = options.spacing.is_some() || options.origin.is_some();
    let is_other = |part: &&NamedArray| part.source.info().turned != turned;
    if let Some(other) = parts.iter().find(|part| is_placed_by_caller && is_other(part)) {
        let problem = format!(
            "its voxels come in the file's order, but those of {shown} turned round, as its coordinates descend: leave the place to \
             these coordinates, without `spacing` and `origin`, or pack each by itself"
        );
        return Err(ImportError::options(&other.path, problem));
    }
    let placeless = parts.iter().find(|part| !part.source.info().has_place());
    let other = parts.iter().find(|part| part.source.info().has_place() && is_other(part));
    if let (Some(placeless), Some(other)) = (placeless, other) {
        let problem = format!(
            "it has no place of its own, and the axes of {shown} and {} run in unlike orders in their files: its own is not known; pack it by itself",
            other.name
        );
        return Err(ImportError::options(&placeless.path, problem));
    }
    // One appended to a store may be turned as its steps before already.
    let turn = |part: NamedArray| match part.source.info().has_place() || part.source.info().turned == turned {
        true => part,
        false => NamedArray { source: Mirrored::turned(part.source, turned), ..part },
    };
    Ok(parts.into_iter().map(turn).collect())
}

/// The description of all: that of the first source, with the place and times of the first which says them.
fn described(parts: &[NamedArray]) -> Result<SourceInfo> {
    let Some(first) = parts.first() else {
        return Err(ImportError::options(std::path::Path::new("input"), "none given"));
    };
    let mut names = HashSet::new();
    if let Some(twice) = parts.iter().find(|part| !names.insert(&part.name)) {
        let problem = format!("the channel '{}' is named twice: give each another name", twice.name);
        return Err(ImportError::options(&twice.path, problem));
    }
    let mut info = first.source.info().clone();
    (info.channels, info.channel_looks, info.notes, info.identity) = (0, Vec::new(), Vec::new(), "channels".into());
    let mut remarks = Remarks::default();
    let placed = parts.iter().find(|part| part.source.info().has_place());
    let timed = parts.iter().find(|part| part.source.info().time.is_some());
    for part in parts {
        let own = part.source.info();
        check_alike(part, first)?;
        if let Some(placed) = placed.filter(|_| own.has_place()) {
            check_place(part, placed)?;
        } else if let Some(placed) = placed {
            let (name, other) = (&part.name, &placed.name);
            let turned =
                if placed.source.info().turned == [false; 3] { "" } else { ", and is turned round as that is" };
            info.notes.push(Note::new(format!(
                "{name} has no voxel size or place of its own: it takes those of {other}{turned}."
            )));
        }
        if let Some(timed) = timed.filter(|timed| own.time.is_some() && own.time != timed.source.info().time) {
            let problem = format!(
                "its steps have other times than those of {}: pack each by itself, or give all with `time_step` or `time_stamps`",
                shown(timed)
            );
            return Err(ImportError::options(&part.path, problem));
        }
        info.channels = info.channels.saturating_add(own.channels);
        if info.channels > MOST_CHANNELS {
            let problem = format!("{MOST_CHANNELS} channels are the most in one volume: leave some out");
            return Err(ImportError::options(&part.path, problem));
        }
        info.channel_looks.extend(looks_of(part));
        info.identity += &format!("\n{:?} {}", part.name, own.identity);
        remarks.add(&own.notes, &part.name);
    }
    info.notes.extend(remarks.of_all(parts.len(), "channels"));
    if let Some(placed) = placed.map(|part| part.source.info()) {
        info.geometry = placed.geometry.clone();
        (info.calibrated, info.says_origin, info.orientation) =
            (placed.calibrated, placed.says_origin, placed.orientation);
    }
    info.time = timed.and_then(|part| part.source.info().time.clone());
    Ok(info)
}

/// Looks of a source's channels: its name, with theirs if there are several.
fn looks_of(part: &NamedArray) -> Vec<ChannelLook> {
    let own = part.source.info();
    let look = |channel: u32| {
        let look = own.channel_looks.get(channel as usize).cloned().unwrap_or_default();
        let name = match (own.channels, &look.name) {
            (1, _) => part.name.clone(),
            (_, Some(name)) => format!("{}.{name}", part.name),
            (_, None) => format!("{}.{channel}", part.name),
        };
        ChannelLook { name: Some(name), ..look }
    };
    (0..own.channels.min(MOST_CHANNELS)).map(look).collect()
}

/// Name and file of a source, for messages.
fn shown(part: &NamedArray) -> String {
    format!("{} ({})", part.name, part.path.display())
}

/// Checks the properties shared by all channels of a volume.
fn check_alike(part: &NamedArray, first: &NamedArray) -> Result<()> {
    let (own, other) = (part.source.info(), first.source.info());
    let differs = |what: &str, own: String, other: String, way_on: &str| {
        let (name, first) = (&part.name, shown(first));
        Err(ImportError::invalid(
            &part.path,
            format!("{what} of {name} is {own}, but that of {first} is {other}: {way_on}"),
        ))
    };
    if own.extent != other.extent {
        let way_on = "channels share one grid: resample one of them, or pack each by itself";
        return differs("the extent", own.extent.to_string(), other.extent.to_string(), way_on);
    }
    if own.times != other.times {
        let [own, other] = [own, other].map(|info| counted(info.times.into(), "time step"));
        return differs("the length", own, other, "pack the steps that both have");
    }
    Ok(())
}

/// Checks that every voxel of two sources has one place.
fn check_place(part: &NamedArray, placed: &NamedArray) -> Result<()> {
    let (own, other) = (part.source.info(), placed.source.info());
    let differs = |what: &str, [own, other]: [String; 2], option: &str| {
        let (name, placed) = (&part.name, shown(placed));
        let problem = format!(
            "{what} of {name} is {own}, but that of {placed} is {other}: give one for all with `{option}`, or pack each by itself"
        );
        Err(ImportError::options(&part.path, problem))
    };
    let (own_place, other_place) = (&own.geometry, &other.geometry);
    if stray_voxels(own_place, other_place, own.extent) > SAME_PLACE_VOXELS {
        return differs("the spacing", [own_place, other_place].map(|at| at.spacing.to_string()), "spacing");
    }
    let shift = ((own_place.origin - other_place.origin) / other_place.spacing).abs().max_element();
    if shift.is_nan() || shift > SAME_PLACE_VOXELS {
        return differs("the first voxel's place", [own_place, other_place].map(|at| at.origin.to_string()), "origin");
    }
    if own_place.units_in_words() != other_place.units_in_words() {
        let unit = |at: &Geometry| at.units_in_words().unwrap_or_else(|| "not said".into());
        return differs("the unit", [own_place, other_place].map(unit), "unit");
    }
    let lies_there = match (&own.orientation, &other.orientation) {
        (Some(own), Some(other_map)) => own.agrees(other_map, other.extent),
        (own, other) => own == other,
    };
    if !lies_there {
        let problem =
            format!("lies differently in the patient than {}: register them, or pack each by itself", shown(placed));
        return Err(ImportError::invalid(&part.path, problem));
    }
    Ok(())
}

/// How far apart two spacings take the last voxel of an extent, in voxels.
fn stray_voxels(own: &Geometry, other: &Geometry, extent: Extent) -> f64 {
    let counts = glam::DVec3::from_array(extent.to_array().map(f64::from));
    let stray = ((own.spacing - other.spacing) / other.spacing * counts).abs().max_element();
    if stray.is_nan() { f64::INFINITY } else { stray }
}
