//! TIFF of uncompressed pages, each a plane in one strip: channels first, then slices, then steps, one behind the other. All directories lie before the
//! first page, so that their places follow from their number, and all threads write pages at once; the `tiff` crate writes one page after another.
//! BigTIFF where the file passes 4 GiB. Costs a page's directory at a time.

use crate::error::ExportError;
use crate::plan::{Head, Layout};
use crate::volume::Volume;
use brickyard_volume::VoxelType;
use std::io::{self, Write};

/// Most pages, as programs count them.
const MOST_PAGES: u64 = i32::MAX as u64;
/// Bytes of which each value's place is a multiple.
const ALIGNED: u64 = 16;

/// Types of fields.
const BYTE: u16 = 1;
const ASCII: u16 = 2;
const SHORT: u16 = 3;
const LONG: u16 = 4;
const RATIONAL: u16 = 5;
const LONG8: u16 = 16;

/// A field of a directory.
#[derive(Clone, Debug)]
pub(crate) struct Field {
    tag: u16,
    kind: u16,
    count: u64,
    value: Vec<u8>,
}

impl Field {
    fn short(tag: u16, value: u16) -> Self {
        Self { tag, kind: SHORT, count: 1, value: value.to_le_bytes().into() }
    }

    fn rational(tag: u16, (numerator, denominator): (u32, u32)) -> Self {
        let value = [numerator.to_le_bytes(), denominator.to_le_bytes()].concat();
        Self { tag, kind: RATIONAL, count: 1, value }
    }

    /// A text, with a zero at its end.
    pub(crate) fn text(tag: u16, text: &str) -> Self {
        let value = [text.as_bytes(), &[0]].concat();
        Self { tag, kind: ASCII, count: value.len() as u64, value }
    }

    pub(crate) fn bytes(tag: u16, value: Vec<u8>) -> Self {
        Self { tag, kind: BYTE, count: value.len() as u64, value }
    }

    pub(crate) fn longs(tag: u16, numbers: &[u32]) -> Self {
        let value = numbers.iter().flat_map(|number| number.to_le_bytes()).collect();
        Self { tag, kind: LONG, count: numbers.len() as u64, value }
    }

    /// A value in the file's own width.
    fn place(tag: u16, value: u64, is_big: bool) -> Self {
        match is_big {
            true => Self { tag, kind: LONG8, count: 1, value: value.to_le_bytes().into() },
            false => Self { tag, kind: LONG, count: 1, value: (value as u32).to_le_bytes().into() },
        }
    }
}

/// A stack's facts beside its voxels.
pub(crate) struct Tags {
    /// Pixels along x and y per unit, as fractions; the unit is the description's.
    pub(crate) resolution: [(u32, u32); 2],
    /// Fields of the first page, in ascending order, above ImageDescription.
    pub(crate) description: String,
    pub(crate) first: Vec<Field>,
}

/// An arranged file.
pub(crate) struct Arranged {
    pub(crate) layout: Layout,
    /// Whether it is BigTIFF.
    pub(crate) is_big: bool,
}

/// Arranges a file.
///
/// # Errors
/// If it would have more pages than programs count.
pub(crate) fn arrange(volume: &Volume, tags: Tags) -> Result<Arranged, ExportError> {
    let info = volume.info;
    let pages =
        [info.channels, info.extent.z, info.times].iter().try_fold(1u64, |pages, n| pages.checked_mul((*n).into()));
    let pages = pages.filter(|pages| *pages <= MOST_PAGES).ok_or_else(|| {
        ExportError::unfit(
            volume.output,
            format!("more than {MOST_PAGES} pages, which TIFF's programs cannot count: choose fewer steps, or .nrrd"),
        )
    })?;
    let stack = Stack {
        size: [info.extent.x, info.extent.y],
        voxel_type: info.voxel_type,
        pages,
        page_bytes: volume.plane_bytes(),
        tags,
    };
    let small = Directories::of(&stack, false);
    let end = small.end(&stack).checked_add(pages.saturating_mul(stack.page_bytes));
    let is_big = end.is_none_or(|end| end > u64::from(u32::MAX));
    let directories = if is_big { Directories::of(&stack, true) } else { small };
    let start = directories.end(&stack);
    let page_bytes = stack.page_bytes;
    let plane_bytes = page_bytes.saturating_mul(info.channels.into());
    let step_bytes = plane_bytes.saturating_mul(info.extent.z.into());
    let head: Head = Box::new(move |out: &mut dyn Write| directories.write(&stack, out));
    let layout = Layout { head, start, plane_bytes, channel_bytes: page_bytes, step_bytes, others: Vec::new() };
    Ok(Arranged { layout, is_big })
}

struct Stack {
    size: [u32; 2],
    voxel_type: VoxelType,
    pages: u64,
    page_bytes: u64,
    tags: Tags,
}

/// Places of directories and their values.
struct Directories {
    is_big: bool,
    /// Values too long for their fields, by tag, with their places: of the first page, among them those of all pages.
    values: Vec<(u16, u64, Vec<u8>)>,
    /// Place of the first directory, and its length; the others follow.
    first: u64,
    first_bytes: u64,
    /// Length of each other directory.
    other_bytes: u64,
}

impl Directories {
    fn of(stack: &Stack, is_big: bool) -> Self {
        let mut place: u64 = if is_big { 16 } else { 8 };
        let inside = if is_big { 8 } else { 4 };
        let (first, others) = (stack.fields(0, 0, is_big), stack.fields(1, 0, is_big));
        let mut values = Vec::new();
        for field in first.iter().filter(|field| field.value.len() > inside) {
            values.push((field.tag, place, field.value.clone()));
            place = (place + field.value.len() as u64).next_multiple_of(ALIGNED);
        }
        let bytes = |fields: &[Field]| match is_big {
            true => 16 + 20 * fields.len() as u64,
            false => 6 + 12 * fields.len() as u64,
        };
        let first_place = place.next_multiple_of(ALIGNED);
        let (first_bytes, other_bytes) =
            (bytes(&first).next_multiple_of(ALIGNED), bytes(&others).next_multiple_of(ALIGNED));
        Self { is_big, values, first: first_place, first_bytes, other_bytes }
    }

    /// Bytes up to the first page.
    fn end(&self, stack: &Stack) -> u64 {
        self.place(stack.pages)
    }

    fn place(&self, page: u64) -> u64 {
        match page {
            0 => self.first,
            _ => self.first + self.first_bytes + (page - 1) * self.other_bytes,
        }
    }

    fn write(&self, stack: &Stack, out: &mut dyn Write) -> io::Result<()> {
        let mut written = 0;
        let mut put = |out: &mut dyn Write, bytes: &[u8]| {
            written += bytes.len() as u64;
            out.write_all(bytes).map(|()| written)
        };
        let fill = |written: u64, to: u64| vec![0; (to - written) as usize];
        let head = match self.is_big {
            true => [&b"II\x2b\0\x08\0\0\0"[..], &self.first.to_le_bytes()].concat(),
            false => [&b"II\x2a\0"[..], &(self.first as u32).to_le_bytes()].concat(),
        };
        let mut at = put(out, &head)?;
        for (_, place, value) in &self.values {
            put(out, &fill(at, *place))?;
            at = put(out, value)?;
        }
        put(out, &fill(at, self.first))?;
        let start = self.end(stack);
        for page in 0..stack.pages {
            let next = if page + 1 < stack.pages { self.place(page + 1) } else { 0 };
            let directory = self.directory(&stack.fields(page, start + page * stack.page_bytes, self.is_big), next);
            let at = put(out, &directory)?;
            put(out, &fill(at, self.place(page + 1)))?;
        }
        Ok(())
    }

    fn directory(&self, fields: &[Field], next: u64) -> Vec<u8> {
        let (mut bytes, inside) = (Vec::new(), if self.is_big { 8 } else { 4 });
        let number = |bytes: &mut Vec<u8>, number: u64| match self.is_big {
            true => bytes.extend(number.to_le_bytes()),
            false => bytes.extend((number as u32).to_le_bytes()),
        };
        match self.is_big {
            true => bytes.extend((fields.len() as u64).to_le_bytes()),
            false => bytes.extend((fields.len() as u16).to_le_bytes()),
        }
        for field in fields {
            bytes.extend([field.tag.to_le_bytes(), field.kind.to_le_bytes()].concat());
            number(&mut bytes, field.count);
            match self.values.iter().find(|(tag, ..)| *tag == field.tag).filter(|_| field.value.len() > inside) {
                Some((_, place, _)) => number(&mut bytes, *place),
                None => {
                    let mut value = field.value.clone();
                    value.resize(inside, 0);
                    bytes.extend(value);
                }
            }
        }
        number(&mut bytes, next);
        bytes
    }
}

impl Stack {
    /// The fields of a page whose voxels are at this place, in ascending order.
    fn fields(&self, page: u64, place: u64, is_big: bool) -> Vec<Field> {
        let ([width, height], [x, y]) = (self.size, self.tags.resolution);
        let format = match self.voxel_type {
            VoxelType::U8 | VoxelType::U16 | VoxelType::U32 => 1,
            VoxelType::I8 | VoxelType::I16 | VoxelType::I32 => 2,
            VoxelType::F32 => 3,
        };
        let is_first = page == 0;
        let mut fields = vec![
            Field::longs(256, &[width]),
            Field::longs(257, &[height]),
            Field::short(258, self.voxel_type.bytes() as u16 * 8),
            // No compression; black is zero.
            Field::short(259, 1),
            Field::short(262, 1),
        ];
        if is_first {
            fields.push(Field::text(270, &self.tags.description));
        }
        fields.extend([
            Field::place(273, place, is_big),
            Field::short(277, 1),
            Field::longs(278, &[height]),
            Field::place(279, self.page_bytes, is_big),
            Field::rational(282, x),
            Field::rational(283, y),
            Field::short(296, 1),
            Field::short(339, format),
        ]);
        if is_first {
            fields.extend(self.tags.first.iter().cloned());
        }
        fields
    }
}

/// GDAL's tag of the value of pixels without data.
pub(crate) fn nodata_field(volume: &Volume) -> Option<Field> {
    volume.info.nodata.map(|value| Field::text(42113, &value.to_string()))
}

/// A positive number as a fraction, to some 15 digits; `None` if 32 bits are too few for six.
pub(crate) fn fraction(number: f64) -> Option<(u32, u32)> {
    let (mut before, mut last) = ((0u64, 1u64), (1u64, 0u64));
    let mut rest = number;
    let value = |(above, below): (u64, u64)| above as f64 / below as f64;
    for _ in 0..64 {
        let whole = rest.floor();
        if !(0.0..=f64::from(u32::MAX)).contains(&whole) {
            break;
        }
        let next = (whole as u64 * last.0 + before.0, whole as u64 * last.1 + before.1);
        if next.0.max(next.1) > u32::MAX.into() {
            break;
        }
        (before, last) = (last, next);
        if (value(last) - number).abs() <= 1e-15 * number || rest == whole {
            break;
        }
        rest = 1.0 / (rest - whole);
    }
    let is_near = last.1 > 0 && last.0 > 0 && (value(last) - number).abs() <= 1e-7 * number;
    is_near.then_some((last.0 as u32, last.1 as u32))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{info, volume};
    use brickyard_volume::Extent;

    /// The bytes before the pages, and where these begin.
    fn written(extent: [u32; 3], description: &str) -> (Vec<u8>, Layout) {
        let mut info = info();
        info.extent = Extent::from_array(extent);
        let tags = Tags { resolution: [(3, 2); 2], description: description.into(), first: Vec::new() };
        let layout = arrange(&volume(&info), tags).unwrap().layout;
        let mut bytes = Vec::new();
        (layout.head)(&mut bytes).unwrap();
        assert_eq!((bytes.len() as u64, layout.start % ALIGNED), (layout.start, 0));
        (bytes, layout)
    }

    /// Fields of a directory (tag, value or its place) and the next directory's place; classic or big.
    fn directory(bytes: &[u8], at: usize, is_big: bool) -> (Vec<(u16, u64)>, u64) {
        let number = |at: usize, length: usize| {
            bytes[at..at + length].iter().rev().fold(0u64, |number, byte| number << 8 | u64::from(*byte))
        };
        let (head, entry, width) = if is_big { (8, 20, 8) } else { (2, 12, 4) };
        let count = number(at, head) as usize;
        let field = |i: usize| {
            let at = at + head + i * entry;
            (number(at, 2) as u16, number(at + 4 + width, width))
        };
        ((0..count).map(field).collect(), number(at + head + count * entry, width))
    }

    #[test]
    fn directories_lead_to_every_page_in_both_forms() {
        for (extent, is_big) in [([300, 20, 5], false), ([40_000, 30_000, 3], true)] {
            let (bytes, layout) = written(extent, "made by hand");
            assert_eq!(&bytes[..4], if is_big { b"II\x2b\0" } else { b"II\x2a\0" });
            let mut at = u64::from_le_bytes(bytes[if is_big { 8 } else { 4 }..][..8].try_into().unwrap());
            at = if is_big { at } else { u64::from(at as u32) };
            for page in 0..u64::from(extent[2]) {
                let (fields, next) = directory(&bytes, at as usize, is_big);
                assert!(fields.is_sorted());
                let value = |tag| fields.iter().find(|(found, _)| *found == tag).map(|(_, value)| *value);
                assert_eq!(value(273), Some(layout.start + page * layout.plane_bytes));
                assert_eq!(value(279), Some(layout.plane_bytes));
                assert_eq!([value(256), value(257)], [0, 1].map(|axis| Some(u64::from(extent[axis]))));
                let text = value(270).map(|at| &bytes[at as usize..][..13]);
                assert_eq!(text, (page == 0).then_some(&b"made by hand\0"[..]));
                at = next;
            }
            assert_eq!(at, 0);
        }
        // The last file of 32 bits, and the first of 64.
        let (_, small) = written([1 << 15, 1 << 15, 1], "");
        let (big, _) = written([1 << 15, (1 << 16) + 1, 1], "");
        assert!(small.start < 400 && big[2] == 0x2b);
    }

    #[test]
    fn lengths_are_short_fractions() {
        for (number, expected) in [
            (0.65, Some((13, 20))),
            (1.0, Some((1, 1))),
            (250.0, Some((250, 1))),
            (1.0 / 3.0, Some((1, 3))),
            (1e-9, Some((1, 1_000_000_000))),
            (0.0, None),
            (-1.0, None),
            (1e-12, None),
            (1e12, None),
            (f64::NAN, None),
            (f64::INFINITY, None),
        ] {
            assert_eq!(fraction(number), expected, "{number}");
        }
        for number in [std::f64::consts::PI, 0.123456789, 1e-6 * 0.333, 4.2e9] {
            let (above, below) = fraction(number).unwrap();
            assert!((f64::from(above) / f64::from(below) - number).abs() <= 1e-7 * number, "{number}");
        }
    }
}
