//! The written formats, chosen by the output's name.

use crate::error::ExportError;
use crate::metaimage::data_beside;
use crate::plan::Plan;
use crate::volume::Volume;
use crate::{imagej, metaimage, nifti, npy, nrrd, ome, png, pvd, raw, vti, zarr};
use std::path::Path;

/// A written format.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// Voxels alone, and a text beside them.
    Raw,
    /// NumPy's array.
    Npy,
    /// NIfTI in one file.
    Nifti,
    /// NIfTI through gzip.
    NiftiGz,
    /// NRRD with its voxels behind the header.
    Nrrd,
    /// NRRD of labels, with the keys of 3D Slicer's segments.
    SegNrrd,
    /// MetaImage with its voxels behind the header.
    MetaImage,
    /// MetaImage with its voxels in a file of their own.
    MetaHeader,
    /// VTK's image.
    Vti,
    /// A series of VTK's images, in ParaView's collection.
    Pvd,
    /// TIFF as ImageJ writes it.
    Tiff,
    /// TIFF with OME-XML.
    OmeTiff,
    /// A folder of PNG pictures.
    Png,
    /// OME-Zarr, a folder of arrays.
    Zarr,
}

impl Format {
    /// Ends of names, longer ones first, with the format of each.
    const ENDS: [(&str, Self); 17] = [
        (".ome.tiff", Self::OmeTiff),
        (".ome.tif", Self::OmeTiff),
        (".nii.gz", Self::NiftiGz),
        (".nii", Self::Nifti),
        (".seg.nrrd", Self::SegNrrd),
        (".nrrd", Self::Nrrd),
        (".mha", Self::MetaImage),
        (".mhd", Self::MetaHeader),
        (".vti", Self::Vti),
        (".pvd", Self::Pvd),
        (".tiff", Self::Tiff),
        (".tif", Self::Tiff),
        (".npy", Self::Npy),
        (".raw", Self::Raw),
        (".zarr", Self::Zarr),
        (".zarr/", Self::Zarr),
        ("/", Self::Png),
    ];

    /// The format of a name; `None` if it has no known end.
    pub fn of(output: &Path) -> Option<Self> {
        let name = output.to_string_lossy().to_ascii_lowercase();
        let found = Self::ENDS.iter().find(|(end, _)| name.ends_with(end))?;
        // A bare end is a name without one.
        let name = output.file_name()?.to_string_lossy().len();
        (name > found.0.trim_end_matches('/').len()).then_some(found.1)
    }

    /// Whether the output is a folder.
    pub fn is_folder(self) -> bool {
        matches!(self, Self::Png | Self::Zarr)
    }

    /// Plans a file.
    ///
    /// # Errors
    /// If the format cannot hold the volume.
    pub(crate) fn plan(self, volume: &Volume) -> Result<Plan, ExportError> {
        match self {
            Self::Raw => raw::plan(volume),
            Self::Npy => Ok(npy::plan(volume)),
            Self::Nifti => Ok(nifti::plan(volume, false)),
            Self::NiftiGz => Ok(nifti::plan(volume, true)),
            Self::Nrrd => Ok(nrrd::plan(volume)),
            Self::SegNrrd => Ok(nrrd::plan_segments(volume)),
            Self::MetaImage => metaimage::plan(volume, None),
            Self::MetaHeader => metaimage::plan(volume, Some(&data_beside(volume.output))),
            Self::Vti => vti::plan(volume),
            Self::Pvd => pvd::plan(volume),
            Self::Tiff => imagej::plan(volume),
            Self::OmeTiff => ome::plan(volume),
            Self::Png => png::plan(volume),
            Self::Zarr => Ok(zarr::plan(volume, volume.ngff)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_have_formats_and_bare_ends_have_none() {
        for (name, format) in [
            ("a.nii.gz", Some(Format::NiftiGz)),
            ("a/b.OME.TIF", Some(Format::OmeTiff)),
            ("a.ome.tiff", Some(Format::OmeTiff)),
            ("some.tiff", Some(Format::Tiff)),
            ("a.Seg.nrrd", Some(Format::SegNrrd)),
            ("seg.nrrd", Some(Format::Nrrd)),
            ("a.pvd", Some(Format::Pvd)),
            (".seg.nrrd", None),
            ("a.b.Raw", Some(Format::Raw)),
            ("planes/", Some(Format::Png)),
            ("a.raw/", Some(Format::Png)),
            ("a.ome.zarr", Some(Format::Zarr)),
            ("a.zarr/", Some(Format::Zarr)),
            (".zarr", None),
            (".zarr/", None),
            ("a.gz", None),
            ("a.png", None),
            ("a", None),
            (".npy", None),
            ("raw", None),
            ("", None),
            ("/", None),
        ] {
            assert_eq!(Format::of(Path::new(name)), format, "{name}");
        }
    }
}
