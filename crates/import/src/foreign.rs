//! Known but unsupported formats: recognised by their first bytes, and named in messages with
//! advice.

use crate::error::{ImportError, Result};
use crate::files::first_bytes;
use std::path::Path;

/// Bytes examined by [`refuse`].
const LOOKED_AT: usize = 1024;

const CONVERT: &str = "convert it to NIfTI, TIFF, .npy or raw, as 3D Slicer, ITK or Fiji do";
const UNPACK: &str = "unpack it first";
const PICTURES: &str = "convert the pictures of a stack to PNG or TIFF";

/// Place in a file, the bytes there, the format, and advice.
const MAGICS: &[(usize, &[u8], &str, &str)] = &[
    (0, b"MATLAB 5.0", "a MATLAB file", CONVERT),
    (0, b"\xc3\x40\xf1", "a SEG-Y file", CONVERT),
    (0, b"C 1 ", "a SEG-Y file", CONVERT),
    (0, b"ZISRAWFILE", "a Zeiss CZI file", CONVERT),
    (0, b"\xda\xce\xbe\x0a", "a Nikon ND2 file", CONVERT),
    (0, b"\x70\0\0\0", "a Leica LIF file", CONVERT),
    (0, b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1", "an OLE file (Olympus OIB, Zeiss ZVI and others)", CONVERT),
    (0, b"SIMPLE  =", "a FITS file", CONVERT),
    (0, b" BDV\0\0\0\0", "an OpenVDB file", CONVERT),
    (0, b"# AmiraMesh", "an AmiraMesh file", CONVERT),
    (0, b"# Avizo", "an Avizo file", CONVERT),
    (0, b"raw_image_stack_by_hpeng", "a Vaa3D file", CONVERT),
    (0, b"# === DATA DESCRIPTION FILE", "a Philips PAR header", CONVERT),
    (0, b"MATRIX7", "an ECAT 7 file", CONVERT),
    (0, b"!INTERFILE", "an Interfile header", CONVERT),
    (0, b"\0\0\0\x0cjP  \r\n\x87\n", "a JPEG 2000 picture", PICTURES),
    (0, b"\xff\x4f\xff\x51", "a JPEG 2000 picture", PICTURES),
    (0, b"\xff\x0a", "a JPEG XL picture", PICTURES),
    (0, b"\0\0\0\x0cJXL \r\n\x87\n", "a JPEG XL picture", PICTURES),
    (0, b"GIF8", "a GIF picture", PICTURES),
    (8, b"WEBP", "a WebP picture", PICTURES),
    (4, b"ftypavif", "an AVIF picture", PICTURES),
    (4, b"ftypheic", "a HEIC picture", PICTURES),
    (0, b"PK\x03\x04", "a zip archive", UNPACK),
    (257, b"ustar", "a tar archive", UNPACK),
    (0, b"\x1f\x8b", "a gzip file (of those, NIfTI, ANALYZE and MRC are inflated)", UNPACK),
    (0, b"BZh", "a bzip2 file", UNPACK),
    (0, b"\xfd7zXZ\0", "an xz file", UNPACK),
    (0, b"7z\xbc\xaf\x27\x1c", "a 7z archive", UNPACK),
    (0, b"\x28\xb5\x2f\xfd", "a Zstandard file", UNPACK),
];

/// Formats without first bytes of their own.
const NAMES: &[(&str, &str)] = &[
    (".dm3", "a Gatan DM3 file"),
    (".dm4", "a Gatan DM4 file"),
    (".mgh", "a FreeSurfer MGH file"),
    (".mgz", "a FreeSurfer MGZ file"),
];

/// Refuses a file of a known but unsupported format. `name` is the file's name in lower case.
pub(crate) fn refuse(path: &Path, name: &str) -> Result<()> {
    let start = first_bytes(path, LOOKED_AT)?;
    let by_name = NAMES.iter().find(|(end, _)| name.ends_with(end)).map(|(_, what)| (*what, CONVERT));
    let has = |at: usize, magic: &[u8]| start.get(at..).is_some_and(|bytes| bytes.starts_with(magic));
    let by_magic = MAGICS.iter().find(|(at, magic, ..)| has(*at, magic)).map(|(.., what, advice)| (*what, *advice));
    match by_name.or(by_magic) {
        Some((what, advice)) => Err(ImportError::unsupported_but(path, what, advice)),
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::open::open;
    use crate::options::OpenOptions;
    use crate::testing::temp_file;

    #[test]
    fn known_formats_are_named_with_what_to_do() {
        for (at, magic, what, advice) in MAGICS {
            let mut bytes = vec![b' '; 2000];
            bytes[*at..at + magic.len()].copy_from_slice(magic);
            // Also under names that allow any content.
            for name in ["a.xyz", "a.dat"] {
                let (_folder, path) = temp_file(name, &bytes);
                let error = open(&[path], &OpenOptions::default()).err().unwrap();
                assert!(matches!(error, ImportError::Unsupported { .. }), "{error}");
                let expected = format!("{name}: {what} is not supported; {advice}");
                assert!(error.to_string().ends_with(&expected), "{error}");
            }
        }
        for name in ["a.dcm", "a.tif", "a.png", "a.nii", "a.npy", "a.raw"] {
            let (_folder, path) = temp_file(name, b"");
            let error = open(&[path], &OpenOptions::default()).err().unwrap();
            assert!(matches!(error, ImportError::Invalid { .. }) && error.to_string().contains("is empty"), "{error}");
        }
        for (end, what) in NAMES {
            let (_folder, path) = temp_file(&format!("A{}", end.to_ascii_uppercase()), b"1");
            let message = open(&[path], &OpenOptions::default()).err().unwrap().to_string();
            assert!(message.contains(what), "{message}");
        }
    }

    #[test]
    fn told_shapes_make_any_file_raw() {
        let (_folder, path) = temp_file("a.nrrd", b"NRRD0004");
        let told = OpenOptions {
            shape: Some(brickyard_volume::Extent::new(8, 1, 1)),
            voxel_type: Some(brickyard_volume::VoxelType::U8.into()),
            ..OpenOptions::default()
        };
        assert!(open(&[path], &told).is_ok());
    }
}
