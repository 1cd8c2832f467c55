//! The format of a file: by its contents, and by its name where these do not tell. Costs a read of its first bytes.

use crate::dicom_files::{MAGIC_BYTES, is_dicom};
use crate::error::{ImportError, Result};
use crate::files::{first_bytes, name_of};
use crate::format::{Format, PictureKind};
use crate::options::OpenOptions;
use crate::{
    bov, envi, foreign, grids, hdf5, meta_image, mrc, netcdf, npy, npz, nrrd, raw_text, tiff_stack, vtk, zarr,
};
use std::path::Path;

/// Readable formats and their names, for the message about an unknown one.
pub(crate) const READ: &str = "raw (.raw, .bin, .dat, or any file with `shape` and `voxel_type`, or with its .json), NumPy .npy and .npz, \
                    NIfTI (.nii, .nii.gz, .hdr with .img), ANALYZE 7.5, NRRD (.nrrd, .nhdr), MetaImage (.mha, .mhd), \
                    MRC and CCP4 (.mrc, .map), VTK images (.vti, .vtk, .pvd), ENVI (.hdr), BOV (.bov), \
                    HDF5 (.h5, .hdf5, .ims), BigDataViewer (.xml), NetCDF (.nc), MINC 1 (.mnc), \
                    TIFF (.tif, .tiff, .companion.ome), pictures of a stack (.png, .jpg, .bmp), \
                    DICOM (a folder, files or one file of a series), OME-Zarr and Zarr (a folder), lists of grids (.json), and folders of files of one of these";

/// Finds the format of a file. With a shape it is raw, whatever it holds.
pub(crate) fn format_of(path: &Path, options: &OpenOptions) -> Result<Format> {
    if zarr::is_zarr(path) {
        return Ok(Format::Zarr);
    }
    check_kind(path)?;
    if options.shape.is_some() {
        return Ok(Format::Raw);
    }
    let name = name_of(path).to_ascii_lowercase();
    // The file must exist before its name means anything.
    let start = first_bytes(path, MAGIC_BYTES)?;
    if start.is_empty() {
        return Err(ImportError::invalid(path, "the file is empty: fetch it again"));
    }
    let by_name = Format::of_name(path);
    // Voxels may begin like another format: labels of 32 bits, 8 first, like DICOM.
    if by_name == Some(Format::Raw) && raw_text::of_whole_name(path).is_file() {
        return Ok(Format::RawText);
    }
    if let Some(format) = format_of_contents(path, &name, &start)? {
        return Ok(format);
    }
    match by_name {
        _ if mrc::is_named(path, &name)? => return Ok(Format::Mrc),
        _ if [".img", ".img.gz"].iter().any(|end| name.ends_with(end)) => return Ok(Format::Nifti),
        // Names of any contents, or of formats with a magic: others are told apart first.
        None | Some(Format::Raw | Format::Npz | Format::Nrrd | Format::MetaImage | Format::Picture(_)) => {}
        Some(format) => return Ok(format),
    }
    foreign::refuse(path, &name)?;
    if matches!(by_name, None | Some(Format::Raw)) && raw_text::beside(path).is_some() {
        return Ok(Format::RawText);
    }
    by_name.ok_or_else(|| ImportError::invalid(path, format!("not a supported format; supported are: {READ}")))
}

/// The format of a file's contents; `None` of those known by their names alone. `name` is in lower case.
fn format_of_contents(path: &Path, name: &str, start: &[u8]) -> Result<Option<Format>> {
    let starts = |magics: &[&[u8]]| magics.iter().any(|magic| start.starts_with(magic));
    Ok(Some(match () {
        // Narrow MRC files start like DICOM ones without a preamble.
        () if mrc::has_magic(path)? => Format::Mrc,
        () if is_dicom(start) => Format::Dicom,
        () if starts(&[nrrd::MAGIC]) => Format::Nrrd,
        () if netcdf::is_netcdf(start) => Format::NetCdf,
        () if meta_image::is_header(start) => Format::MetaImage,
        // ENVI headers share their file name with NIfTI's.
        () if envi::is_envi(start) => Format::Envi,
        () if starts(&[npy::MAGIC]) => Format::Npy,
        () if starts(&[b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"]) => Format::Tiff,
        () if npz::is_npz(path, name, start)? => Format::Npz,
        () if hdf5::is_hdf5(path)? => Format::Hdf5,
        () if hdf5::is_spim_data(path)? => Format::Bdv,
        () if tiff_stack::is_companion(path)? => Format::Tiff,
        () if bov::is_bov(path)? => Format::Bov,
        () if grids::is_list(path)? => Format::Grids,
        () if raw_text::is_text(name, start) => Format::RawText,
        () => {
            return PictureKind::of_start(start)
                .map_or_else(|| vtk::format_of(path), |kind| Ok(Some(Format::Picture(kind))));
        }
    }))
}

/// Refuses folders within a list, and files without random access.
fn check_kind(path: &Path) -> Result<()> {
    let kind = std::fs::metadata(path).map_err(ImportError::io(path))?.file_type();
    let problem = match kind {
        kind if kind.is_file() => return Ok(()),
        kind if kind.is_dir() => {
            "a folder among other inputs: name its files, or pack one folder and append the others"
        }
        _ => {
            "a pipe or a device, without random access; name it as the only input, with `shape` and `voxel_type`, or write it to a file first"
        }
    };
    Err(ImportError::invalid(path, problem))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::temp_file;

    /// A file's magic tells its format, whatever its name.
    #[test]
    fn contents_count_before_names() {
        let starts: [(&[u8], Format); 9] = [
            (b"\x93NUMPY\x01\0", Format::Npy),
            (b"NRRD0004\n", Format::Nrrd),
            (b"NDims = 3\n", Format::MetaImage),
            (b"II*\0", Format::Tiff),
            (b"\x89HDF\r\n\x1a\n", Format::Hdf5),
            (b"\x89PNG\r\n\x1a\n", Format::Picture(PictureKind::Png)),
            (b"# vtk DataFile Version 3.0\n", Format::Vtk),
            (b"ENVI\n", Format::Envi),
            (b"DATA_FILE: a.raw\n", Format::Bov),
        ];
        let ends = [
            "mrc", "map", "bov", "nii", "img", "npy", "npz", "tif", "h5", "vti", "pvd", "nrrd", "mha", "jpg", "raw",
            "x",
        ];
        for (start, format) in starts {
            for end in ends {
                let (_folder, path) = temp_file(&format!("a.{end}"), &[start, &[0; 2000]].concat());
                assert_eq!(format_of(&path, &OpenOptions::default()).unwrap(), format, "{end}");
            }
        }
    }

    /// Two voxels of 32 bits, 8 and 100, are DICOM's first element; a text of the whole name tells that they are voxels.
    #[test]
    fn a_text_of_the_whole_name_counts_before_contents() {
        let (folder, path) = temp_file("a.raw", &[8, 0, 0, 0, 100, 0, 0, 0]);
        let found = |path: &Path| format_of(path, &OpenOptions::default()).unwrap();
        std::fs::write(folder.path().join("a.json"), "{}").unwrap();
        assert_eq!(found(&path), Format::Dicom);
        std::fs::write(folder.path().join("a.raw.json"), "{}").unwrap();
        assert_eq!(found(&path), Format::RawText);
    }
}
