use crate::element::Endian;
use crate::options::OpenOptions;
use crate::source::SourceInfo;
use crate::testing::{Field, Opened, assert_boxes, is_warned, open_in, said, temp_file};
use brickyard_volume::VoxelType;
use glam::DVec3;
use proptest::prelude::*;

/// A header of 4 by 3 by 2 voxels.
#[derive(Clone)]
struct Written {
    bytes: Vec<u8>,
    endian: Endian,
}

impl Written {
    fn new(datatype: i16, bitpix: i16, endian: Endian) -> Self {
        let header = Self { bytes: vec![0; 348], endian }.put(0, &348i32.to_le_bytes());
        let header = header.shorts(40, &[4, 4, 3, 2, 1]).shorts(70, &[datatype, bitpix]);
        header.floats(76, &[0.0, 0.5, 0.75, 2.0])
    }

    fn put(mut self, at: usize, word: &[u8]) -> Self {
        let mut word = word.to_vec();
        if self.endian == Endian::Big {
            word.reverse();
        }
        self.bytes[at..at + word.len()].copy_from_slice(&word);
        self
    }

    fn shorts(self, at: usize, values: &[i16]) -> Self {
        values.iter().enumerate().fold(self, |header, (i, v)| header.put(at + 2 * i, &v.to_le_bytes()))
    }

    fn floats(self, at: usize, values: &[f32]) -> Self {
        values.iter().enumerate().fold(self, |header, (i, v)| header.put(at + 4 * i, &v.to_le_bytes()))
    }

    fn ints(self, at: usize, values: &[i32]) -> Self {
        values.iter().enumerate().fold(self, |header, (i, v)| header.put(at + 4 * i, &v.to_le_bytes()))
    }

    fn open(&self, body: &[u8]) -> Result<Opened, String> {
        let (folder, path) = temp_file("a.hdr", &self.bytes);
        std::fs::write(path.with_file_name("a.img"), body).unwrap();
        open_in((folder, path), &OpenOptions::default())
    }

    fn info(&self) -> SourceInfo {
        self.open(&[7; 24]).unwrap().info().clone()
    }
}

fn bytes() -> Written {
    Written::new(2, 8, Endian::Little)
}

#[test]
fn colours_whose_order_is_not_known_are_refused() {
    let message = Written::new(128, 24, Endian::Little).open(&[7; 72]).err().unwrap();
    assert!(message.contains("colours in ANALYZE 7.5") && message.contains("convert it to NIfTI"), "{message}");
}

#[test]
fn every_type_and_byte_order_gives_the_bytes_written() {
    use VoxelType::*;
    for (code, voxel_type) in [(2, U8), (4, I16), (8, I32), (16, F32), (130, I8), (132, U16), (136, U32)] {
        for endian in [Endian::Little, Endian::Big] {
            let field = Field { sizes: [4, 3, 2, 1, 1], voxel_type };
            let header = Written::new(code, voxel_type.bytes() as i16 * 8, endian);
            let source = header.open(&field.bytes("zyx", endian == Endian::Big)).unwrap();
            assert_boxes(&*source, field);
            let info = source.info();
            assert_eq!(info.geometry.spacing, DVec3::new(0.5, 0.75, 2.0));
            assert_eq!(info.geometry.unit.as_deref(), Some("millimeter"));
            assert!(info.calibrated && info.orientation.is_none());
            assert!(is_warned(&said(&info.notes), "left from right"));
        }
    }
    let times = bytes().shorts(40, &[4, 4, 3, 1, 2]).floats(92, &[2.5]);
    let info = times.info();
    assert_eq!((info.times, info.time.unwrap().step), (2, 2.5));
    assert_eq!(Written::new(32, 64, Endian::Little).open(&[0; 192]).unwrap().info().channels, 2, "complex numbers");
    assert!(Written::new(4, 8, Endian::Little).open(&[0; 48]).err().unwrap().contains("bitpix"));
}

#[test]
fn spm_places_and_scales() {
    let origin = |origin: &[i16]| bytes().shorts(253, origin).info().geometry.origin;
    assert_eq!(origin(&[2, 1, -1]), DVec3::new(-0.5, 0.0, 4.0));
    assert_eq!(origin(&[0, 0, 0]), DVec3::ZERO);
    assert_eq!(origin(&[8, 1, 1]), DVec3::ZERO, "far outside");
    let first = |header: Written| {
        let source = header.open(&[7; 24]).unwrap();
        let full = source.info().extent.full_box();
        let mut out = vec![0; 24 * source.info().voxel_type.bytes()];
        source.read_box(0, 0, full, &mut out).unwrap();
        match source.info().voxel_type {
            VoxelType::F32 => f32::from_le_bytes(out[..4].try_into().unwrap()),
            _ => f32::from(out[0]),
        }
    };
    assert_eq!(first(bytes().floats(112, &[0.5])), 3.5);
    assert_eq!(first(bytes().floats(112, &[0.5, 10.0])), 13.5);
    assert_eq!(first(bytes().floats(112, &[0.5, f32::NAN])), 3.5);
    assert_eq!(first(bytes().floats(112, &[f32::INFINITY])), 7.0);
    assert_eq!(first(bytes().floats(112, &[0.0, 10.0])), 7.0);
    // Ranges: 0..10 are stored for 0.5..5.5.
    let ranges = bytes().floats(124, &[5.5, 0.5]).ints(140, &[10, 0]);
    assert_eq!(first(ranges.clone()), 4.0);
    assert!(is_warned(&said(&ranges.info().notes), "ranges"));
    assert_eq!(first(bytes().floats(124, &[5.5, 0.5])), 7.0);
    assert_eq!(first(bytes().ints(140, &[10, 0])), 7.0);
}

#[test]
fn what_the_header_leaves_open_is_noted() {
    let mut coronal = bytes();
    coronal.bytes[252] = 1;
    assert!(is_warned(&said(&coronal.info().notes), "Slices are coronal"));
    coronal.bytes[252] = 77;
    assert!(is_warned(&said(&coronal.info().notes), "77, has no meaning"));
    let flipped = bytes().floats(80, &[-0.5]);
    assert!(is_warned(&said(&flipped.info().notes), "without their sign") && flipped.info().geometry.spacing.x == 0.5);
    let mut unit = bytes();
    unit.bytes[56..58].copy_from_slice(b"cm");
    assert_eq!(unit.info().geometry.unit.as_deref(), Some("centimeter"));
    unit.bytes[56..58].copy_from_slice(b"pc");
    assert!(unit.info().geometry.unit.is_none() && is_warned(&said(&unit.info().notes), "'pc'"));
    let mut damaged = bytes();
    damaged.bytes[344..348].copy_from_slice(b"ni1x");
    assert!(damaged.open(&[0; 24]).err().unwrap().contains("damaged NIfTI magic"));
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    /// Damage leads to an error or wrong voxels, never to a panic.
    #[test]
    fn damaged_headers_do_not_panic(damage in prop::collection::vec((0..348usize, any::<u8>()), 1..6)) {
        let mut header = bytes().floats(124, &[5.5, 0.5]).ints(140, &[10, 0]).shorts(253, &[2, 1, 1]);
        for (place, value) in damage {
            header.bytes[place] = value;
        }
        if let Ok(source) = header.open(&[9; 400]) {
            let full = source.info().extent.full_box();
            let mut out = vec![0; full.extent().volume() as usize * source.info().voxel_type.bytes()];
            source.read_box(0, 0, full, &mut out).unwrap();
        }
    }
}
