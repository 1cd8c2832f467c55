//! Readers of foreign formats, and generators, behind one streaming [`Source`] trait. Independent of stores.
//!
//! [`open`] picks a reader by name, first bytes and flags. Uncompressed arrays (raw, `.npy`, NIfTI, MRC, ImageJ's large
//! stacks) are read by [`RawSource`], which maps the file; compressed arrays are decoded once into scratch space;
//! TIFF, pictures and DICOM decode requested planes. [`SynthSource`] generates volumes. [`Strided`] is every n-th voxel of
//! another source, [`Described`] a source under another description; several arrays join as channels (`channels`), grids of unlike
//! fineness as one (`grids`), and one component is taken of several (`component`); `cropped`, `picked`, `mirrored` and `converted` make the part, order and
//! type of [`OpenOptions`]. `read_mesh` reads triangle meshes shown with a
//! volume.

#![cfg_attr(
    not(all(
        feature = "dicom",
        feature = "hdf5",
        feature = "npz",
        feature = "pictures",
        feature = "tiff",
        feature = "vtk",
        feature = "zarr"
    )),
    allow(dead_code, reason = "some of what readers share is shared by these")
)]

#[cfg(not(all(
    feature = "dicom",
    feature = "hdf5",
    feature = "npz",
    feature = "pictures",
    feature = "tiff",
    feature = "vtk",
    feature = "zarr"
)))]
mod absent;
#[cfg(test)]
mod adapter_tests;
mod array_choice;
mod axes;
mod batches;
pub mod blosc;
#[cfg(any(feature = "hdf5", feature = "zarr"))]
mod blosclz;
mod body;
mod bov;
mod boxes;
mod cf;
mod channels;
mod choice;
#[cfg(any(feature = "hdf5", feature = "zarr"))]
mod chunk_grid;
mod component;
mod conversion;
mod converted;
mod cropped;
mod data_files;
mod described;
#[cfg(feature = "dicom")]
mod dicom;
mod dicom_files;
mod direct;
mod doubles;
mod element;
mod envi;
mod error;
mod file_name;
mod file_order;
mod files;
mod folder;
mod foreign;
mod format;
mod format_of;
mod grids;
mod gzip;
#[cfg(feature = "hdf5")]
mod hdf5;
mod header_lines;
mod image;
#[cfg(any(feature = "hdf5", feature = "zarr"))]
mod inflate;
mod labels;
mod lengths;
mod looks;
mod losses;
mod mapped;
#[cfg(feature = "mesh")]
mod mesh;
mod meta_image;
mod mirrored;
mod mrc;
mod netcdf;
mod nifti;
mod note;
mod npy;
#[cfg(feature = "npz")]
mod npz;
mod nrrd;
mod numbering;
mod open;
mod options;
mod page_map;
mod part;
mod pattern;
mod picked;
#[cfg(feature = "pictures")]
mod pictures;
mod pipe;
mod placement;
mod raw;
mod raw_text;
mod series;
mod sidecar;
mod source;
mod spacing;
mod stamp;
mod step_time;
#[cfg(test)]
mod steps_tests;
mod strided;
#[cfg(feature = "zarr")]
mod strided_copy;
mod synth;
mod taken;
pub mod temporary;
#[cfg(test)]
mod testing;
#[cfg(feature = "tiff")]
mod tiff_stack;
mod time;
#[cfg(unix)]
pub mod unfinished;
mod variable;
#[cfg(feature = "vtk")]
mod vtk;
mod write_raw;
#[cfg(feature = "zarr")]
pub mod zarr;

#[cfg(not(feature = "dicom"))]
use absent::dicom;
#[cfg(not(feature = "hdf5"))]
use absent::hdf5;
#[cfg(not(feature = "npz"))]
use absent::npz;
#[cfg(not(feature = "pictures"))]
use absent::pictures;
#[cfg(not(feature = "tiff"))]
use absent::tiff_stack;
#[cfg(not(feature = "vtk"))]
use absent::vtk;
#[cfg(not(feature = "zarr"))]
pub use absent::zarr;
pub use axes::AxisOrder;
pub use choice::{ChannelChoice, StepChoice};
pub use described::Described;
pub use element::{Element, Endian};
pub use error::{ImportError, is_of_process, limit_behind};
pub use format::has_known_name;
pub use image::{Image, ImageLevel, Presentation};
pub use labels::SaidKind;
#[cfg(feature = "mesh")]
pub use mesh::read_mesh;
pub use mirrored::axes_in_words;
pub use note::Note;
pub use open::{check_folder, open, order_steps, redescribe};
pub use options::{ArrayPlace, ChannelArray, FileOrder, Gaps, HeldAs, NoData, OpenOptions};
pub use pipe::stream_among;
pub use raw::{RawLayout, RawSource};
pub use source::{Access, Lent, Source, SourceInfo};
pub use step_time::{StepTime, TimeSpan};
pub use strided::Strided;
pub use synth::{CONSTANT_UNITS, SPARSE_LAST_UNITS, SynthKind, SynthSource, uniform};
pub use taken::take;
pub use write_raw::write_raw;
