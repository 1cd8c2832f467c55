//! Axes of a dataset: their names and coordinates, as NetCDF, NeXus, h5py and ilastik say them.

use super::attributes::{named, number, text, texts};
use super::file::File;
use super::layout::{Elements, elements_of};
use super::tree::{Entry, Tree, join, parent_of};
use super::types::Stored;
use crate::array_choice::last_of;
use crate::cf::axes::{Dim, MOST_COORDINATES, Scale};
use crate::element::Element;
use crate::error::{ImportError, Result};
use crate::note::Note;
use brickyard_volume::VoxelType;
use hdf5_reader::{Attribute, Datatype, ReferenceType};

/// Everything known of a dataset's axes, slowest first. Notes tell of coordinates that cannot be read.
pub(super) fn dims_of(file: &File, tree: &Tree, entry: &Entry, notes: &mut Vec<Note>) -> Vec<Dim> {
    let shape = entry.set.shape();
    let group = parent_of(&entry.path);
    let mut scales = attached(tree, entry);
    scales.resize(shape.len(), None);
    let mut names: Vec<Option<String>> =
        scales.iter().map(|scale| scale.map(|scale| last_of(&scale.path).to_owned())).collect();
    let labels = texts(&entry.attributes, "DIMENSION_LABELS");
    let keys = vigra_keys(&entry.attributes);
    let nexus = nexus_names(tree, entry, group);
    for told in [keys, nexus, labels] {
        if told.len() != names.len() {
            continue;
        }
        for (name, told) in names.iter_mut().zip(told) {
            if name.is_none() && !told.is_empty() && told != "." {
                *name = Some(told);
            }
        }
    }
    let is_plot =
        tree.group(group).is_some_and(|group| text(&group.attributes, "NX_class").as_deref() == Some("NXdata"));
    let mut dims = Vec::with_capacity(shape.len());
    for ((name, scale), size) in names.into_iter().zip(scales).zip(shape) {
        let of_name = || tree.set(&join(group, name.as_deref()?));
        // Coordinates of a name have that name, and as many elements; those of a histogram in NeXus are the edges of its bins. A variable along
        // records of NetCDF may end before its coordinates do.
        let is_attached = scale.is_some();
        let scale = scale.or_else(of_name).and_then(|scale| match *scale.set.shape() {
            [count] if count == *size || is_attached && count > *size => Some((scale, false)),
            [count] if is_plot && count.checked_sub(1) == Some(*size) => Some((scale, true)),
            _ => None,
        });
        let scale = scale.map(|(scale, are_edges)| match scale_of(file, scale, are_edges, *size) {
            (scale, None) => scale,
            (scale, Some(problem)) => {
                notes.push(Note::warning(format!("The coordinates {} are left out: {problem}.", scale.name)));
                scale
            }
        });
        dims.push(Dim { name, scale });
    }
    dims
}

/// A scale with its first numbers, unless it stands for a NetCDF dimension without a variable; and why there are none.
fn scale_of(file: &File, entry: &Entry, are_edges: bool, size: u64) -> (Scale, Option<ImportError>) {
    let is_blank = text(&entry.attributes, "NAME")
        .is_some_and(|name| name.starts_with("This is a netCDF dimension but not a netCDF variable"));
    let is_long = entry.set.shape().iter().product::<u64>() > MOST_COORDINATES;
    let stored = entry.stored.as_ref().ok().filter(|stored| stored.members.is_empty() && !is_blank && !is_long);
    let (numbers, problem) = match stored.map(|stored| Ok(stored.numbers(&bytes_of(file, entry, stored)?))) {
        None => (None, None),
        Some(Ok(numbers)) => (Some(numbers), None),
        Some(Err(problem)) => (None, Some(problem)),
    };
    let middles = |numbers: Vec<f64>| numbers.windows(2).map(|edges| (edges[0] + edges[1]) / 2.0).collect();
    let mut numbers = if are_edges { numbers.map(middles) } else { numbers };
    numbers.iter_mut().for_each(|numbers| numbers.truncate(usize::try_from(size).unwrap_or(usize::MAX)));
    let is_single = stored.is_some_and(|stored| stored.element == Element::Voxel(VoxelType::F32));
    (Scale::of(&entry.path, &entry.attributes[..], numbers, is_single), problem)
}

/// The elements of a dataset along one axis, by the filters that are undone for voxels: the parser itself knows fewer.
fn bytes_of(file: &File, entry: &Entry, stored: &Stored) -> Result<Vec<u8>> {
    let damaged = |problem: String| file.damaged(&entry.path, &problem);
    match elements_of(file, &entry.set, stored, &entry.path, 0)? {
        Elements::Chunks(chunks) => chunks.line(&file.map).map_err(damaged),
        Elements::Piece(start) => {
            let count = entry.set.shape().iter().product::<u64>() as usize * stored.bytes;
            let range = usize::try_from(start).ok().and_then(|start| Some(start..start.checked_add(count)?));
            let bytes = range.and_then(|range| file.map.get(range));
            bytes.map(<[u8]>::to_vec).ok_or_else(|| damaged("it ends behind the file".into()))
        }
    }
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

/// Names of axes of a NeXus plot: the group's `axes`, at the places that `NAME_indices` tell; the dataset's own, with colons in old files; or
/// those of the coordinates, which tell their places in older ones. Empty where there is none.
fn nexus_names(tree: &Tree, entry: &Entry, group: &str) -> Vec<String> {
    let rank = entry.set.shape().len();
    let of_group = tree
        .group(group)
        .filter(|group| text(&group.attributes, "signal").is_none_or(|signal| signal == last_of(&entry.path)));
    let names = of_group.map(|group| texts(&group.attributes, "axes")).unwrap_or_default();
    let names = if names.is_empty() { texts(&entry.attributes, "axes") } else { names };
    let names = match &names[..] {
        [] => return names_by_place(rank, coordinates_in(tree, group)),
        [one] if one.contains([':', ',']) => {
            let inside = one.trim_matches(['[', ']']);
            inside.split([':', ',']).map(|name| name.trim().to_owned()).collect()
        }
        _ => names,
    };
    let told = |name: &String| number(&of_group?.attributes, &format!("{name}_indices"));
    if names.iter().all(|name| told(name).is_none()) {
        return names;
    }
    let usual = |place| (names.len() == rank).then_some(place as f64);
    let placed =
        names.iter().enumerate().filter_map(|(place, name)| Some((told(name).or(usual(place))?, name.clone())));
    names_by_place(rank, placed)
}

/// Places and names of coordinates in a group which tell their axis, counted from 1; a primary one of several last.
fn coordinates_in(tree: &Tree, group: &str) -> Vec<(f64, String)> {
    let inside = tree.sets.iter().filter(|set| parent_of(&set.path) == group && set.set.shape().len() == 1);
    let mut found: Vec<(bool, f64, &str)> = inside
        .filter_map(|set| {
            let of = |name: &str| number(&set.attributes, name).or_else(|| text(&set.attributes, name)?.parse().ok());
            Some((of("primary") == Some(1.0), of("axis")? - 1.0, last_of(&set.path)))
        })
        .collect();
    found.sort_by_key(|(is_primary, ..)| *is_primary);
    found.into_iter().map(|(_, place, name)| (place, name.to_owned())).collect()
}

/// Names at their places among `rank` axes; the last one counts.
fn names_by_place(rank: usize, placed: impl IntoIterator<Item = (f64, String)>) -> Vec<String> {
    let mut names = vec![String::new(); rank];
    for (place, name) in placed {
        if let Some(at) = (0..rank).find(|at| *at as f64 == place) {
            names[at] = name;
        }
    }
    names
}
