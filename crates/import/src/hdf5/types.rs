//! Element types of datasets, from the very bytes of the file's datatype message: only whole integers and IEEE floats, for others
//! decode to wrong numbers. Costs a few comparisons per dataset.

use crate::element::{Element, Endian};
use brickyard_volume::VoxelType;
use hdf5_reader::error::ByteOrder;
use hdf5_reader::{Dataset, Datatype, EnumMember};

/// Most members of a compound taken as channels.
const MOST_MEMBERS: usize = 64;

/// Properties of an IEEE float in its message, by its size: sign place; bits, place and bits of the exponent, bits of the mantissa, bias.
const IEEE: [(usize, u8, [u8; 12]); 3] = [
    (2, 15, [0, 0, 16, 0, 10, 5, 0, 10, 15, 0, 0, 0]),
    (4, 31, [0, 0, 32, 0, 23, 8, 0, 23, 127, 0, 0, 0]),
    (8, 63, [0, 0, 64, 0, 52, 11, 0, 52, 0xff, 3, 0, 0]),
];

/// Numbers of a dataset's element.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Stored {
    pub(super) element: Element,
    pub(super) endian: Endian,
    /// Bytes of a whole element.
    pub(super) bytes: usize,
    /// Names of a compound's members, one after the other; empty for plain numbers.
    pub(super) members: Vec<String>,
}

impl Stored {
    /// The type of a dataset; the error names an unsupported one.
    pub(super) fn of(set: &Dataset) -> Result<Self, String> {
        let raw = set.raw_datatype().map_err(|error| format!("a datatype that cannot be read ({error})"))?;
        let stored = match set.dtype() {
            Datatype::Compound { size, fields } => {
                let fields: Option<Vec<_>> = fields
                    .iter()
                    .map(|field| Some((field.name.clone(), field.byte_offset as usize, plain(&field.datatype)?)))
                    .collect();
                compound(*size as usize, fields.unwrap_or_default(), &raw)?
            }
            datatype => {
                let stored = of_message(&raw)?;
                Self { element: of_truth(datatype, stored.element), ..stored }
            }
        };
        match set.raw_element_size() {
            Ok(bytes) if bytes == stored.bytes => Ok(stored),
            _ => Err("an element of unknown size".into()),
        }
    }

    /// The type as named in messages.
    pub(super) fn name(&self) -> String {
        let name = self.element.name();
        match self.members.len() {
            0 => name.into(),
            n => format!("compound of {n} {name}"),
        }
    }

    /// The numbers as f64, of plain numbers only.
    pub(super) fn numbers(&self, bytes: &[u8]) -> Vec<f64> {
        self.element.numbers(self.endian, bytes)
    }
}

/// Truth values, h5py's enumeration of FALSE and TRUE, are unsigned as in other formats.
fn of_truth(datatype: &Datatype, element: Element) -> Element {
    let is_truth = |members: &[EnumMember]| {
        let of = |name: &str| members.iter().find(|member| member.name == name).map(|member| &member.value[..]);
        members.len() == 2 && of("FALSE") == Some(&[0]) && of("TRUE") == Some(&[1])
    };
    match datatype {
        Datatype::Enum { members, .. } if is_truth(members) => Element::Voxel(VoxelType::U8),
        _ => element,
    }
}

/// The element of a plain datatype, as parsed: without the bits of its message.
pub(super) fn plain(datatype: &Datatype) -> Option<(Element, Endian)> {
    let endian = |order: &ByteOrder| if *order == ByteOrder::BigEndian { Endian::Big } else { Endian::Little };
    match datatype {
        Datatype::FixedPoint { size, signed, byte_order } => {
            Some((integer(*size as usize, *signed)?, endian(byte_order)))
        }
        Datatype::FloatingPoint { size, byte_order } => Some((float(*size as usize)?, endian(byte_order))),
        Datatype::Enum { base, .. } => plain(base),
        _ => None,
    }
}

fn integer(bytes: usize, is_signed: bool) -> Option<Element> {
    use VoxelType::*;
    Some(match (bytes, is_signed) {
        (1, false) => Element::Voxel(U8),
        (1, true) => Element::Voxel(I8),
        (2, false) => Element::Voxel(U16),
        (2, true) => Element::Voxel(I16),
        (4, false) => Element::Voxel(U32),
        (4, true) => Element::Voxel(I32),
        (8, false) => Element::U64,
        (8, true) => Element::I64,
        _ => return None,
    })
}

fn float(bytes: usize) -> Option<Element> {
    Some(match bytes {
        2 => Element::F16,
        4 => Element::Voxel(VoxelType::F32),
        8 => Element::F64,
        _ => return None,
    })
}

/// The type of a datatype message of the classes 0 (integer), 1 (float) and 8 (enumeration, of integers).
fn of_message(raw: &[u8]) -> Result<Stored, String> {
    let cut = || "a damaged datatype".to_string();
    let byte = |at: usize| raw.get(at).copied().ok_or_else(cut);
    let short = |at: usize| Ok::<_, String>(usize::from(byte(at)?) | usize::from(byte(at + 1)?) << 8);
    let bytes = short(4)? | short(6)? << 16;
    let flags = byte(1)?;
    let endian = if flags & 1 == 0 { Endian::Little } else { Endian::Big };
    let element = match byte(0)? & 15 {
        0 => {
            let (offset, precision) = (short(8)?, short(10)?);
            if offset != 0 || precision != 8 * bytes {
                return Err(format!("an integer type of {precision} bits in {bytes} bytes"));
            }
            integer(bytes, flags & 8 != 0).ok_or_else(|| format!("an integer type of {bytes} bytes"))?
        }
        1 => {
            let found = (byte(2)?, raw.get(8..20).ok_or_else(cut)?, flags & 0x70);
            // The leading bit is implied (2 in bits 4 and 5), and the order is not VAX's (bit 6).
            let ieee =
                |(size, sign, bits): &&(usize, u8, [u8; 12])| *size == bytes && found == (*sign, &bits[..], 0x20);
            let is_ieee = IEEE.iter().find(ieee).is_some();
            let other =
                || format!("a float type of {bytes} bytes other than IEEE's of 2, 4 and 8 (bfloat16 among them)");
            float(bytes).filter(|_| is_ieee).ok_or_else(other)?
        }
        2 => return Err("a time type".into()),
        3 => return Err("a string type".into()),
        4 => return Err("a bitfield type".into()),
        5 => return Err("an opaque type".into()),
        7 => return Err("a reference type".into()),
        8 => {
            return of_message(raw.get(8..).ok_or_else(cut)?).and_then(|base| match base.bytes == bytes {
                true => Ok(base),
                false => Err(cut()),
            });
        }
        9 => return Err("a variable-length type".into()),
        10 => return Err("an array type".into()),
        class => return Err(format!("a datatype of class {class}")),
    };
    Ok(Stored { element, endian, bytes, members: Vec::new() })
}

/// A compound of numbers of one type, such as h5py's complex numbers {r, i}: its members become channels.
fn compound(bytes: usize, mut fields: Vec<(String, usize, (Element, Endian))>, raw: &[u8]) -> Result<Stored, String> {
    let refuse = || "a compound type other than of numbers of one type".to_string();
    fields.sort_by_key(|(_, place, _)| *place);
    let (_, _, first) = *fields.first().ok_or_else(refuse)?;
    let (element, endian) = first;
    let size = element.bytes();
    let is_dense = fields.iter().enumerate().all(|(i, (_, place, of))| *place == i * size && *of == first);
    if !is_dense || fields.len() * size != bytes || fields.len() > MOST_MEMBERS {
        return Err(refuse());
    }
    // Every member's own message must be there, down to its bits.
    let message = |end: &[u8]| raw.windows(end.len()).filter(|part| *part == end).count();
    let whole = match IEEE.iter().find(|(of, ..)| *of == size).filter(|_| is_float(element)) {
        Some((_, sign, bits)) => {
            message(&[&[0x20 | u8::from(endian == Endian::Big), *sign, 0, size as u8, 0, 0, 0], &bits[..]].concat())
        }
        None => message(&[size as u8, 0, 0, 0, 0, 0, 8 * size as u8, 0]),
    };
    if whole < fields.len() {
        return Err(refuse());
    }
    let members = fields.into_iter().map(|(name, ..)| component(&name)).collect();
    Ok(Stored { element, endian, bytes, members })
}

fn is_float(element: Element) -> bool {
    matches!(element, Element::F16 | Element::F64 | Element::Voxel(VoxelType::F32))
}

/// A member's name as a channel's.
fn component(name: &str) -> String {
    match name {
        "r" | "re" | "real" => "real",
        "i" | "im" | "imag" => "imaginary",
        other => other,
    }
    .into()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn integers_and_floats_are_known_by_every_bit() {
        let integer = [0x10, 8, 0, 0, 2, 0, 0, 0, 0, 0, 16, 0];
        let stored = of_message(&integer).unwrap();
        assert_eq!((stored.element, stored.endian), (Element::Voxel(VoxelType::I16), Endian::Little));
        let mut narrow = integer;
        narrow[10] = 12;
        assert!(of_message(&narrow).unwrap_err().contains("12 bits in 2 bytes"));
        let float = [0x11, 0x21, 31, 0, 4, 0, 0, 0, 0, 0, 32, 0, 23, 8, 0, 23, 127, 0, 0, 0];
        let stored = of_message(&float).unwrap();
        assert_eq!((stored.element, stored.endian), (Element::Voxel(VoxelType::F32), Endian::Big));
        for (at, value) in [(1, 0x61), (1, 0x01), (2, 30), (12, 22), (13, 7), (16, 126)] {
            let mut other = float;
            other[at] = value;
            assert!(of_message(&other).unwrap_err().contains("other than IEEE"), "{at}");
        }
        let bfloat = [0x11, 0x20, 15, 0, 2, 0, 0, 0, 0, 0, 16, 0, 7, 8, 0, 7, 127, 0, 0, 0];
        assert!(of_message(&bfloat).unwrap_err().contains("bfloat16"));
        let enumeration = [&[0x18, 2, 0, 0, 2, 0, 0, 0][..], &integer].concat();
        assert_eq!(of_message(&enumeration).unwrap().element, Element::Voxel(VoxelType::I16));
        for length in 0..float.len() {
            assert!(of_message(&float[..length]).is_err());
        }
    }
}
