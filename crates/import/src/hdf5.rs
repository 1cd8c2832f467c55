//! HDF5, and through it NetCDF-4, Imaris and BigDataViewer: one dataset of numbers, by its path in the file, or the only one.
//!
//! A parser finds groups, attributes and chunks; elements in one piece are mapped like a raw file's, chunks are decoded when a box needs them
//! and kept for its neighbours. Costs the chunk index when opened, and each chunk about once where boxes follow one another.

mod attributes;
mod axes;
mod bdv;
mod bytes;
mod cf;
mod chunks;
mod committed;
mod file;
mod filters;
mod imaris;
mod layout;
mod links;
mod source;
mod spim_data;
#[cfg(test)]
mod tests;
mod tree;
mod types;

use crate::axes::{Axis, Sizes};
use crate::cf::axes::{Dim, order_of};
use crate::cf::place::place;
use crate::cf::values_of;
use crate::data_files::check_file;
use crate::error::{ImportError, Result};
use crate::files::first_bytes;
use crate::mirrored::Mirrored;
use crate::note::Note;
use crate::options::OpenOptions;
use crate::raw::identity;
use crate::source::{Source, SourceInfo};
use attributes::named;
use bdv::Views;
use brickyard_volume::{ChannelLook, counted};
use file::File;
pub(crate) use file::is_hdf5;
use layout::{Elements, elements_of};
use source::Opening;
use std::path::Path;
use tree::{Entry, Tree};
use types::Stored;

/// Opens a dataset of an HDF5 file: the one that the options name, that the file means, or its only volume.
pub(crate) fn open(path: &Path, options: &OpenOptions) -> Result<Box<dyn Source>> {
    let file = File::open(path)?;
    let opened = open_in(&file, options);
    // Bytes lost by the file read as zeros, which may look damaged.
    file.map.confirm()?;
    opened
}

/// Whether a file starts like BigDataViewer's XML.
pub(crate) fn is_spim_data(path: &Path) -> Result<bool> {
    const MAGIC: &[u8] = b"<SpimData";
    let start = first_bytes(path, 1024)?;
    Ok(start.windows(MAGIC.len()).any(|part| part == MAGIC))
}

/// Opens the HDF5 file of BigDataViewer's XML.
pub(crate) fn open_spim_data(path: &Path, options: &OpenOptions) -> Result<Box<dyn Source>> {
    let told = spim_data::read(path)?;
    check_file(path, &told.hdf5)?;
    let file = File::open(&told.hdf5)?;
    let views = Views { setups: told.setups.clone(), times: told.times.clone() };
    let opened = bdv::open(&file, views, Some((path, &told)), options);
    file.map.confirm()?;
    opened
}

fn open_in(file: &File, options: &OpenOptions) -> Result<Box<dyn Source>> {
    if let Some(views) = bdv::views_of(file)
        && options.variable.as_ref().is_none_or(|name| bdv::setup_of(&views, name).is_some())
    {
        return bdv::open(file, views, None, options);
    }
    let mut tree = Tree::of(file)?;
    let (entry, mut notes) = match &options.variable {
        Some(name) => {
            tree.adopt(file, name);
            let entry = tree.named(file, name)?;
            (entry, tree.note_on(entry, name).into_iter().collect())
        }
        None if imaris::is_imaris(&tree) => return imaris::open(file, &tree, options),
        None => {
            let (entry, is_only) = tree.chosen(file)?;
            let why = if is_only { "the only volume in the file" } else { "the signal that the file names" };
            (entry, vec![Note::new(format!("The dataset {} is read, {why}.", entry.path))])
        }
    };
    if entry.path.starts_with("/minc-2.0/") {
        let advice = "convert it to NIfTI, as mnc2nii does";
        return Err(ImportError::unsupported_but(
            &file.path,
            "MINC 2, whose values are scaled slice by slice,",
            advice,
        ));
    }
    if named(&entry.attributes, "MATLAB_class").is_some() && options.axes.is_none() {
        notes.push(Note::warning(
            "MATLAB wrote this array: its first index is taken as x; if it counts rows, pass `axes` with x before y, such as zxy.",
        ));
    }
    open_entry(file, &tree, entry, notes, options)
}

/// Opens a dataset as a volume.
fn open_entry(
    file: &File,
    tree: &Tree,
    entry: &Entry,
    mut notes: Vec<Note>,
    options: &OpenOptions,
) -> Result<Box<dyn Source>> {
    let what = &entry.path;
    let refuse = |name: &String| {
        let advice =
            "integers of 8 to 64 bits, floats of 16 to 64 bits, enumerations and compounds of one of these are read";
        ImportError::unsupported_but(&file.path, format!("{name} of {what}"), advice)
    };
    let stored = entry.stored.as_ref().map_err(refuse)?;
    notes.extend(passed_over(file, entry)?);
    let dims = axes::dims_of(file, tree, entry, &mut notes);
    let (axes, sizes) = arrange(file, entry, stored, &dims, options)?;
    let default_fill = |element| cf::default_fill(tree, entry, element);
    let mut element = stored.element;
    if bdv::are_cells(what) {
        element = bdv::without_sign(element);
        notes.push(Note::new("16-bit numbers of BigDataViewer have no sign."));
    }
    let values = values_of(&entry.attributes[..], element, stored.endian, options.nodata, default_fill);
    let values = values.direct(options);
    let mut info = SourceInfo::plain(sizes, values.decode.voxel_type());
    info.identity = identity(&format!("hdf5 {what} {axes:?}"), &[&file.path])?;
    info.notes = notes;
    info.notes.extend(cf::unapplied(tree, entry));
    cf::place(&mut info, tree, entry, &axes);
    let step_time = place(&mut info, &dims, &axes);
    let turned = info.turned;
    let has_members = !stored.members.is_empty();
    if has_members {
        let look = |name: &String| ChannelLook { name: Some(name.clone()), ..ChannelLook::default() };
        info.channel_looks = stored.members.iter().map(look).collect();
    }
    values.describe(&mut info);
    let opening = Opening { file, info, axes, decode: values.decode, has_members };
    let source: Box<dyn Source> = match elements_of(file, &entry.set, stored, what, 0)? {
        Elements::Piece(start) => Box::new(opening.piece(start, what, options)?.at(step_time)),
        Elements::Chunks(chunks) => Box::new(opening.chunks(vec![chunks], options)?.at(step_time)),
    };
    Ok(Mirrored::turned(source, turned))
}

/// A note on attributes that cannot be read, unless values depend on one.
fn passed_over(file: &File, entry: &Entry) -> Result<Option<Note>> {
    const OF_VALUES: [&str; 5] = ["scale_factor", "add_offset", "_FillValue", "missing_value", "_Unsigned"];
    if let Some(name) = entry.unread.iter().find(|name| OF_VALUES.contains(&name.as_str())) {
        let feature = format!("the attribute {name} of {}, of a committed datatype,", entry.path);
        return Err(ImportError::unsupported_but(&file.path, feature, "write it anew as a plain number"));
    }
    let text = format!("Attributes of a committed datatype are passed over: {}.", entry.unread.join(", "));
    Ok((!entry.unread.is_empty()).then(|| Note::warning(text)))
}

/// Gives each axis of a dataset its letter, and the volume its sizes.
fn arrange(
    file: &File,
    entry: &Entry,
    stored: &Stored,
    dims: &[Dim],
    options: &OpenOptions,
) -> Result<(Vec<Axis>, Sizes)> {
    let (shape, what) = (entry.set.shape(), &entry.path);
    if !(2..=5).contains(&shape.len()) {
        let feature = format!("{what}, of {} (2 to 5 are read),", counted(shape.len() as u64, "axis"));
        return Err(ImportError::unsupported_but(&file.path, feature, "name another dataset with `variable`"));
    }
    let order = order_of(dims, shape, options.axes.as_ref());
    let order = order.map_err(|problem| ImportError::options(&file.path, format!("{what}: {problem}")))?;
    let too_long = || ImportError::unsupported(&file.path, format!("{what} of {shape:?} elements"));
    let lengths: Option<Vec<u32>> = shape.iter().map(|size| u32::try_from(*size).ok()).collect();
    let mut sizes = Sizes::from_ordered(&order, &lengths.ok_or_else(too_long)?);
    if !stored.members.is_empty() {
        if order.contains(&Axis::C) {
            let feature = format!("{what}, of several members along an axis of channels,");
            return Err(ImportError::unsupported_but(
                &file.path,
                feature,
                "write its members as datasets of their own",
            ));
        }
        sizes.channels = stored.members.len() as u32;
    }
    sizes
        .checked_bytes(stored.element.bytes())
        .map_err(|problem| ImportError::invalid(&file.path, format!("{what}: {problem}")))?;
    Ok((order, sizes))
}
