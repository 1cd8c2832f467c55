//! The readable formats, and their files' names.

use std::path::Path;

/// A format of voxels, in the order of messages about several.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Format {
    Tiff,
    Dicom,
    Npy,
    Nifti,
    Nrrd,
    MetaImage,
    Raw,
}

impl Format {
    /// The format of a file's name; `None` if unknown, or if the file is the second of a pair.
    pub(crate) fn of_name(path: &Path) -> Option<Self> {
        let name = path.file_name()?.to_string_lossy().to_ascii_lowercase();
        let ends = |extensions: &[&str]| extensions.iter().any(|end| name.ends_with(end));
        let extension = path.extension().unwrap_or_default().to_ascii_lowercase();
        match () {
            () if ["tif", "tiff", "btf", "tf8"].iter().any(|e| extension == *e) => Some(Self::Tiff),
            () if ends(&[".npy"]) => Some(Self::Npy),
            () if ends(&[".nii", ".nii.gz", ".hdr", ".hdr.gz"]) => Some(Self::Nifti),
            () if ends(&[".nrrd", ".nhdr"]) => Some(Self::Nrrd),
            () if ends(&[".mha", ".mhd"]) => Some(Self::MetaImage),
            () if ends(&[".raw", ".bin", ".dat"]) => Some(Self::Raw),
            () => None,
        }
    }

    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Tiff => "TIFF",
            Self::Dicom => "DICOM",
            Self::Npy => ".npy",
            Self::Nifti => "NIfTI",
            Self::Nrrd => "NRRD",
            Self::MetaImage => "MetaImage",
            Self::Raw => "raw",
        }
    }
}
