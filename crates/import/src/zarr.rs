//! Zarr 2 and 3 in folders, and OME-Zarr 0.1 to 0.6 in them: the finest level of an image, one that the caller names, or an array.
//!
//! Documents of the image give axes, places and looks (`multiscales`, `place`, `omero`); `choice` finds the image among fields of a plate, series,
//! labels and arrays. A node's document tells a layout; a box is read chunk by chunk, each decoded alone by its codecs and kept for its neighbours
//! (`array`), and inner chunks of shards are read by ranges. Costs the documents on the way, an index of 16 bytes for each inner chunk of a shard at
//! hand, and a look at each chunk never written.

mod affine;
mod array;
mod attributes;
mod choice;
mod chunk_file;
mod codecs;
mod collection;
mod delta;
mod document;
mod documents;
mod field;
mod fill;
mod gathered;
mod image;
mod image_axes;
mod image_label;
mod kept_chunks;
mod keys;
mod layout;
mod multiscales;
mod node;
mod omero;
mod own;
mod paths;
mod place;
mod plain;
mod presentation;
mod shard;
mod source;
#[cfg(test)]
mod tests;
mod transforms;
mod v2;
mod v3;

use crate::error::Result;
use crate::options::OpenOptions;
use crate::source::Source;
use crate::variable::split_choice;
pub use choice::{Choice, choices};
use choice::{Target, choose};
use document::Document;
pub use image::open_image;
use source::Reading;
use std::path::{Path, PathBuf};

/// The folder of a path `FOLDER::PATH` with a document of Zarr; `None` if there is no such document.
pub fn zarr_folder(path: &Path) -> Option<PathBuf> {
    Some(split_choice(path).0).filter(|folder| is_zarr(folder))
}

/// Documents that a folder may have.
const DOCUMENTS: [&str; 4] = ["zarr.json", ".zgroup", ".zarray", ".zattrs"];

/// Documents that an opening of a folder may look at first; at an address all at once. The finest level mostly is "0".
pub fn first_documents() -> Vec<String> {
    let of_labels = DOCUMENTS.map(|name| format!("{}/{name}", image_label::FOLDER));
    let further = ["0/zarr.json", ".zmetadata"].map(String::from);
    DOCUMENTS.map(String::from).into_iter().chain(of_labels).chain(further).collect()
}

/// Whether a folder has a document of Zarr.
pub(crate) fn is_zarr(folder: &Path) -> bool {
    Document::look_ahead(folder, &first_documents());
    ["zarr.json", ".zgroup", ".zarray"].iter().any(|name| Document::is_there(&folder.join(name)))
}

/// Opens the finest level of an image, or an array: the one that the options name, or the only one.
pub(crate) fn open(path: &Path, options: &OpenOptions) -> Result<Box<dyn Source>> {
    let (target, notes) = choose(path, options.variable.as_deref())?;
    match target {
        Target::Image(image) => Ok(Box::new(image::open_level(&image, notes, options)?)),
        Target::Array(array) => plain::open(*array, notes, options, Reading::Whole),
    }
}
