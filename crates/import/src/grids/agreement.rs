//! The properties that grids of one volume share: channels and their units, steps and their times, and a voxel type for all.

use super::Grid;
use crate::conversion::may_lose;
use crate::converted::Converted;
use crate::error::{ImportError, Result};
use crate::options::OpenOptions;
use crate::part::Part;
use brickyard_volume::{ChannelLook, TimeAxis, VoxelType, counted};

/// Converts grids of unlike voxel types to the narrowest one that holds all their numbers, or else to the caller's.
///
/// # Errors
/// If there is none, or values would be lost that may not be.
pub(super) fn of_one_type(grids: Vec<Grid>, options: &OpenOptions) -> Result<Vec<Grid>> {
    let voxel_type = |grid: &Grid| grid.source.info().voxel_type;
    let Some(first) = grids.first().map(voxel_type) else { return Ok(grids) };
    let Some(other) = grids.iter().find(|grid| voxel_type(grid) != first) else { return Ok(grids) };
    let holds_all = |to: &VoxelType| grids.iter().all(|grid| !may_lose(voxel_type(grid), *to));
    let Some(to) = VoxelType::ALL.into_iter().find(holds_all).or(options.to_voxel_type) else {
        let problem = format!(
            "voxels are {}, but those of {} are {first}, and no type holds all numbers of the grids: pass `to_voxel_type`, or \
             write them as one type",
            voxel_type(other),
            grids[0].name
        );
        return Err(ImportError::options(&other.path, problem));
    };
    let convert = |grid: Grid| {
        if voxel_type(&grid) == to {
            return Ok(grid);
        }
        let Grid { name, path, source } = grid;
        let whole = Part::of(source.info(), &OpenOptions::default(), &path)?;
        let source = Box::new(Converted::new(source, to, &whole, options, &path)?);
        Ok(Grid { name, path, source })
    };
    grids.into_iter().map(convert).collect()
}

/// The channels' looks and the steps' times, of the first grid that has them. What the caller sets for the result is not compared.
///
/// # Errors
/// If grids differ in them.
pub(super) fn common(grids: &[Grid], options: &OpenOptions) -> Result<(Vec<ChannelLook>, Option<TimeAxis>)> {
    let is_timed = options.time_step.is_some() || options.time_stamps.is_some();
    let mut looks: (Vec<ChannelLook>, &str) = (Vec::new(), "");
    let mut time: (Option<TimeAxis>, &str) = (None, "");
    for grid in grids {
        check_counts(grid, &grids[0])?;
        let own = grid.source.info();
        if own.time.is_some() && !is_timed {
            if time.0.is_some() && time.0 != own.time {
                let problem = format!(
                    "its steps have other times than those of {}: give all one time axis with `time_step` or `time_stamps`",
                    time.1
                );
                return Err(ImportError::options(&grid.path, problem));
            }
            time = (own.time.clone(), &grid.name);
        }
        if !own.channel_looks.is_empty() {
            if looks.0.is_empty() {
                looks = (own.channel_looks.clone(), &grid.name);
            }
            complete(&mut looks, grid, options)?;
        }
    }
    Ok((looks.0, time.0))
}

fn check_counts(grid: &Grid, first: &Grid) -> Result<()> {
    let (own, other) = (grid.source.info(), first.source.info());
    let counts = [("channel", own.channels, other.channels), ("time step", own.times, other.times)];
    let Some((what, own, other)) = counts.into_iter().find(|(_, own, other)| own != other) else { return Ok(()) };
    let [own, other] = [own, other].map(|count| counted(count.into(), what));
    let problem = format!("has {own}, but {} has {other}: write or list those that all grids have", first.name);
    Err(ImportError::options(&grid.path, problem))
}

/// Compares a grid's names and units of channels with those so far, and adds those that were missing.
fn complete(looks: &mut (Vec<ChannelLook>, &str), grid: &Grid, options: &OpenOptions) -> Result<()> {
    let (known, first) = looks;
    let several = known.len() > 1;
    for (channel, (known, own)) in known.iter_mut().zip(&grid.source.info().channel_looks).enumerate() {
        let differ = |known: &Option<String>, own: &Option<String>| known.is_some() && own.is_some() && known != own;
        let refuse = |what: &str, own: &Option<String>, known: &Option<String>, field: &str| {
            let [own, known] = [own, known].map(|text| text.as_deref().unwrap_or_default());
            let problem = format!(
                "channel {channel} has the {what} {own}, but that of {first} has {known}: write \"{field}\" into the entries of \
                 the list"
            );
            Err(ImportError::options(&grid.path, problem))
        };
        // A single channel is the one the list names.
        if several && differ(&known.name, &own.name) {
            return refuse("name", &own.name, &known.name, "channel_names");
        }
        if options.value_unit.is_none() && differ(&known.unit, &own.unit) {
            return refuse("unit", &own.unit, &known.unit, "value_unit");
        }
        known.name = known.name.take().or_else(|| own.name.clone());
        known.unit = known.unit.take().or_else(|| own.unit.clone());
    }
    Ok(())
}
