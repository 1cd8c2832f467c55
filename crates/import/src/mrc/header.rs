//! The header of an MRC file, with every field checked.

use crate::axes::{Axis, AxisOrder, Sizes};
use crate::element::{Decode, Element, Endian};
use crate::error::{ImportError, Result};
use crate::note::Note;
use crate::raw::ArrayLayout;
use brickyard_volume::VoxelType;
use std::path::Path;

pub(super) const HEADER_BYTES: usize = 1024;

/// Numbers of space groups of stacks: of images, and of volumes (401 and the space group of each).
const IMAGE_STACK: i32 = 0;
const VOLUME_STACKS: std::ops::RangeInclusive<i32> = 401..=630;
/// IMOD's mark, and flags behind it: bytes are signed; the origin has the standard's sign; a byte holds two numbers.
const IMOD_STAMP: i32 = 1146047817;
const IMOD_SIGNED: i32 = 1;
const IMOD_ORIGIN: i32 = 4;
const IMOD_PACKED: i32 = 16;
/// Mode of numbers of 4 bits.
const PACKED: i32 = 101;
/// Greatest number of a mode in use is 101; greater ones are of the other byte order.
const GREATEST_MODE: i32 = 1023;

const AXES: [Axis; 3] = [Axis::X, Axis::Y, Axis::Z];
const ADVICE: &str = "write it again in mode 0, 1, 2, 6 or 12 (IMOD's newstack, mrcfile)";

/// A checked header.
pub(super) struct Header {
    pub(super) array: ArrayLayout,
    pub(super) fields: Fields,
    pub(super) notes: Vec<Note>,
}

/// Header fields as stored in the file. Three numbers are along x, y, z of the cell, unless said otherwise.
#[derive(Debug)]
pub(super) struct Fields {
    /// Along columns, rows and sections.
    sizes: [i32; 3],
    mode: i32,
    /// Index of the first column, row and section.
    pub(super) starts: [i32; 3],
    /// Sampling intervals of the cell.
    pub(super) intervals: [i32; 3],
    /// The cell's edges in angstroms, and its angles in degrees.
    pub(super) cell: [f64; 3],
    pub(super) angles: [f64; 3],
    /// The axes (1 is x) of columns, rows and sections.
    map_axes: [i32; 3],
    /// Least and greatest value, according to the file.
    range: [f64; 2],
    space_group: i32,
    extended_bytes: i32,
    /// Flag and matrix of CCP4's skew transformation, for files without a version.
    pub(super) is_skewed: bool,
    imod_flags: Option<i32>,
    pub(super) origin: [f64; 3],
}

impl Header {
    /// Whether the magic bytes stand in a header that makes sense, or before a machine stamp: then it is one, if a damaged one. Some writers
    /// end the magic bytes by 0. DICOM's and NIfTI's magic bytes come first, for their texts may lie at these.
    pub(super) fn has_magic(bytes: &[u8]) -> bool {
        let has = |at: usize, magic: &[u8]| bytes.get(at..).is_some_and(|there| there.starts_with(magic));
        if bytes.len() < HEADER_BYTES || has(344, b"n+1\0") || has(344, b"ni1\0") || has(128, b"DICM") {
            return false;
        }
        let is_stamped = has(208, b"MAP ") && (has(212, b"\x44") || has(212, b"\x11"));
        is_stamped || has(208, b"MAP") && Self::makes_sense(bytes)
    }

    /// Whether the numbers make sense in either byte order.
    pub(super) fn makes_sense(bytes: &[u8]) -> bool {
        let makes_sense = |order| Fields::read(bytes, order).make_sense();
        bytes.len() >= HEADER_BYTES && (makes_sense(Endian::Little) || makes_sense(Endian::Big))
    }

    pub(super) fn read(bytes: &[u8], path: &Path) -> Result<Self> {
        if bytes.len() < HEADER_BYTES {
            let problem = format!(
                "cut short: expected the {HEADER_BYTES} bytes of an MRC header, found {}; fetch the file again",
                bytes.len()
            );
            return Err(ImportError::invalid(path, problem));
        }
        let mut notes = Vec::new();
        let (endian, fields) = in_order(bytes, path, &mut notes)?;
        let array = fields.array(endian, path, &mut notes)?;
        Ok(Self { array, fields, notes })
    }
}

/// Byte order and fields. The machine stamp counts unless only the other order makes sense: stamps are often missing or wrong.
fn in_order(bytes: &[u8], path: &Path, notes: &mut Vec<Note>) -> Result<(Endian, Fields)> {
    let stamped = match bytes[212] {
        0x44 => Some(Endian::Little),
        0x11 => Some(Endian::Big),
        _ => None,
    };
    let [little, big] = [Endian::Little, Endian::Big].map(|endian| (endian, Fields::read(bytes, endian)));
    let (endian, fields) = match (little.1.make_sense(), big.1.make_sense()) {
        (true, true) if stamped == Some(Endian::Little) => little,
        (true, true) if stamped == Some(Endian::Big) => big,
        // A size that is sound one way is vast the other way.
        (true, true) if little.1.sizes.iter().max() <= big.1.sizes.iter().max() => little,
        (true, false) => little,
        (_, true) => big,
        (false, false) => {
            let Fields { sizes, mode, map_axes, extended_bytes, .. } =
                if stamped == Some(Endian::Big) { big.1 } else { little.1 };
            return Err(ImportError::invalid(
                path,
                format!(
                    "no valid MRC header: {sizes:?} columns, rows and sections, mode {mode}, axes {map_axes:?}, \
                     {extended_bytes} bytes of extended header; fetch or write the file again"
                ),
            ));
        }
    };
    if stamped != Some(endian) {
        let stamp = if stamped.is_none() { "no machine stamp" } else { "the machine stamp of the other byte order" };
        notes.push(Note::warning(format!("The header has {stamp}: its numbers are read as {endian}-endian.")));
    }
    Ok((endian, fields))
}

impl Fields {
    fn read(bytes: &[u8], endian: Endian) -> Self {
        let word = |at: usize| {
            let mut word = [0; 4];
            let there = bytes.get(at..).unwrap_or_default();
            let count = there.len().min(4);
            word[..count].copy_from_slice(&there[..count]);
            if endian == Endian::Big {
                word.reverse();
            }
            word
        };
        let int = |at| i32::from_le_bytes(word(at));
        // The shortest decimal that gives the f32: 0.1 stays 0.1.
        let float = |at| {
            let value = f32::from_le_bytes(word(at));
            value.to_string().parse().unwrap_or(f64::from(value))
        };
        let ints = |at| [at, at + 4, at + 8].map(int);
        let floats = |at| [at, at + 4, at + 8].map(float);
        let imod_flags = (int(152) == IMOD_STAMP).then(|| int(156));
        let matrix: [f64; 9] = std::array::from_fn(|i| float(100 + 4 * i));
        let has_matrix = matrix.iter().all(|n| n.abs() < 1e6) && matrix.iter().any(|n| n.abs() > 1e-6);
        Self {
            sizes: ints(0),
            mode: int(12),
            starts: ints(16),
            intervals: ints(28),
            cell: floats(40),
            angles: floats(52),
            map_axes: ints(64),
            range: [float(76), float(80)],
            space_group: int(88),
            extended_bytes: int(92),
            is_skewed: int(96) == 1 && imod_flags.is_none() && has_matrix,
            imod_flags,
            origin: floats(196),
        }
    }

    /// Whether a file could have these numbers.
    fn make_sense(&self) -> bool {
        self.sizes.iter().all(|&n| n > 0)
            && (0..=GREATEST_MODE).contains(&self.mode)
            && self.axes().is_some()
            && self.extended_bytes >= 0
    }

    /// The axes (0 is x) of columns, rows and sections. Old files leave all of them 0.
    pub(super) fn axes(&self) -> Option<[usize; 3]> {
        if self.map_axes == [0; 3] {
            return Some([0, 1, 2]);
        }
        let axes = self.map_axes.map(|axis| usize::try_from(i64::from(axis) - 1).unwrap_or(3));
        (0..3).all(|axis| axes.contains(&axis)).then_some(axes)
    }

    /// Numbers of a row, where two of them share a byte.
    pub(super) fn packed_columns(&self) -> Option<u32> {
        (self.mode == PACKED).then_some(self.sizes[0].unsigned_abs())
    }

    pub(super) fn is_image_stack(&self) -> bool {
        self.space_group == IMAGE_STACK
    }

    /// Whether IMOD wrote the origin, with the sign that it used at first.
    pub(super) fn has_imod_origin(&self) -> bool {
        self.imod_flags.is_some_and(|flags| flags & IMOD_ORIGIN == 0)
    }

    fn array(&self, endian: Endian, path: &Path, notes: &mut Vec<Note>) -> Result<ArrayLayout> {
        let (element, channels) = self.element(path, notes)?;
        let axes = self.axes().unwrap_or([0, 1, 2]);
        let [columns, rows, sections] = self.sizes.map(i32::unsigned_abs);
        let mut order = vec![Axis::T, AXES[axes[2]], AXES[axes[1]], AXES[axes[0]]];
        let (times, sections) = self.steps(sections, axes, path)?;
        let mut sizes = vec![times, sections, rows, columns];
        if channels > 1 {
            order.push(Axis::C);
            sizes.push(channels);
        }
        Ok(ArrayLayout {
            sizes: Sizes::from_ordered(&order, &sizes),
            axes: AxisOrder::of(&order),
            decode: Decode { element, endian, scale: None },
            offset: HEADER_BYTES as u64 + u64::from(self.extended_bytes.unsigned_abs()),
        })
    }

    /// Time steps and sections of each: the volumes of a stack of volumes become steps.
    fn steps(&self, sections: u32, axes: [usize; 3], path: &Path) -> Result<(u32, u32)> {
        if !VOLUME_STACKS.contains(&self.space_group) {
            return Ok((1, sections));
        }
        let [.., depth] = self.intervals;
        let depth = u32::try_from(depth).ok().filter(|&n| n > 0 && sections.is_multiple_of(n)).ok_or_else(|| {
            let problem = format!(
                "a stack of volumes (space group {}) of {sections} sections, but MZ says {depth} for each; write the \
                 header again",
                self.space_group
            );
            ImportError::invalid(path, problem)
        })?;
        if axes != [0, 1, 2] {
            let feature = format!("a stack of volumes with the axes {:?} (MAPC, MAPR, MAPS)", self.map_axes);
            return Err(ImportError::unsupported_but(path, feature, "write it with x along columns and y along rows"));
        }
        Ok((sections / depth, depth))
    }

    /// The stored number, and how many are in a voxel.
    fn element(&self, path: &Path, notes: &mut Vec<Note>) -> Result<(Element, u32)> {
        use VoxelType::*;
        let refuse = |feature: &str| Err(ImportError::unsupported_but(path, feature, ADVICE));
        let (voxel_type, channels) = match self.mode {
            0 if self.imod_flags.is_some_and(|flags| flags & IMOD_PACKED != 0) => {
                return refuse("mode 0 with two 4-bit numbers in a byte (IMOD's flag)");
            }
            0 => (self.byte(notes), 1),
            1 => (I16, 1),
            2 => (F32, 1),
            3 => (I16, 2),
            4 => (F32, 2),
            6 => (U16, 1),
            12 => return Ok((Element::F16, 1)),
            16 => (U8, 3),
            PACKED => (U8, 1),
            mode => return refuse(&format!("mode {mode}")),
        };
        Ok((Element::Voxel(voxel_type), channels))
    }

    /// Type of bytes: signed by the standard, which came after programs with unsigned ones. IMOD's flag tells; without it, so may the
    /// extremes in the header, which signed bytes cannot have.
    fn byte(&self, notes: &mut Vec<Note>) -> VoxelType {
        let [least, greatest] = self.range;
        match self.imod_flags {
            Some(flags) if flags & IMOD_SIGNED != 0 => VoxelType::I8,
            Some(_) => {
                notes.push(Note::new("Bytes are unsigned, by IMOD's flag."));
                VoxelType::U8
            }
            None if least >= 0.0 && greatest > 127.0 && greatest <= 255.0 => {
                notes.push(Note::warning(format!(
                    "Bytes (mode 0) are read as unsigned, for the header says that values are {least} to {greatest}; by \
                     the standard they are signed."
                )));
                VoxelType::U8
            }
            None => {
                notes.push(Note::new(
                    "Bytes (mode 0) are signed, by the standard; some old programs mean unsigned ones.",
                ));
                VoxelType::I8
            }
        }
    }
}
