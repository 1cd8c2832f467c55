//! NumPy's `.npy`: a short Python dictionary before a plain array, read through [`RawSource`].
//!
//! The header is parsed here without trusting its values: lengths are capped and products checked.

use crate::axes::{AxisOrder, Sizes};
use crate::element::{Decode, Element, Endian};
use crate::error::{ImportError, Result};
use crate::mapped::MappedFile;
use crate::note::Note;
use crate::options::OpenOptions;
use crate::raw::{ArrayLayout, RawSource, identity};
use crate::source::SourceInfo;
use brickyard_volume::{VoxelType, are, counted};
use std::io::Read;
use std::path::Path;

/// Advice for arrays that are not plain.
const PLAIN: &str = "save one array of plain numbers, of 2 to 5 dimensions";

pub(crate) const MAGIC: &[u8] = b"\x93NUMPY";

/// Longest header read; NumPy's own are 118 bytes.
const LONGEST_HEADER: usize = 65536;

/// Opens a `.npy` file of 2 to 5 dimensions.
pub(crate) fn open(path: &Path, options: &OpenOptions) -> Result<RawSource> {
    let file = MappedFile::open(path)?;
    let header = Header::read(&mut &file[..], path)?;
    let array = header.layout(path, options)?;
    let body = array.body_bytes().map_err(|problem| ImportError::invalid(path, problem))?;
    let expected = body.saturating_add(array.offset);
    let found = file.len() as u64;
    if found < expected {
        let (shape, name, missing) = (header.shape, header.element.name(), expected - found);
        let problem = format!(
            "cut short: expected {expected} bytes for shape {shape:?} of {name}, found {found} ({missing} missing)"
        );
        return Err(ImportError::invalid(path, problem));
    }
    let trailing = found.saturating_sub(expected);
    let ignored = || format!("{} after the array {} ignored.", counted(trailing, "byte"), are(trailing));
    let trailing = (trailing > 0).then(|| Note::warning(ignored()));
    let info = SourceInfo {
        identity: identity(&format!("npy {}", array.axes), &[path])?,
        notes: trailing.into_iter().collect(),
        ..array.info()
    };
    RawSource::new(file, array, info)?.with_losses(None, options)
}

/// Reads the header at the start of a file, and lays out its array.
pub(crate) fn layout(file: &mut impl Read, path: &Path, options: &OpenOptions) -> Result<ArrayLayout> {
    Header::read(file, path)?.layout(path, options)
}

/// Shape and type of an array by its header.
pub(crate) fn summary(file: &mut impl Read, path: &Path) -> Result<String> {
    let Header { shape, element, .. } = Header::read(file, path)?;
    Ok(format!("{shape:?} {}", element.name()))
}

/// Assigns an axis to each dimension.
fn arrange(shape: &[u64], axes: Option<&AxisOrder>) -> Result<AxisOrder, String> {
    let usual = || AxisOrder::usual(shape.len());
    let Some(axes) = axes.cloned().or_else(usual) else {
        return Err(format!(
            "shape {shape:?} has {}; name them with `axes`, slowest first, such as tzyx or czyx",
            counted(shape.len() as u64, "dimension")
        ));
    };
    if axes.axes().len() != shape.len() {
        return Err(format!(
            "axes '{axes}' name {}, but the shape is {shape:?}; name its dimensions with `axes`",
            counted(axes.axes().len() as u64, "dimension")
        ));
    }
    Ok(axes)
}

#[derive(Debug, PartialEq)]
struct Header {
    element: Element,
    endian: Endian,
    fortran_order: bool,
    shape: Vec<u64>,
    body_offset: u64,
}

impl Header {
    fn layout(&self, path: &Path, options: &OpenOptions) -> Result<ArrayLayout> {
        if !(2..=5).contains(&self.shape.len()) {
            let count = counted(self.shape.len() as u64, "dimension");
            let feature = format!("an array of {count}, {:?} (2 to 5 are read),", self.shape);
            return Err(ImportError::unsupported_but(path, feature, PLAIN));
        }
        let axes = arrange(&self.shape, options.axes.as_ref()).map_err(|p| ImportError::options(path, p))?;
        let too_long = |_| {
            let feature = format!("an array of shape {:?}, with an axis longer than 2^32 - 1,", self.shape);
            ImportError::unsupported(path, feature)
        };
        let lengths: Result<Vec<u32>, _> = self.shape.iter().map(|&n| u32::try_from(n)).collect();
        Ok(ArrayLayout {
            sizes: Sizes::from_ordered(axes.axes(), &lengths.map_err(too_long)?),
            axes: if self.fortran_order { axes.reversed() } else { axes },
            decode: Decode { element: self.element, endian: self.endian, scale: None },
            offset: self.body_offset,
        })
    }

    fn read(file: &mut impl Read, path: &Path) -> Result<Self> {
        let invalid = |problem: &str| ImportError::invalid(path, problem);
        let mut start = [0; 8];
        file.read_exact(&mut start).map_err(|_| invalid("not a .npy file: shorter than its header"))?;
        if &start[..6] != MAGIC {
            return Err(invalid("not a .npy file: it does not start with \\x93NUMPY"));
        }
        let (length_bytes, length) = match start[6] {
            1 => (2, read_number::<2>(file)),
            2 | 3 => (4, read_number::<4>(file)),
            version => return Err(ImportError::unsupported_but(path, format!(".npy format version {version}"), PLAIN)),
        };
        let length = length.map_err(|_| invalid("cut short inside the header"))?;
        if length > LONGEST_HEADER {
            return Err(invalid(&format!(
                "its header claims {length} bytes, more than any valid one; save the array again"
            )));
        }
        let mut text = vec![0; length];
        file.read_exact(&mut text).map_err(|_| invalid("cut short inside the header"))?;
        let text = String::from_utf8_lossy(&text);
        Self::parse(&text, (8 + length_bytes + length) as u64, path)
    }

    fn parse(text: &str, body_offset: u64, path: &Path) -> Result<Self> {
        let lacks = |key| ImportError::invalid(path, format!("header without a valid '{key}': {}", text.trim()));
        let descr = value_of(text, "descr").and_then(quoted);
        if descr.is_none() && value_of(text, "descr").is_some_and(|v| v.starts_with('[')) {
            return Err(ImportError::unsupported_but(path, "an array of records", PLAIN));
        }
        let descr = descr.ok_or_else(|| lacks("descr"))?;
        let fortran_order = match value_of(text, "fortran_order") {
            Some(v) if v.starts_with("True") => true,
            Some(v) if v.starts_with("False") => false,
            _ => return Err(lacks("fortran_order")),
        };
        let shape = value_of(text, "shape").and_then(tuple).ok_or_else(|| lacks("shape"))?;
        let (element, endian) = element_of(descr).ok_or_else(|| {
            let advice = "bool, integers of 8 to 64 bits, float16, float32 and float64 are read";
            let what = if descr.ends_with('O') { " (pickled objects)" } else { "" };
            ImportError::unsupported_but(path, format!("dtype '{descr}'{what}"), advice)
        })?;
        Ok(Self { element, endian, fortran_order, shape, body_offset })
    }
}

fn read_number<const N: usize>(file: &mut impl Read) -> std::io::Result<usize> {
    let mut bytes = [0; 8];
    file.read_exact(&mut bytes[..N])?;
    Ok(u64::from_le_bytes(bytes) as usize)
}

/// The text after `'key':`.
fn value_of<'a>(text: &'a str, key: &str) -> Option<&'a str> {
    let after = ["'", "\""].iter().find_map(|q| text.split_once(&format!("{q}{key}{q}")))?.1;
    Some(after.trim_start().strip_prefix(':')?.trim_start())
}

fn quoted(value: &str) -> Option<&str> {
    let quote = value.chars().next().filter(|c| matches!(c, '\'' | '"'))?;
    value[1..].split(quote).next()
}

fn tuple(value: &str) -> Option<Vec<u64>> {
    let inside = value.strip_prefix('(')?.split_once(')')?.0;
    let items = inside.split(',').map(|s| s.trim().trim_end_matches('L')).filter(|s| !s.is_empty());
    items.map(|s| s.parse().ok()).collect()
}

/// The element of a NumPy type string such as `<u2`; booleans are bytes of 0 and 1.
fn element_of(descr: &str) -> Option<(Element, Endian)> {
    let (order, kind) = descr.split_at_checked(1)?;
    let endian = match order {
        "<" | "|" => Endian::Little,
        ">" => Endian::Big,
        "=" => Endian::native(),
        _ => return None,
    };
    let element = match kind {
        "u1" | "b1" => Element::Voxel(VoxelType::U8),
        "i1" => Element::Voxel(VoxelType::I8),
        "u2" => Element::Voxel(VoxelType::U16),
        "i2" => Element::Voxel(VoxelType::I16),
        "u4" => Element::Voxel(VoxelType::U32),
        "i4" => Element::Voxel(VoxelType::I32),
        "f2" => Element::F16,
        "f4" => Element::Voxel(VoxelType::F32),
        "u8" => Element::U64,
        "i8" => Element::I64,
        "f8" => Element::F64,
        _ => return None,
    };
    Some((element, endian))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::source::Source;
    use crate::testing::{Field, assert_boxes, temp_file};
    use npyz::WriterBuilder;

    fn options(axes: &str) -> OpenOptions {
        OpenOptions { axes: (!axes.is_empty()).then(|| axes.parse().unwrap()), ..OpenOptions::default() }
    }

    fn with_header(header: &str, body: &[u8]) -> Vec<u8> {
        let length = (header.len() as u16).to_le_bytes();
        [MAGIC, &[1, 0], &length, header.as_bytes(), body].concat()
    }

    /// Bytes written by an independent library.
    fn written(shape: &[u64], fortran: bool, values: &[u16]) -> Vec<u8> {
        let mut bytes = Vec::new();
        let order = if fortran { npyz::Order::Fortran } else { npyz::Order::C };
        let options = npyz::WriteOptions::new().default_dtype().shape(shape).order(order);
        let mut writer = options.writer(&mut bytes).begin_nd().unwrap();
        writer.extend(values.iter().copied()).unwrap();
        writer.finish().unwrap();
        bytes
    }

    #[test]
    fn both_orders_and_two_to_five_dimensions_are_read() {
        let values =
            |bytes: Vec<u8>| -> Vec<u16> { bytes.as_chunks().0.iter().map(|b| u16::from_le_bytes(*b)).collect() };
        for (axes, given) in [("yx", ""), ("zyx", ""), ("xyz", "xyz"), ("tzyx", "tzyx"), ("tczyx", "tczyx")] {
            let mut field = Field { sizes: [13, 7, 5, 2, 3], voxel_type: VoxelType::U16 };
            for (axis, size) in "xyzct".chars().zip(&mut field.sizes) {
                if !axes.contains(axis) {
                    *size = 1;
                }
            }
            let shape: Vec<u64> = axes.chars().map(|a| field.sizes["xyzct".find(a).unwrap()] as u64).collect();
            let reversed: String = axes.chars().rev().collect();
            for (fortran, order) in [(false, axes), (true, &reversed)] {
                let bytes = written(&shape, fortran, &values(field.bytes(order, false)));
                let (_folder, path) = temp_file("a.npy", &bytes);
                assert_boxes(&open(&path, &options(given)).unwrap(), field);
            }
        }
    }

    #[test]
    fn big_endian_and_booleans_are_read() {
        let field = Field { sizes: [3, 2, 4, 1, 1], voxel_type: VoxelType::F32 };
        let header = "{'descr': '>f4', 'fortran_order': False, 'shape': (4, 2, 3), }   \n";
        let (_folder, path) = temp_file("a.npy", &with_header(header, &field.bytes("zyx", true)));
        assert_boxes(&open(&path, &options("")).unwrap(), field);
        let header = "{\"descr\": \"|b1\", \"fortran_order\": False, \"shape\": (1L, 2L)}";
        let (_folder, path) = temp_file("a.npy", &with_header(header, &[0, 1]));
        assert_eq!(open(&path, &options("")).unwrap().info().voxel_type, VoxelType::U8);
    }

    #[test]
    fn halves_are_widened_and_wide_integers_kept_where_they_fit() {
        let read = |descr: &str, body: &[u8]| {
            let header = format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': (1, 1, 3)}}");
            let (_folder, path) = temp_file("a.npy", &with_header(&header, body));
            let source = open(&path, &options("")).unwrap();
            let mut out = vec![0; 3 * source.info().voxel_type.bytes()];
            source.read_box(0, 0, source.info().extent.full_box(), &mut out).unwrap();
            let voxel_type = source.info().voxel_type;
            (voxel_type, (0..3).map(|i| voxel_type.read(&out, i)).collect::<Vec<_>>(), source.info().notes.clone())
        };
        let halves = [-1.5f32, 65504.0, 5.960_464_5e-8].map(half::f16::from_f32);
        for (descr, body) in [
            ("<f2", halves.iter().flat_map(|h| h.to_le_bytes()).collect::<Vec<_>>()),
            (">f2", halves.iter().flat_map(|h| h.to_be_bytes()).collect()),
        ] {
            let (voxel_type, found, notes) = read(descr, &body);
            assert_eq!((voxel_type, found), (VoxelType::F32, halves.map(|h| h.to_f64()).to_vec()));
            assert_eq!(notes, []);
        }
        let body: Vec<u8> = [-7i64, i32::MAX.into(), 0].iter().flat_map(|n| n.to_be_bytes()).collect();
        let (voxel_type, found, notes) = read(">i8", &body);
        assert_eq!((voxel_type, &found[..]), (VoxelType::I32, &[-7.0, 2147483647.0, 0.0][..]));
        assert!(notes[0].contains("i64") && notes[0].contains("no value is changed"), "{notes:?}");
    }

    /// Each of several steps is reopened for reading.
    #[test]
    fn signed_labels_that_only_u32_holds_are_read() {
        let header = "{'descr': '<i8', 'fortran_order': False, 'shape': (1, 1, 2)}";
        let folder = tempfile::tempdir().unwrap();
        let body = |label: i64| [0, label].iter().flat_map(|n| n.to_le_bytes()).collect::<Vec<_>>();
        let labels: Vec<i64> = vec![1 << 31, u32::MAX.into(), (1 << 31) + 7];
        let paths: Vec<_> = (0..3).map(|i| folder.path().join(format!("l_{i}.npy"))).collect();
        for (path, label) in paths.iter().zip(&labels) {
            std::fs::write(path, with_header(header, &body(*label))).unwrap();
        }
        let told = OpenOptions { are_labels: Some(true), ..options("") };
        let source = crate::open::open(&paths, &told).unwrap();
        assert_eq!(source.info().voxel_type, VoxelType::U32);
        for (time, label) in (0..).zip(&labels) {
            let mut out = vec![0; 8];
            source.read_box(time, 0, source.info().extent.full_box(), &mut out).unwrap();
            assert_eq!(VoxelType::U32.read(&out, 1), *label as f64);
        }
        std::fs::write(&paths[0], with_header(header, &body(-1))).unwrap();
        let message = crate::open::open(&paths, &told).err().unwrap().to_string();
        assert!(message.contains("u32") && message.contains("i32"), "{message}");
    }

    #[test]
    fn what_cannot_be_read_is_refused_with_advice() {
        let refusal = |header: &str, body: &[u8], axes: &str| {
            let (_folder, path) = temp_file("a.npy", &with_header(header, body));
            open(&path, &options(axes)).err().unwrap().to_string()
        };
        let header =
            |descr: &str, shape: &str| format!("{{'descr': {descr}, 'fortran_order': False, 'shape': {shape}, }}");
        let u1 = |shape| header("'|u1'", shape);
        assert!(refusal(&u1("(2, 1, 1, 1)"), &[0; 2], "").contains("`axes`"));
        assert!(refusal(&u1("(2, 1, 1)"), &[0; 2], "yx").contains("name 2 dimensions"));
        for shape in ["()", "(2,)", "(1, 1, 1, 1, 1, 2)"] {
            assert!(refusal(&u1(shape), &[0; 2], "").contains("2 to 5 are read"), "{shape}");
        }
        assert!(refusal(&u1("(2, 2, 2)"), &[0; 5], "").contains("3 missing"));
        assert!(refusal(&u1("(2, 0, 2)"), &[], "").contains("size 0"));
        assert!(refusal(&u1("(4294967295, 4294967295, 4294967295)"), &[], "").contains("2^63"));
        assert!(refusal(&u1("(99999999999, 1, 1)"), &[], "").contains("longer than 2^32 - 1, is not supported"));
        assert!(refusal(&u1("(99999999999999999999999,)"), &[], "").contains("'shape'"));
        assert!(refusal(&header("'<f8'", "(1, 1, 1)"), &0.1f64.to_le_bytes(), "").contains("`allow_lossy`"));
        assert!(refusal(&header("'<c8'", "(1, 1, 1)"), &[0; 8], "").contains("dtype '<c8' is not supported; bool"));
        assert!(refusal(&header("[('a', '<f4')]", "(1, 1, 1)"), &[0; 8], "").contains("records"));
        assert!(refusal("{}", &[], "").contains("'descr'"));
        let (_folder, path) = temp_file("a.npy", b"\x93NUMPY\x02\x00\xff\xff\xff\x7f");
        assert!(open(&path, &options("")).err().unwrap().to_string().contains("2147483647"));
        let (_folder, path) = temp_file("a.npy", b"\x93NUM");
        assert!(open(&path, &options("")).err().unwrap().to_string().contains("shorter"));
    }
}
