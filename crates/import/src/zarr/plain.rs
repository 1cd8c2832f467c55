//! An array of no image: its axes by their names and coordinates, its values by CF's attributes, as xarray writes both. Costs the coordinates.

use super::array::Array;
use super::document::Document;
use super::documents::Documents;
use super::node::{Node, ZarrVersion, open_node};
use super::paths::inside;
use super::source::{Layout, Opening, Reading};
use crate::axes::Axis;
use crate::cf::axes::{Dim, MOST_COORDINATES, Scale, order_of};
use crate::cf::place::place;
use crate::cf::values_of;
use crate::element::{Element, Endian};
use crate::error::{ImportError, Result};
use crate::mirrored::Mirrored;
use crate::note::Note;
use crate::options::OpenOptions;
use crate::source::{Source, SourceInfo};
use brickyard_volume::{VoxelType, counted};
use serde_json::{Map, Value};

/// Opens an array.
///
/// # Errors
/// If its axes are not known, it is no volume, or it cannot be read.
pub(super) fn open(
    array: Array,
    mut notes: Vec<Note>,
    options: &OpenOptions,
    reading: Reading<'_>,
) -> Result<Box<dyn Source>> {
    let path = array.path().to_owned();
    let shape = array.shape().to_vec();
    if !(2..=5).contains(&shape.len()) {
        let feature = format!("an array of {} (2 to 5 are read)", counted(shape.len() as u64, "axis"));
        return Err(ImportError::unsupported_but(&path, feature, "name another array with `variable`"));
    }
    let dims = dims_of(&array, &mut notes);
    let axes = order_of(&dims, &shape, options.axes.as_ref());
    let axes = axes.map_err(|problem| ImportError::options(&path, problem))?;
    let letters: Vec<Option<Axis>> = axes.iter().copied().map(Some).collect();
    let layout = Layout::of(&array, letters.clone()).map_err(|problem| ImportError::invalid(&path, problem))?;
    let attributes = with_fill(&array)?;
    let values = values_of(&attributes, array.element(), Endian::Little, options.nodata, |_| None);
    let values = values.direct(options);
    let layout = layout.with_decode(values.decode);
    let mut info = SourceInfo::plain(layout.sizes(), values.decode.voxel_type());
    info.notes = notes;
    let step_time = place(&mut info, &dims, &axes);
    let turned = info.turned;
    values.describe(&mut info);
    let documents = Documents::of(None, &array)?;
    info.identity = documents.identity(&letters)?;
    let source = Opening { array, layout, info, step_time, documents, reading }.open(options)?;
    Ok(Mirrored::turned(Box::new(source), turned))
}

/// The array's attributes, with its fill value as that of no data where xarray takes it so: in Zarr 2, unless it is null.
fn with_fill(array: &Array) -> Result<Map<String, Value>> {
    let mut attributes = array.attributes().clone();
    if array.version() == ZarrVersion::V2 && attributes.contains_key("_ARRAY_DIMENSIONS") {
        let document = Document::read(array.path().join(".zarray"))?;
        let is_told =
            document.is_some_and(|document| document.fields.get("fill_value").is_some_and(|fill| !fill.is_null()));
        let fill =
            array.element().numbers(Endian::Little, array.fill()).first().copied().filter(|fill| fill.is_finite());
        if let Some(fill) = fill.filter(|_| is_told) {
            attributes.entry("_FillValue").or_insert(fill.into());
        }
    }
    Ok(attributes)
}

/// Names of the array's axes, and their coordinates: arrays of these names beside it, of one axis.
fn dims_of(array: &Array, notes: &mut Vec<Note>) -> Vec<Dim> {
    let mut names = array.dimension_names();
    names.resize(array.shape().len(), None);
    let mut dims = Vec::new();
    for (name, size) in names.into_iter().zip(array.shape()) {
        let name = name.filter(|name| !name.is_empty());
        let scale = name.as_deref().and_then(|name| coordinates(array, name, *size, notes));
        dims.push(Dim { name, scale });
    }
    dims
}

fn coordinates(array: &Array, name: &str, size: u64, notes: &mut Vec<Note>) -> Option<Scale> {
    let path = inside(name).ok().filter(|path| path.iter().count() == 1)?;
    let folder = array.path().parent()?.join(path);
    if folder == array.path() {
        return None;
    }
    let found = match open_node(&folder) {
        Ok(Some(Node::Array(found))) => found,
        Ok(_) => return None,
        Err(problem) => {
            notes.push(Note::warning(format!("The coordinates {name} are left out: {problem}.")));
            return None;
        }
    };
    if found.shape() != [size] || size > MOST_COORDINATES {
        return None;
    }
    let mut bytes = vec![0; size as usize * found.element().bytes()];
    if let Err(problem) = found.read(&[0], &[size], &mut bytes) {
        notes.push(Note::warning(format!("The coordinates {name} are left out: {problem}.")));
        return None;
    }
    let numbers = found.element().numbers(Endian::Little, &bytes);
    let is_single = found.element() == Element::Voxel(VoxelType::F32);
    Some(Scale::of(name, found.attributes(), Some(numbers), is_single))
}
