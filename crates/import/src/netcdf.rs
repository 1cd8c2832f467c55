//! Classic NetCDF (CDF-1, CDF-2 and CDF-5), MINC 1 among it: one variable, by its name, or the only volume. Values and places have the
//! meaning of CF's conventions, as in NetCDF-4.
//!
//! The header is parsed here; voxels are read in place through [`RawSource`]. Costs the header and the coordinates.

mod header;
mod minc;
#[cfg(test)]
mod tests;

use crate::array_choice::{Listed, is_shape_of_volume, no_such, none, several};
use crate::axes::{Axis, AxisOrder, Sizes};
use crate::cf::axes::{Dim, MOST_COORDINATES, Scale, order_of};
use crate::cf::place::place;
use crate::cf::{Attributes, default_fill, helpers_of, values_of};
use crate::element::{Decode, Element, Endian};
use crate::error::{ImportError, Result};
use crate::mapped::MappedFile;
use crate::mirrored::Mirrored;
use crate::note::Note;
use crate::options::OpenOptions;
use crate::raw::{ArrayLayout, RawSource, identity};
use crate::source::{Source, SourceInfo};
use brickyard_volume::{VoxelType, counted};
use header::{Header, Kind, Variable};
use std::path::Path;

/// Whether a file with this start is of one of the classic formats.
pub(crate) fn is_netcdf(start: &[u8]) -> bool {
    matches!(start, [b'C', b'D', b'F', 1 | 2 | 5, ..])
}

/// Opens a variable: the one that the options name, or the only volume.
pub(crate) fn open(path: &Path, options: &OpenOptions) -> Result<Box<dyn Source>> {
    let file = MappedFile::open(path)?;
    let opened = open_in(path, &file, options);
    // Bytes lost by the file read as zeros, which may look damaged.
    file.confirm()?;
    opened
}

fn open_in(path: &Path, file: &MappedFile, options: &OpenOptions) -> Result<Box<dyn Source>> {
    if !is_netcdf(file) {
        return Err(ImportError::invalid(
            path,
            "not a classic NetCDF file: it does not start with CDF; fetch it again",
        ));
    }
    let header = Header::parse(file).map_err(|problem| ImportError::invalid(path, problem))?;
    let (variable, mut notes) = chosen(path, &header, options)?;
    let name = &variable.name;
    let Kind::Number(element) = variable.kind else {
        let feature = format!("{} of {name}", variable.kind.name());
        return Err(ImportError::unsupported_but(path, feature, "name another variable with `variable`"));
    };
    if header.is_streamed && variable.is_record {
        let records = variable.shape[0];
        notes.push(Note::warning(format!("The number of records was never written: the file has room for {records}.")));
    }
    let minc = minc::image_of(&header, variable);
    let dims: Vec<Dim> = match &minc {
        Some(_) => header.dims_of(variable).map(|name| Dim { name: minc::letter_of(name), scale: None }).collect(),
        None => header.dims_of(variable).zip(&variable.shape).map(|(name, size)| dim(&header, name, *size)).collect(),
    };
    let (axes, sizes) = arrange(path, variable, &dims, options)?;
    let (begin, end) = (variable.begin, header.end_of(variable));
    if begin < header.bytes || end.is_none_or(|end| end > file.len() as u64) {
        let end = end.map_or("more than 2^64".into(), |end| end.to_string());
        let (found, least) = (file.len(), header.bytes);
        let problem = format!(
            "cut short or damaged: {name} lies at bytes {begin} to {end}, expected places from {least} to {found}; fetch the file again"
        );
        return Err(ImportError::invalid(path, problem));
    }
    let attributes = header.attributes_of(variable);
    let stored = if minc.is_some() { minc::element_of(&attributes, element) } else { element };
    let default_fill = |element| default_fill(element).filter(|_| minc.is_none());
    let values = values_of(&attributes, stored, Endian::Big, options.nodata, default_fill);
    let values = if minc.is_some() { values } else { values.direct(options) };
    let opening = Opening { header: &header, variable, axes, sizes, decode: values.decode, options };
    if let Some(image) = minc {
        return minc::open(path, image, opening, notes);
    }
    let mut info = opening.info(path)?;
    info.notes = notes;
    let step_time = place(&mut info, &dims, &opening.axes);
    values.describe(&mut info);
    let turned = info.turned;
    Ok(Mirrored::turned(Box::new(opening.source(path, info)?.at(step_time)), turned))
}

/// A variable about to be opened.
struct Opening<'a> {
    header: &'a Header<'a>,
    variable: &'a Variable,
    axes: Vec<Axis>,
    sizes: Sizes,
    decode: Decode,
    options: &'a OpenOptions,
}

impl Opening<'_> {
    /// A description without places.
    fn info(&self, path: &Path) -> Result<SourceInfo> {
        let mut info = SourceInfo::plain(self.sizes, self.decode.voxel_type());
        let order = AxisOrder::of(&self.axes);
        info.identity = identity(&format!("netcdf {} {order}", self.variable.name), &[path])?;
        Ok(info)
    }

    /// Opens its voxels.
    fn source(self, path: &Path, info: SourceInfo) -> Result<RawSource> {
        let Self { header, variable, axes, sizes, decode, options, .. } = self;
        let array = ArrayLayout { sizes, axes: AxisOrder::of(&axes), decode, offset: variable.begin };
        let (file, nodata) = (MappedFile::open(path)?, info.nodata);
        let source = match variable.is_record {
            true => RawSource::of_records(file, array, info, header.record_bytes)?,
            false => RawSource::new(file, array, info)?,
        };
        source.with_losses(nodata, options)
    }
}

fn listed(variable: &Variable) -> Listed {
    Listed { path: variable.name.clone(), shape: variable.shape.clone(), element: variable.kind.name().into() }
}

/// The variable named by the options, or the only volume, and how it was chosen.
fn chosen<'a>(path: &Path, header: &'a Header<'_>, options: &OpenOptions) -> Result<(&'a Variable, Vec<Note>)> {
    let all = || header.variables.iter().map(listed).collect::<Vec<_>>();
    if let Some(name) = &options.variable {
        let found = header.variable(name).or_else(|| header.variable(name.trim_matches('/')));
        return found.map(|found| (found, Vec::new())).ok_or_else(|| no_such(path, name, all(), ""));
    }
    let helpers: Vec<String> =
        header.variables.iter().flat_map(|variable| helpers_of(&header.attributes_of(variable))).collect();
    let is_volume = |variable: &&Variable| {
        is_shape_of_volume(&variable.shape) && variable.kind != Kind::Text && !helpers.contains(&variable.name)
    };
    let volumes: Vec<&Variable> = header.variables.iter().filter(is_volume).collect();
    match &volumes[..] {
        [only] => {
            let note = format!("The variable {} is read, the only volume in the file.", only.name);
            Ok((only, vec![Note::new(note)]))
        }
        [] => Err(none(path, &all(), "")),
        volumes => Err(several(path, &volumes.iter().map(|volume| listed(volume)).collect::<Vec<_>>(), "")),
    }
}

/// An axis with its coordinates: the numbers along it of a variable with its name.
fn dim(header: &Header<'_>, name: &str, size: u64) -> Dim {
    let coordinates = header.variable(name).filter(|found| found.shape == [size]);
    let scale = coordinates.map(|found| {
        let is_single = found.kind == Kind::Number(Element::Voxel(VoxelType::F32));
        Scale::of(name, &header.attributes_of(found), header.numbers_of(found, MOST_COORDINATES), is_single)
    });
    Dim { name: Some(name.to_owned()), scale }
}

/// Gives each axis of a variable its letter, and the volume its sizes.
fn arrange(path: &Path, variable: &Variable, dims: &[Dim], options: &OpenOptions) -> Result<(Vec<Axis>, Sizes)> {
    let (shape, name) = (&variable.shape, &variable.name);
    if !(2..=5).contains(&shape.len()) {
        let feature = format!("{name}, of {} (2 to 5 are read),", counted(shape.len() as u64, "axis"));
        return Err(ImportError::unsupported_but(path, feature, "name another variable with `variable`"));
    }
    let order = order_of(dims, shape, options.axes.as_ref());
    let order = order.map_err(|problem| ImportError::options(path, format!("{name}: {problem}")))?;
    let too_long = || ImportError::unsupported(path, format!("{name} of {shape:?} elements"));
    let lengths: Option<Vec<u32>> = shape.iter().map(|size| u32::try_from(*size).ok()).collect();
    let sizes = Sizes::from_ordered(&order, &lengths.ok_or_else(too_long)?);
    let checked = sizes.checked_bytes(8);
    checked.map_err(|problem| ImportError::invalid(path, format!("{name}: {problem}")))?;
    Ok((order, sizes))
}

/// Whether a text attribute says so.
fn says(attributes: &impl Attributes, name: &str, value: &str) -> bool {
    attributes.text(name).is_some_and(|said| said == value)
}
