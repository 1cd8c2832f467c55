use super::*;
use crate::testing::{Field, assert_boxes, said};
use brickyard_volume::VoxelType;

/// A picture of Windows's first version, or a later one with masks.
struct Picture<'a> {
    size: [i32; 2],
    version: u32,
    bits: u16,
    compression: u32,
    density: i32,
    /// Red, green, blue and alpha, behind the header or in it.
    masks: &'a [u32],
    /// Blue, green, red and a spare byte for each colour.
    colours: &'a [u8],
    /// Rows as they lie in the file, without padding.
    rows: &'a [u8],
}

const PLAIN: Picture<'static> =
    Picture { size: [3, 2], version: 40, bits: 24, compression: 0, density: 0, masks: &[], colours: &[], rows: &[] };

impl Picture<'_> {
    fn file(&self) -> Vec<u8> {
        let mut header = self.version.to_le_bytes().to_vec();
        if self.version == 12 {
            self.size.iter().for_each(|size| header.extend((*size as u16).to_le_bytes()));
        } else {
            self.size.iter().for_each(|size| header.extend(size.to_le_bytes()));
        }
        header.extend(1u16.to_le_bytes());
        header.extend(self.bits.to_le_bytes());
        if self.version > 12 {
            header.extend(self.compression.to_le_bytes());
            header.extend([0; 4]);
            header.extend([self.density.to_le_bytes(), self.density.to_le_bytes()].concat());
            header.extend((self.colours.len() as u32 / 4).to_le_bytes());
            header.extend([0; 4]);
        }
        self.masks.iter().for_each(|mask| header.extend(mask.to_le_bytes()));
        header.resize(header.len().max(self.version as usize), 0);
        header.extend(self.colours);
        let start = 14 + header.len() as u32;
        let row_bytes = (self.size[0].unsigned_abs() as usize * usize::from(self.bits)).div_ceil(8).max(1);
        let mut rows = Vec::new();
        for row in self.rows.chunks(row_bytes) {
            rows.extend(row);
            rows.resize(rows.len().next_multiple_of(4), 0xee);
        }
        let end = start + rows.len() as u32;
        [b"BM", &end.to_le_bytes()[..], &[0; 4], &start.to_le_bytes(), &header, &rows].concat()
    }
}

/// Pixels of a field, blue first, from the last row or from the first one, with `spare` bytes.
fn pixels(field: Field, is_top_down: bool, spare: &[u8]) -> Vec<u8> {
    let [x, ..] = field.sizes.map(|n| n as usize);
    let bytes = field.bytes("yxc", false);
    let rows: Vec<Vec<u8>> = bytes
        .chunks(3 * x)
        .map(|row| row.chunks(3).flat_map(|p| [&[p[2], p[1], p[0]], spare].concat()).collect())
        .collect();
    if is_top_down { rows.concat() } else { rows.into_iter().rev().collect::<Vec<_>>().concat() }
}

#[test]
fn colours_of_24_and_32_bits_up_and_down() {
    for width in [1, 2, 3, 4, 7] {
        let field = Field { sizes: [width, 5, 1, 3, 1], voxel_type: VoxelType::U8 };
        for (bits, spare) in [(24, &[][..]), (32, &[9])] {
            for (height, is_top_down) in [(5, false), (-5, true)] {
                for version in [40, 52, 56, 108, 124] {
                    let rows = pixels(field, is_top_down, spare);
                    let picture = Picture { size: [width as i32, height], version, bits, rows: &rows, ..PLAIN };
                    let (_folder, source) = opened("a.bmp", picture.file());
                    assert_boxes(&*source, field);
                }
            }
        }
        let rows = pixels(field, false, &[]);
        let old = Picture { size: [width as i32, 5], version: 12, rows: &rows, ..PLAIN };
        let (_folder, source) = opened("a.bmp", old.file());
        assert_boxes(&*source, field);
    }
}

#[test]
fn masks_say_where_the_colours_are() {
    let rows: Vec<u8> = (0..24).collect();
    let byte = |i: u8| (0..6).map(|pixel| 4 * pixel + i).collect::<Vec<u8>>();
    for (masks, order) in [
        ([0xff_0000, 0xff00, 0xff, 0], &[2, 1, 0][..]),
        ([0xff, 0xff00, 0xff_0000, 0], &[0, 1, 2]),
        ([0xff_0000, 0xff00, 0xff, 0xff00_0000], &[2, 1, 0, 3]),
        ([0xff00_0000, 0xff_0000, 0xff00, 0xff], &[3, 2, 1, 0]),
        ([0xff00_0000, 0xff00, 0xff, 0xff_0000], &[3, 1, 0, 2]),
    ] {
        for (version, compression) in [(124, 3), (40, 6)] {
            let size = [3, -2];
            let picture = Picture { size, version, compression, bits: 32, masks: &masks, rows: &rows, ..PLAIN };
            let (_folder, source) = opened("a.bmp", picture.file());
            let channels: Vec<_> = (0..source.info().channels).map(|c| channel_of(&*source, c).unwrap()).collect();
            assert_eq!(channels, order.iter().map(|&i| byte(i)).collect::<Vec<_>>());
        }
    }
    let picture =
        Picture { version: 56, compression: 3, bits: 32, masks: &[0x3ff, 0xff00, 0xff, 0], rows: &rows, ..PLAIN };
    let message = refusal("a.bmp", &picture.file());
    assert!(message.contains("bit masks 000003ff, 0000ff00, 000000ff, 00000000 is not supported; write it as PNG"));
}

#[test]
fn palettes_of_1_4_and_8_bits() {
    let colours = [30, 20, 10, 0, 60, 50, 40, 0];
    let labels = OpenOptions { are_labels: Some(true), ..OpenOptions::default() };
    for (bits, rows) in [(1, &[0b0110_0000, 0b1000_0000][..]), (4, &[0x01, 0x10, 0x10, 0x00]), (8, &[0, 1, 1, 1, 0, 0])]
    {
        let picture = Picture { bits, colours: &colours, rows, ..PLAIN };
        let (_folder, source) = opened("a.bmp", picture.file());
        // The last row comes first.
        let channels = [0, 1, 2].map(|c| channel_of(&*source, c).unwrap());
        assert_eq!(channels, [[40, 10, 10, 10, 40, 40], [50, 20, 20, 20, 50, 50], [60, 30, 30, 30, 60, 60]]);
        let (_folder, source) = opened_as(&[("a.bmp", picture.file())], &labels).unwrap();
        assert_eq!(first_channel(&*source), [1, 0, 0, 0, 1, 1]);
        let grays = Picture { colours: &[0, 0, 0, 0, 255, 255, 255, 0], ..picture };
        let (_folder, source) = opened("a.bmp", grays.file());
        assert_eq!((source.info().channels, first_channel(&*source)), (1, vec![255, 0, 0, 0, 255, 255]));
        assert!(said(&source.info().notes).contains("a palette of grays"));
    }
    // Colours past the last index count neither as such nor as colours.
    let more = [0, 0, 0, 0, 255, 255, 255, 0, 1, 2, 3, 0];
    let (_folder, source) = opened("a.bmp", Picture { bits: 1, colours: &more, rows: &[0, 0], ..PLAIN }.file());
    assert_eq!(source.info().channels, 1);
    let few = Picture { bits: 8, colours: &colours, rows: &[0, 1, 2, 0, 0, 0], ..PLAIN };
    assert!(refusal("a.bmp", &few.file()).contains("the pixel at 2,1 has colour 2 of a palette of 2"));
}

#[test]
fn pixels_per_metre_are_a_spacing() {
    let (_folder, source) = opened("a.bmp", Picture { density: 2000, rows: &[1; 18], ..PLAIN }.file());
    assert_eq!(source.info().geometry.spacing.to_array(), [0.0005; 3]);
    let (_folder, source) = opened("a.bmp", Picture { density: 3780, rows: &[1; 18], ..PLAIN }.file());
    assert!(!source.info().calibrated);
    let (_folder, source) = opened("a.bmp", Picture { density: -3, rows: &[1; 18], ..PLAIN }.file());
    assert!(!source.info().calibrated);
}

#[test]
fn other_kinds_and_damage_are_named() {
    let plain = || Picture { rows: &[1; 18], ..PLAIN };
    for (picture, words) in [
        (Picture { compression: 1, bits: 8, ..plain() }, "a BMP picture compressed as RLE8 is not supported"),
        (Picture { compression: 2, bits: 4, ..plain() }, "compressed as RLE4"),
        (Picture { compression: 5, ..plain() }, "compressed as PNG"),
        (Picture { compression: 4, version: 64, ..plain() }, "compressed as RLE24"),
        (Picture { compression: 99, ..plain() }, "of the compression 99"),
        (Picture { bits: 16, ..plain() }, "of 16 bits a pixel"),
        (Picture { size: [0, 2], ..plain() }, "a picture of 0x2 pixels"),
        (Picture { size: [-3, 2], ..plain() }, "cut short"),
        (Picture { size: [3, i32::MIN], ..plain() }, "cut short"),
    ] {
        let message = refusal("a.bmp", &picture.file());
        assert!(message.contains(words), "{message}");
    }
    let file = plain().file();
    // All but the padding of the last row.
    assert!(opened_as(&[("a.bmp", file[..file.len() - 3].to_vec())], &OpenOptions::default()).is_ok());
    let message = refusal("a.bmp", &file[..file.len() - 4]);
    assert!(
        message.contains("the header implies 75 bytes (3x2 pixels of 24 bits, from byte 54), found 74 (1 missing)"),
        "{message}"
    );
    let mut inside = file.clone();
    inside[10] = 20;
    assert!(refusal("a.bmp", &inside).contains("start at byte 20, within the header"));
    assert!(refusal("a.bmp", b"GIF89a and more").contains("a GIF picture"));
    assert!(refusal("a.bmp", &[7; 99]).contains("does not start as a BMP picture"));
}
