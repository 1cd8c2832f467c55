//! The part of an input which the options name, in their order and type: its adapters, one over another. Costs what these do.

use crate::converted::Converted;
use crate::cropped::Cropped;
use crate::described::Described;
use crate::error::ImportError;
use crate::mirrored::Mirrored;
use crate::options::OpenOptions;
use crate::part::Part;
use crate::picked::Picked;
use crate::source::{Source, SourceInfo};
use std::path::Path;

/// Takes the part, order and type of voxels that the options name. `path` is for messages.
///
/// # Errors
/// If the source has no such part, or its times or place cannot be told for it.
pub fn take(mut source: Box<dyn Source>, options: &OpenOptions, path: &Path) -> Result<Box<dyn Source>, ImportError> {
    let OpenOptions { roi, flip, take_channel, take_time, to_voxel_type, .. } = options;
    let part = Part::of(source.info(), options, path)?;
    let region = part.region;
    let refuse = |option: &str, problem: &dyn std::fmt::Display| {
        ImportError::options(path, format!("`{option}`: cannot be used, {problem}"))
    };
    // Converted first: losses are told by their places in the input.
    if let Some(to) = to_voxel_type.filter(|to| *to != source.info().voxel_type) {
        source = Box::new(Converted::new(source, to, &part, options, path)?);
    }
    if !take_channel.is_empty() || take_time.is_some() {
        source = Box::new(Picked::new(source, part).map_err(|error| refuse("take_time", &error))?);
    }
    if roi.is_some() {
        source = Box::new(Cropped::new(source, region).map_err(|error| refuse("roi", &error))?);
    }
    match *flip {
        None => {}
        Some([false, false, false]) => {
            let info = SourceInfo { flip: *flip, ..source.info().clone() };
            source = Box::new(Described { info, source, first: 0 });
        }
        Some(flip) => source = Box::new(Mirrored::new(source, flip).map_err(|error| refuse("flip", &error))?),
    }
    Ok(source)
}
