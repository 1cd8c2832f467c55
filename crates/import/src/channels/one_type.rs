//! One voxel type for arrays of several: the smallest that holds all their values, or the one of [`OpenOptions::to_voxel_type`]. Each array is
//! converted by itself, before they are joined.

use super::{NamedArray, shown};
use crate::converted::Converted;
use crate::element::{Element, smallest_type};
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
    let take_channel = if is_whole { options.take_channel.clone() } else { Vec::new() };
    let taken = OpenOptions { take_channel, ..options.clone() };
    let mut first = 0;
    let convert = |part: NamedArray| {
        let NamedArray { name, path, source } = part;
        let channels = source.info().channels;
        let own_part = of_channels(Part::of(joined, &taken, &path)?, first, channels);
        first += channels;
        if source.info().voxel_type == to && !is_to_be_marked(source.info(), to) {
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

/// The smallest type that holds all values: of integers an integer, and f32 beside floats.
fn common_type(parts: &[NamedArray]) -> Result<VoxelType> {
    let (mut least, mut greatest) = (0.0f64, 0.0f64);
    for (i, part) in parts.iter().enumerate() {
        let [low, high] = Element::Voxel(type_of(part)).limits();
        (least, greatest) = (least.min(low), greatest.max(high));
        let has_floats = parts.iter().any(|part| type_of(part).is_float());
        if !has_floats && smallest_type(least, greatest).is_float() {
            let before: Vec<String> =
                parts[..i].iter().map(|part| format!("{} of {}", type_of(part), shown(part))).collect();
            let problem = format!(
                "the voxel type of {} is {}, and none holds its values and the {}: name one with `to_voxel_type`",
                part.name,
                type_of(part),
                before.join(", ")
            );
            return Err(ImportError::options(&part.path, problem));
        }
    }
    Ok(smallest_type(least, greatest))
}

/// Whether an array's voxels without data have a value that converted ones, whose mark is NaN, do not have.
fn is_to_be_marked(info: &SourceInfo, to: VoxelType) -> bool {
    to.is_float() && info.nodata.is_some() && !info.knows_nodata
}

/// The part that lies in the channels of one array, numbered from its first.
fn of_channels(part: Part, first: u32, channels: u32) -> Part {
    let own = |channel: &u32| channel.checked_sub(first).filter(|own| *own < channels);
    Part { channels: part.channels.iter().filter_map(own).collect(), ..part }
}
