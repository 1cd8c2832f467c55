//! One voxel type for arrays of several: the smallest that holds all their values, or the one of [`OpenOptions::to_voxel_type`]; and one mark for
//! no data, which for unlike values is NaN. Each array is converted by itself, before they are joined.

use super::{NamedArray, shown};
use crate::converted::{Converted, is_to_be_converted};
use crate::element;
use crate::error::{ImportError, Result};
use crate::options::OpenOptions;
use crate::part::Part;
use crate::source::SourceInfo;
use brickyard_volume::VoxelType;
use std::path::PathBuf;

/// Whether the arrays have several voxel types.
pub(super) fn are_unlike(parts: &[NamedArray]) -> bool {
    parts.windows(2).any(|pair| type_of(&pair[0]) != type_of(&pair[1]))
}

/// Whether the arrays mark voxels without data alike.
pub(super) fn are_marked_alike(parts: &[NamedArray]) -> bool {
    parts.windows(2).all(|pair| mark_of(&pair[0]) == mark_of(&pair[1]))
}

/// Checks that arrays can be marked alike in a type: by NaN, or by a value that they share. Another integer might be data.
fn check_marks(parts: &[NamedArray], to: VoxelType) -> Result<()> {
    let unlike = parts.windows(2).find(|pair| mark_of(&pair[0]).0 != mark_of(&pair[1]).0);
    let Some([first, part]) = unlike.filter(|_| !to.is_float()) else { return Ok(()) };
    let value = |part: &NamedArray| match mark_of(part) {
        (Some(value), _) => value.to_string(),
        (None, true) => "marked voxel by voxel".into(),
        (None, false) => "none".into(),
    };
    let problem = format!(
        "the value for no data of {} is {}, but that of {} is {}: give one for all with `nodata`, or none, or make it NaN with \
         `to_voxel_type` f32",
        part.name,
        value(part),
        shown(first),
        value(first)
    );
    Err(ImportError::options(&part.path, problem))
}

/// Converts arrays to one type. `joined` describes them as channels of one volume.
///
/// # Errors
/// If no type holds all their values, or values would be lost that may not be.
pub(super) fn in_one_type(
    parts: Vec<NamedArray>,
    joined: &SourceInfo,
    options: &OpenOptions,
) -> Result<Vec<NamedArray>> {
    // One component of all is taken before its type is converted.
    let is_whole = options.component.is_none();
    let to = match options.to_voxel_type.filter(|_| is_whole) {
        Some(to) => to,
        None => common_type(&parts)?,
    };
    check_marks(&parts, to)?;
    let take_channel = if is_whole { options.take_channel.clone() } else { Vec::new() };
    let taken = OpenOptions { take_channel, ..options.clone() };
    let mut first = 0;
    let convert = |part: NamedArray| {
        let NamedArray { name, path, source } = part;
        let channels = source.info().channels;
        let own_part = of_channels(Part::of(joined, &taken, &path)?, first, channels);
        first += channels;
        if !is_to_be_converted(source.info(), to) {
            return Ok(NamedArray { name, path, source });
        }
        let place = PathBuf::from(format!("{} ({name})", path.display()));
        let source = Box::new(Converted::new(source, to, &own_part, options, &place)?);
        Ok(NamedArray { name, path, source })
    };
    parts.into_iter().map(convert).collect()
}

fn type_of(part: &NamedArray) -> VoxelType {
    part.source.info().voxel_type
}

fn mark_of(part: &NamedArray) -> (Option<f64>, bool) {
    (part.source.info().nodata, part.source.info().knows_nodata)
}

/// The type that holds all values.
fn common_type(parts: &[NamedArray]) -> Result<VoxelType> {
    let of = |parts: &[NamedArray]| element::common_type(parts.iter().map(type_of));
    of(parts).ok_or_else(|| {
        let odd = (1..parts.len()).find(|odd| of(&parts[..=*odd]).is_none()).unwrap_or(0);
        let before: Vec<String> =
            parts[..odd].iter().map(|part| format!("{} of {}", type_of(part), shown(part))).collect();
        let part = &parts[odd];
        let problem = format!(
            "the voxel type of {} is {}, and none holds its values and the {}: name one with `to_voxel_type`",
            part.name,
            type_of(part),
            before.join(", ")
        );
        ImportError::options(&part.path, problem)
    })
}

/// The part that lies in the channels of one array, numbered from its first.
fn of_channels(part: Part, first: u32, channels: u32) -> Part {
    let own = |channel: &u32| channel.checked_sub(first).filter(|own| *own < channels);
    Part { channels: part.channels.iter().filter_map(own).collect(), ..part }
}
