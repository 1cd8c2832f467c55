//! Writers of volumes as files of other formats: the inverse of `brickyard-import`.
//!
//! [`export`] takes a part of a store as a [`Source`](brickyard_import::Source) (`store_source.rs`). A format's file (`nifti.rs`, `tiff.rs`
//! and so on) turns its description into a `plan`: a header, the places of voxels, and the facts that the file can keep; the others are told in
//! notes. One engine then writes the voxels: anywhere in the file, by all threads (`flat`), or plane by plane where they are compressed (`planes`);
//! a pack writes those of OME-Zarr (`zarr`).
//! Memory is counted before (`budget`), and the file has a temporary name in the same folder until complete (`output`).

mod budget;
mod error;
mod export;
mod facts;
mod flat;
mod folder;
mod format;
mod frame;
mod gzip;
mod imagej;
mod job;
mod metaimage;
mod ngff;
mod nifti;
mod npy;
mod nrrd;
mod ome;
mod output;
mod plan;
mod planes;
mod png;
mod pvd;
mod raw;
mod request;
mod segments;
mod store_source;
#[cfg(test)]
mod testing;
mod tiff;
mod volume;
mod vti;
mod xml;
mod zarr;

pub use error::ExportError;
pub use export::{Exported, export};
pub use format::Format;
pub use ngff::Ngff;
pub use output::paths_of;
pub use request::{ExportChannels, ExportRequest, ExportTime};
