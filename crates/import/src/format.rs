//! The readable formats, and their files' names.

use std::path::Path;

/// A format of voxels, in the order of messages about several.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Format {
    Tiff,
    Picture(PictureKind),
    Dicom,
    Npy,
    Npz,
    Nifti,
    Nrrd,
    MetaImage,
    Vtk,
    Pvd,
    Mrc,
    Envi,
    Bov,
    Hdf5,
    /// A raw file with a text beside it.
    RawText,
    /// A list of grids of unlike fineness.
    Grids,
    Bdv,
    NetCdf,
    /// A folder of arrays.
    Zarr,
    Raw,
}

/// A kind of pictures, each a plane.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum PictureKind {
    Png,
    Jpeg,
    Bmp,
}

impl PictureKind {
    /// The kind of a file's first bytes.
    pub(crate) fn of_start(start: &[u8]) -> Option<Self> {
        // Lengths of the header behind BMP's two letters, which are too few to be sure.
        const VERSIONS: [u8; 7] = [12, 40, 52, 56, 64, 108, 124];
        match start {
            [0x89, b'P', b'N', b'G', b'\r', b'\n', 0x1a, b'\n', ..] => Some(Self::Png),
            [0xff, 0xd8, 0xff, ..] => Some(Self::Jpeg),
            [b'B', b'M', rest @ ..] => match rest.get(12..16) {
                Some([version, 0, 0, 0]) if VERSIONS.contains(version) => Some(Self::Bmp),
                _ => None,
            },
            _ => None,
        }
    }
}

/// Whether a file has the name of a readable kind: also of the second of a pair, or of a name which only the contents
/// confirm. DICOM slices may have no extension, or a number.
pub fn has_known_name(path: &Path) -> bool {
    const MORE: [&str; 12] = ["img", "map", "rec", "st", "ali", "nc", "ome", "stk", "lsm", "dcm", "dicom", "ima"];
    let extension = path.extension().map(|extension| extension.to_string_lossy().to_ascii_lowercase());
    let is_known = |extension: &str| MORE.contains(&extension) || extension.bytes().all(|byte| byte.is_ascii_digit());
    let name = path.file_name().unwrap_or_default().to_string_lossy().to_ascii_lowercase();
    Format::of_name(path).is_some()
        || name.ends_with(".img.gz")
        || extension.is_none_or(|extension| is_known(&extension))
}

impl Format {
    /// The format of a file's name; `None` if unknown, or if the file is the second of a pair.
    pub(crate) fn of_name(path: &Path) -> Option<Self> {
        let name = path.file_name()?.to_string_lossy().to_ascii_lowercase();
        let ends = |extensions: &[&str]| extensions.iter().any(|end| name.ends_with(end));
        let extension = path.extension().unwrap_or_default().to_ascii_lowercase();
        match () {
            () if ["tif", "tiff", "btf", "tf8"].iter().any(|e| extension == *e) => Some(Self::Tiff),
            () if ends(&[".png"]) => Some(Self::Picture(PictureKind::Png)),
            () if ends(&[".jpg", ".jpeg", ".jpe", ".jfif"]) => Some(Self::Picture(PictureKind::Jpeg)),
            () if ends(&[".bmp", ".dib"]) => Some(Self::Picture(PictureKind::Bmp)),
            () if ends(&[".npy"]) => Some(Self::Npy),
            () if ends(&[".npz"]) => Some(Self::Npz),
            () if ends(&[".mrc", ".mrcs", ".ccp4", ".mrc.gz", ".mrcs.gz", ".ccp4.gz", ".map.gz"]) => Some(Self::Mrc),
            () if ends(&[".bov"]) => Some(Self::Bov),
            () if ends(&[".nii", ".nii.gz", ".hdr", ".hdr.gz"]) => Some(Self::Nifti),
            () if ends(&[".nrrd", ".nhdr"]) => Some(Self::Nrrd),
            () if ends(&[".mha", ".mhd"]) => Some(Self::MetaImage),
            () if ends(&[".vti", ".vtk"]) => Some(Self::Vtk),
            () if ends(&[".pvd"]) => Some(Self::Pvd),
            () if ends(&[".h5", ".hdf5", ".he5", ".nc4", ".ims"]) => Some(Self::Hdf5),
            () if ends(&[".raw", ".bin", ".dat"]) => Some(Self::Raw),
            () => None,
        }
    }

    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Tiff => "TIFF",
            Self::Picture(PictureKind::Png) => "PNG",
            Self::Picture(PictureKind::Jpeg) => "JPEG",
            Self::Picture(PictureKind::Bmp) => "BMP",
            Self::Dicom => "DICOM",
            Self::Npy => ".npy",
            Self::Npz => ".npz",
            Self::Mrc => "MRC",
            Self::Envi => "ENVI",
            Self::Bov => "BOV",
            Self::Nifti => "NIfTI",
            Self::Nrrd => "NRRD",
            Self::MetaImage => "MetaImage",
            Self::Vtk => "VTK",
            Self::Pvd => ".pvd",
            Self::Hdf5 => "HDF5",
            Self::RawText => "raw (described by .json)",
            Self::Grids => "grid list",
            Self::Bdv => "BigDataViewer",
            Self::NetCdf => "NetCDF",
            Self::Zarr => "Zarr",
            Self::Raw => "raw",
        }
    }
}
