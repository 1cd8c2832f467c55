//! BigDataViewer's HDF5: a dataset for each time point, setup and level, of which the finest is read. Setups of one size and place are
//! channels; an XML beside the file tells their names and places. Costs the chunk index of every dataset.

use super::file::{File, cause_of};
use super::layout::{Elements, elements_of};
use super::source::Opening;
use super::spim_data::{Affine, Setup, SpimData};
use super::types::Stored;
use crate::axes::{Axis, Sizes};
use crate::element::{Decode, Element};
use crate::error::{ImportError, Result};
use crate::note::{Note, Setting};
use crate::options::OpenOptions;
use crate::placement::set_matrix;
use crate::raw::identity;
use crate::source::{Source, SourceInfo};
use brickyard_volume::units::LengthUnit;
use brickyard_volume::{ChannelLook, Extent, VoxelType};
use glam::DVec3;
use hdf5_reader::Dataset;
use hdf5_reader::error::Error;
use std::collections::HashSet;
use std::path::Path;

/// Largest relative difference of equal sizes and places.
const EQUAL: f64 = 1e-6;

/// Most views opened, each a dataset: an XML of one line can tell of millions.
const MOST_VIEWS: usize = 1 << 20;

/// Setups and time points of a file.
pub(super) struct Views {
    pub(super) setups: Vec<Setup>,
    pub(super) times: Vec<u32>,
}

/// A setup to be opened: its datasets have the size and type of this one.
struct First {
    set: Dataset,
    stored: Stored,
}

fn path_of(time: u32, setup: u32) -> String {
    format!("/t{time:05}/s{setup:02}/0/cells")
}

/// Whether a path is that of a view's voxels.
pub(super) fn are_cells(path: &str) -> bool {
    let parts: Vec<&str> = path.split('/').collect();
    let is = |part: &str, start: &str| part.strip_prefix(start).is_some_and(|number| number.parse::<u32>().is_ok());
    matches!(parts[..], ["", time, setup, level, "cells"] if is(time, "t") && is(setup, "s") && is(level, ""))
}

/// BigDataViewer keeps unsigned numbers under the signed type of Java.
pub(super) fn without_sign(element: Element) -> Element {
    if element == Element::Voxel(VoxelType::I16) { Element::Voxel(VoxelType::U16) } else { element }
}

/// The setups and time points of a file with the groups of BigDataViewer; `None` for others.
pub(super) fn views_of(file: &File) -> Option<Views> {
    let root = file.hdf.root_group().ok()?;
    let (groups, _) = root.member_names().ok()?;
    let numbers = |letter: char| {
        let of = |name: &String| {
            let digits = name.strip_prefix(letter).filter(|digits| digits.bytes().all(|byte| byte.is_ascii_digit()));
            digits?.parse::<u32>().ok()
        };
        let mut numbers: Vec<u32> = groups.iter().filter_map(of).collect();
        numbers.sort_unstable();
        numbers
    };
    let (setups, times) = (numbers('s'), numbers('t'));
    file.hdf.dataset(&format!("/s{:02}/resolutions", setups.first()?)).ok()?;
    // Any view may be missing.
    let mut paths = times.iter().flat_map(|time| setups.iter().map(|setup| path_of(*time, *setup)));
    paths.find(|path| file.hdf.dataset(path).is_ok())?;
    let setups = setups.into_iter().map(|id| Setup { id, ..Setup::default() }).collect();
    Some(Views { setups, times })
}

/// The setup that a name means: `s00`, its number or its name.
pub(super) fn setup_of(views: &Views, name: &str) -> Option<Setup> {
    let is_named = |setup: &&Setup| {
        name == format!("s{:02}", setup.id) || name == setup.id.to_string() || !name.is_empty() && name == setup.name
    };
    let mut found = views.setups.iter().filter(is_named);
    found.next().filter(|_| found.next().is_none()).cloned()
}

/// Opens the finest level of setups. `told` is the XML, with the path of its file.
pub(super) fn open(
    file: &File,
    mut views: Views,
    told: Option<(&Path, &SpimData)>,
    options: &OpenOptions,
) -> Result<Box<dyn Source>> {
    if options.axes.is_some() {
        let problem =
            "`axes`: those of BigDataViewer's files are known; leave it out, or name a dataset with `variable`";
        return Err(ImportError::options(&file.path, problem));
    }
    if let Some(name) = &options.variable {
        let none = || {
            let problem = format!("`variable` {name}: no such setup; there are {}", listed(file, &views));
            ImportError::options(&file.path, problem)
        };
        views.setups = vec![setup_of(&views, name).ok_or_else(none)?];
    }
    let count = views.setups.len().saturating_mul(views.times.len());
    if count > MOST_VIEWS {
        let advice = "name one setup with `variable`, or export fewer time points";
        return Err(ImportError::unsupported_but(&file.path, format!("BigDataViewer's file of {count} views"), advice));
    }
    check_alike(file, &views, told.map(|(_, told)| told))?;
    let First { set: first, stored } = first_of(file, views.times[0], views.setups[0].id)?;
    let &[z, y, x] = first.shape() else {
        return Err(file.damaged(&path_of(views.times[0], views.setups[0].id), "it has no three axes"));
    };
    let too_long = || ImportError::unsupported(&file.path, format!("a volume of {x} x {y} x {z} voxels"));
    let size = |n: u64| u32::try_from(n).map_err(|_| too_long());
    let extent = Extent::new(size(x)?, size(y)?, size(z)?);
    let mut arrays = Vec::new();
    for (time, setup) in views.times.iter().flat_map(|time| views.setups.iter().map(move |setup| (*time, setup.id))) {
        let path = path_of(time, setup);
        let found = first_of(file, time, setup)?;
        if found.set.shape() != first.shape() || found.stored != stored {
            return Err(file.damaged(&path, "it differs from that of the first time point in size or type"));
        }
        let id = arrays.len() as u64;
        match elements_of(file, &found.set, &stored, &path, id)? {
            Elements::Chunks(chunks) if chunks.known.is_none() => arrays.push(chunks),
            _ => {
                let advice = "name one dataset by its path with `variable`";
                return Err(ImportError::unsupported_but(&file.path, format!("{path} without chunks"), advice));
            }
        }
    }
    let sizes = Sizes { extent, channels: views.setups.len() as u32, times: views.times.len() as u32 };
    sizes.checked_bytes(stored.bytes).map_err(|problem| ImportError::invalid(&file.path, problem))?;
    let decode = Decode { element: without_sign(stored.element), endian: stored.endian, scale: None };
    let mut info = SourceInfo::plain(sizes, decode.voxel_type());
    let ids: Vec<u32> = views.setups.iter().map(|setup| setup.id).collect();
    let files: Vec<&Path> = told.iter().map(|(path, _)| *path).chain([&*file.path]).collect();
    info.identity = identity(&format!("hdf5 bdv {ids:?}"), &files)?;
    info.notes.push(Note::new("BigDataViewer's finest level is read; its 16-bit numbers have no sign."));
    let name = |setup: &Setup| match &*setup.name {
        "" => format!("setup {}", setup.id),
        name => name.into(),
    };
    let look = |setup: &Setup| ChannelLook { name: Some(name(setup)), ..ChannelLook::default() };
    info.channel_looks = views.setups.iter().map(look).collect();
    match told {
        Some((_, told)) => place(&mut info, &views, told),
        None => info.notes.push(Note::warning(
            "Sizes and places of voxels are in the .xml file of BigDataViewer: open that one, if there is one.",
        )),
    }
    let axes = vec![Axis::Z, Axis::Y, Axis::X];
    Ok(Box::new(Opening { file, info, axes, decode, has_members: false }.chunks(arrays, options)?))
}

fn first_of(file: &File, time: u32, setup: u32) -> Result<First> {
    let path = path_of(time, setup);
    let set = file.hdf.dataset(&path).map_err(|error| match cause_of(&error) {
        Error::GroupNotFound(_) | Error::DatasetNotFound(_) => {
            let feature = format!("{path}, a view that is missing or lies in another file,");
            let advice = "name a setup with `variable` whose views are all in this file";
            ImportError::unsupported_but(&file.path, feature, advice)
        }
        _ => file.refusal(&path, &error),
    })?;
    let stored = Stored::of(&set).and_then(|stored| match stored.members.len() {
        0 => Ok(stored),
        _ => Err(stored.name()),
    });
    let stored = stored.map_err(|name| ImportError::unsupported(&file.path, format!("{name} of {path}")))?;
    Ok(First { set, stored })
}

/// Setups in words.
fn listed(file: &File, views: &Views) -> String {
    let describe = |setup: &Setup| {
        let size = first_of(file, views.times[0], setup.id).map_or_else(
            |_| "unreadable".into(),
            |found| found.set.shape().iter().map(u64::to_string).collect::<Vec<_>>().join(" x "),
        );
        let name = if setup.name.is_empty() { String::new() } else { format!("{}, ", setup.name) };
        format!("s{:02} ({name}{size})", setup.id)
    };
    let shown: Vec<String> = views.setups.iter().take(30).map(describe).collect();
    let more = views.setups.len().saturating_sub(30);
    if more > 0 { format!("{}, and {more} more", shown.join(", ")) } else { shown.join(", ") }
}

/// Refuses setups that are not channels of one volume, and views without voxels.
fn check_alike(file: &File, views: &Views, told: Option<&SpimData>) -> Result<()> {
    let wanted: HashSet<u32> = views.setups.iter().map(|setup| setup.id).collect();
    if let Some((time, setup)) = told.and_then(|told| told.missing.iter().find(|(_, setup)| wanted.contains(setup))) {
        let advice = "name a setup without missing views with `variable`";
        let feature = format!("a missing view (time point {time} of setup {setup})");
        return Err(ImportError::unsupported_but(&file.path, feature, advice));
    }
    let first = first_of(file, views.times[0], views.setups[0].id)?;
    for setup in &views.setups[1..] {
        let found = first_of(file, views.times[0], setup.id)?;
        let differs = match told {
            _ if found.set.shape() != first.set.shape() => "size",
            _ if found.stored != first.stored => "type",
            Some(_) if !are_near(&setup.voxel, &views.setups[0].voxel) => "voxel size",
            Some(told)
                if views
                    .times
                    .iter()
                    .any(|time| place_of(told, *time, setup.id) != place_of(told, *time, views.setups[0].id)) =>
            {
                "place"
            }
            _ => continue,
        };
        let problem = format!(
            "setups of unlike {differs} are no channels of one volume; name one with `variable`: {}",
            listed(file, views)
        );
        return Err(ImportError::options(&file.path, problem));
    }
    Ok(())
}

fn place_of(told: &SpimData, time: u32, setup: u32) -> Option<&Affine> {
    told.places.get(&(time, setup))
}

fn are_near(a: &Option<[f64; 3]>, b: &Option<[f64; 3]>) -> bool {
    match (a, b) {
        (Some(a), Some(b)) => a.iter().zip(b).all(|(a, b)| (a - b).abs() <= EQUAL * b.abs()),
        (a, b) => a.is_none() && b.is_none(),
    }
}

/// Sets voxel size, unit and place from the XML.
fn place(info: &mut SourceInfo, views: &Views, told: &SpimData) {
    let setup = &views.setups[0];
    let voxel = setup.voxel.filter(|voxel| voxel.iter().all(|size| *size > 0.0));
    let mut notes = Vec::new();
    if let Some(voxel) = voxel {
        info.geometry.spacing = DVec3::from_array(voxel);
        let unit = setup.unit.as_deref().unwrap_or_default();
        info.geometry.unit = LengthUnit::of_text(unit).map(|unit| unit.name.to_owned());
        if info.geometry.unit.is_none() && !["", "px", "pixel", "pixels"].contains(&unit) {
            notes.push(
                Note::warning(format!("The unit {unit} is no known length: it is left out.")).settled_by(Setting::Unit),
            );
        }
        info.calibrated = true;
    }
    let first = place_of(told, views.times[0], setup.id);
    let is_moved = views.times.iter().any(|time| place_of(told, *time, setup.id) != first);
    match first {
        None => {}
        Some(_) if is_moved => notes.push(Note::warning(
            "Time points lie in unlike places (ViewRegistrations), of which there can be but one: they are left out.",
        )),
        Some(matrix) => {
            let lengths = [0, 1, 2].map(|a| (0..3).map(|row| matrix[row][a].powi(2)).sum::<f64>().sqrt());
            if lengths.iter().any(|length| !(length.is_finite() && *length > 0.0)) {
                info.notes.append(&mut notes);
                info.notes.push(Note::warning("The registration flattens the volume: it is left out."));
                return;
            }
            let factor = voxel.map_or(1.0, |voxel| voxel[0] / lengths[0]);
            // Registrations may count in voxels of x: their lengths then become those of the voxel size.
            let scaled = lengths.map(|length| length * factor);
            let agrees = voxel.is_none() || are_near(&Some(scaled), &voxel);
            let matrix = if agrees { matrix.map(|row| row.map(|n| n * factor)) } else { *matrix };
            if !agrees {
                info.geometry.unit = None;
                notes.push(Note::warning(
                    "The registration scales voxels unlike their voxel size: positions are the registration's, without a unit.",
                ));
            }
            info.geometry.spacing = DVec3::from_array(if agrees { scaled } else { lengths });
            info.calibrated = true;
            let is_upright =
                (0..3).all(|row| (0..3).all(|a| if row == a { matrix[row][a] > 0.0 } else { matrix[row][a] == 0.0 }));
            if is_upright {
                info.geometry.origin = DVec3::new(matrix[0][3], matrix[1][3], matrix[2][3]);
            } else {
                notes.push(Note::new(
                    "The registration turns, shears or mirrors the volume: its world's axes are taken as right, front and head.",
                ));
                set_matrix(matrix, info, &mut notes);
            }
        }
    }
    info.notes.append(&mut notes);
}
