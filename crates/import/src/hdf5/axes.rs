//! Axes of a dataset: their names and coordinates, as NetCDF, NeXus, h5py and ilastik say them.

use super::attributes::{named, text, texts};
use super::tree::{Entry, Tree, join, parent_of};
use crate::array_choice::last_of;
use crate::cf::axes::{Dim, MOST_COORDINATES, Scale};
use crate::element::Element;
use brickyard_volume::VoxelType;
use hdf5_reader::{Attribute, Datatype, ReferenceType};

/// Everything known of a dataset's axes, slowest first.
pub(super) fn dims_of(tree: &Tree, entry: &Entry) -> Vec<Dim> {
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
    let dims = names.into_iter().zip(scales).zip(shape).map(|((name, scale), size)| {
        // Coordinates of a name have that name, and as many elements.
        let fits = |scale: &&Entry| *scale.set.shape() == [*size];
        let of_name = || tree.set(&join(group, name.as_deref()?));
        let scale = scale.or_else(of_name).filter(fits).map(scale_of);
        Dim { name, scale }
    });
    dims.collect()
}

/// A scale with its numbers, unless it stands for a NetCDF dimension without a variable.
fn scale_of(entry: &Entry) -> Scale {
    let is_blank = text(&entry.attributes, "NAME")
        .is_some_and(|name| name.starts_with("This is a netCDF dimension but not a netCDF variable"));
    let is_long = entry.set.shape().iter().product::<u64>() > MOST_COORDINATES;
    let stored = entry.stored.as_ref().ok().filter(|stored| stored.members.is_empty() && !is_blank && !is_long);
    let numbers = stored.and_then(|stored| Some(stored.numbers(&entry.set.read_raw_bytes().ok()?)));
    let is_single = stored.is_some_and(|stored| stored.element == Element::Voxel(VoxelType::F32));
    Scale::of(&entry.path, &entry.attributes[..], numbers, is_single)
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
