//! Siemens mosaics: the slices of a volume side by side in one picture, as its MR scanners write fMRI and diffusion.
//!
//! The number of slices, and the side on which they follow the first, come from Siemens' own header (CSA), an element of the file. The file's
//! position is for a first slice as large as the whole picture: the real one's corner is half of the difference further in, along rows and
//! columns. Both are as in nibabel and dcm2niix.

use super::header::Header;
use crate::error::{ImportError, Result};
use brickyard_volume::{VoxelBox, counted};
use dicom_dictionary_std::tags;
use glam::DVec3;
use std::path::Path;

/// Most slices; real mosaics have far fewer.
const MOST_TILES: u32 = 4096;
/// Largest sine between the header's normal and that of rows and columns.
const NORMAL_TOLERANCE: f64 = 1e-3;

/// Slices of a mosaic, row by row from its upper left corner.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Mosaic {
    /// Number of slices. Places after the last one are empty.
    pub(super) slices: u32,
    /// Number of slices side by side, and one above another.
    across: u32,
    /// Pixels of a slice.
    pub(super) columns: u32,
    pub(super) rows: u32,
    /// Direction from slice to slice, in the patient.
    normal: DVec3,
}

impl Mosaic {
    /// Reads the layout of a header's mosaic; `None` if it is an ordinary picture.
    ///
    /// # Errors
    /// If the file is a mosaic, and its header lacks the layout.
    pub(super) fn of(header: &Header) -> Result<Option<Self>> {
        if !header.is_mosaic() {
            return Ok(None);
        }
        let path = header.path.as_path();
        let csa = header.csa().ok_or_else(|| lacking(path, "the scanner's own header (CSA)"))?;
        let values = |name: &str| csa_numbers(csa, name);
        let slices = values("NumberOfImagesInMosaic").and_then(|numbers| numbers.first().copied());
        let slices = slices.filter(|n| n.fract() == 0.0 && (1.0..=f64::from(MOST_TILES)).contains(n));
        let Some(slices) = slices.map(|n| n as u32) else {
            return Err(lacking(path, "a number of slices in the scanner's own header (CSA)"));
        };
        if let Some(other) = header.private_mosaic_slices().filter(|other| *other != slices) {
            let problem =
                format!("is a mosaic of {slices} slices by one element, and of {other} by another; write it again");
            return Err(ImportError::invalid(path, problem));
        }
        let Some(&[x, y, z]) = values("SliceNormalVector").as_deref().and_then(|numbers| numbers.first_chunk()) else {
            return Err(lacking(path, "a direction of slices in the scanner's own header (CSA)"));
        };
        // Without a square root, so exact.
        let across = (1..=slices).find(|n| n * n >= slices).unwrap_or(1);
        let size = |tag| header.number(tag).map_or(0, |n| n as u32);
        let [rows, columns] = [size(tags::ROWS), size(tags::COLUMNS)];
        if rows < across || columns < across || !rows.is_multiple_of(across) || !columns.is_multiple_of(across) {
            let problem = format!(
                "is a mosaic of {}, so of {across} x {across} tiles, but {columns} x {rows} pixels do not divide into \
                 these",
                counted(slices.into(), "slice")
            );
            return Err(ImportError::invalid(path, problem));
        }
        let (columns, rows) = (columns / across, rows / across);
        Ok(Some(Self { slices, across, columns, rows, normal: DVec3::new(x, y, z) }))
    }

    /// The position of a slice's first pixel. `corner` is the file's; `step` holds the vectors from pixel to pixel along rows and along columns,
    /// and `step_mm` is the distance of slices.
    ///
    /// # Errors
    /// If rows and columns are not perpendicular to the direction from slice to slice.
    pub(super) fn position(
        &self,
        path: &Path,
        slice: u32,
        corner: DVec3,
        step: [DVec3; 2],
        step_mm: f64,
    ) -> Result<DVec3> {
        let upright = step[0].normalize().cross(step[1].normalize());
        let (normal, sign) = (self.normal.normalize_or_zero(), self.normal.dot(upright).signum());
        // False for NaN.
        let is_upright = (normal - upright * sign).length() < NORMAL_TOLERANCE;
        if !is_upright {
            let problem = format!(
                "is a mosaic with slices along {normal} (SliceNormalVector), which is not perpendicular to rows and \
                 columns (ImageOrientationPatient)"
            );
            return Err(ImportError::invalid(path, problem));
        }
        let beyond = |all: u32| f64::from(all * (self.across - 1)) / 2.0;
        let first = corner + step[0] * beyond(self.columns) + step[1] * beyond(self.rows);
        Ok(first + upright * (sign * step_mm * f64::from(slice)))
    }

    /// A slice's box as a box of the picture.
    pub(super) fn in_picture(&self, slice: u32, region: VoxelBox) -> VoxelBox {
        let mut region = region;
        let [x, y] = [slice % self.across * self.columns, slice / self.across * self.rows];
        (region.min.x, region.max.x) = (region.min.x + x, region.max.x + x);
        (region.min.y, region.max.y) = (region.min.y + y, region.max.y + y);
        region
    }
}

fn lacking(path: &Path, what: &str) -> ImportError {
    let feature = format!("a mosaic (many slices in one picture, as written by Siemens MR scanners) without {what}");
    ImportError::unsupported_but(path, feature, "convert its series with dcm2niix, and give the .nii file")
}

/// The numbers of an element of Siemens' own header, in the form written since 2004 ("SV10"); `None` if it has none.
///
/// Format: a count of elements, each of 84 bytes with its name, number of values and number of items, then the items: 16 bytes, whose second
/// number is a text's length, and the text, padded to a multiple of 4 bytes.
fn csa_numbers(csa: &[u8], name: &str) -> Option<Vec<f64>> {
    let number = |at: usize| Some(u32::from_le_bytes(*csa.get(at..)?.first_chunk()?));
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes.split(|&b| b == 0).next().unwrap_or_default()).into_owned();
    if csa.get(..4)? != b"SV10" {
        return None;
    }
    let (count, mut at) = (number(8)?, 16usize);
    for _ in 0..count {
        let found = text(csa.get(at..at.checked_add(64)?)?);
        let (values, items) = (number(at + 64)?, number(at + 76)?);
        at += 84;
        let mut numbers = Vec::new();
        for item in 0..items {
            let length = number(at.checked_add(4)?)? as usize;
            at += 16;
            let end = at.checked_add(length)?;
            let item_text = text(csa.get(at..end)?);
            if found == name && item < values {
                numbers.push(item_text.trim().parse::<f64>().ok().filter(|n| n.is_finite())?);
            }
            at = end.checked_next_multiple_of(4)?;
        }
        if found == name {
            return Some(numbers);
        }
    }
    None
}
