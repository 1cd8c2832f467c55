//! Arrangement of a TIFF stack's pages: by the caller's axes, else as its description declares.

use super::description::Declared;
use super::page::PageFormat;
use crate::axes::{Axis, Sizes};
use crate::error::{ImportError, Result};
use crate::note::Note;
use crate::options::OpenOptions;
use crate::page_map::{PageMap, as_told};
use std::path::Path;

/// Maps `files` files of equally many pages, with a note, if any: by the caller's axes, else as declared, else all along z.
/// `path` is the first file, for messages.
///
/// # Errors
/// If the number of pages differs from the axes or the description; the message names which.
pub(super) fn arrange(
    path: &Path,
    pages: u32,
    files: u32,
    options: &OpenOptions,
    declared: Option<&Declared>,
    format: &PageFormat,
) -> Result<(PageMap, Option<Note>)> {
    let all = pages.saturating_mul(files);
    let map = |axes: &[Axis], sizes: Sizes| PageMap::along(axes, of_page(sizes, format), pages);
    if let Some(axes) = &options.axes {
        let (page_axes, sizes) = as_told(axes, all, options).map_err(|problem| ImportError::options(path, problem))?;
        return Ok((map(&page_axes, sizes), None));
    }
    let along_z = || map(&[Axis::Z], Sizes::from_ordered(&[Axis::Z], &[all]));
    let Some(declared) = declared else { return Ok((along_z(), None)) };
    if declared.of_each_page && declared.planes() == 1 && all > 1 {
        let note = format!(
            "The {all} pages are arrays of their own, as the description of the first says: they are taken along z."
        );
        return Ok((along_z(), Some(Note::new(note))));
    }
    let sizes = declared.page_sizes(format).map_err(|problem| ImportError::invalid(path, problem))?;
    if sizes.planes() != all as u64 {
        return Err(ImportError::invalid(path, too_few_or_many(sizes, all as u64, "it holds")));
    }
    Ok((map(&declared.page_axes, sizes), None))
}

/// Message for a description of more or fewer planes than pages. `holders` hold the pages.
pub(super) fn too_few_or_many(sizes: Sizes, pages: u64, holders: &str) -> String {
    let (planes, Sizes { extent, channels, times }) = (sizes.planes(), sizes);
    let z = extent.z;
    format!(
        "its description declares {planes} planes ({z} along z, {channels} channels, {times} time steps), but {holders} \
         {pages} pages; pass `axes` zyx to take the pages as they are"
    )
}

/// Sizes in pages, with those of a page along x and y.
pub(super) fn of_page(mut sizes: Sizes, format: &PageFormat) -> Sizes {
    [sizes.extent.x, sizes.extent.y] = format.shown_size();
    sizes
}
