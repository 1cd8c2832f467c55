use crate::element::Endian;
use crate::options::OpenOptions;
use crate::testing::{Field, Opened, assert_boxes, is_warned, open_in, said, temp_file};
use brickyard_volume::VoxelType;
use glam::DVec3;
use proptest::prelude::*;
use std::io::Write;

/// A header with the fields varied by the tests, in words of the file.
#[derive(Clone)]
struct Written {
    bytes: Vec<u8>,
    endian: Endian,
}

impl Written {
    fn new(sizes: [i32; 3], mode: i32, endian: Endian) -> Self {
        let stamp: [u8; 4] = if endian == Endian::Big { [0x11, 0x11, 0, 0] } else { [0x44, 0x44, 0, 0] };
        let mut header = Self { bytes: vec![0; 1024], endian };
        header.bytes[208..212].copy_from_slice(b"MAP ");
        header.bytes[212..216].copy_from_slice(&stamp);
        let cell = [0, 1, 2].map(|i| sizes[i] as f32 * [1.5, 2.0, 0.1][i]);
        let header = header.ints(0, &sizes).ints(12, &[mode]).ints(28, &sizes).floats(40, &cell).floats(52, &[90.0; 3]);
        header.ints(64, &[1, 2, 3]).ints(88, &[1])
    }

    fn put(mut self, at: usize, mut word: [u8; 4]) -> Self {
        if self.endian == Endian::Big {
            word.reverse();
        }
        self.bytes[at..at + 4].copy_from_slice(&word);
        self
    }

    fn ints(self, at: usize, values: &[i32]) -> Self {
        values.iter().enumerate().fold(self, |header, (i, v)| header.put(at + 4 * i, v.to_le_bytes()))
    }

    fn floats(self, at: usize, values: &[f32]) -> Self {
        values.iter().enumerate().fold(self, |header, (i, v)| header.put(at + 4 * i, v.to_le_bytes()))
    }

    fn bytes(mut self, at: usize, bytes: &[u8]) -> Self {
        self.bytes[at..at + bytes.len()].copy_from_slice(bytes);
        self
    }

    fn with(&self, body: &[u8]) -> Vec<u8> {
        [&self.bytes, body].concat()
    }

    /// Opens a file of this header and body.
    fn open(&self, body: &[u8]) -> Result<Opened, String> {
        open_in(temp_file("a.mrc", &self.with(body)), &OpenOptions::default())
    }
}

fn plain(sizes: [i32; 3], mode: i32) -> Written {
    Written::new(sizes, mode, Endian::Little)
}

fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

#[test]
fn every_mode_and_byte_order_gives_the_bytes_written() {
    use VoxelType::*;
    for (mode, voxel_type, channels) in
        [(0, I8, 1), (1, I16, 1), (2, F32, 1), (3, I16, 2), (4, F32, 2), (6, U16, 1), (16, U8, 3)]
    {
        for endian in [Endian::Little, Endian::Big] {
            let field = Field { sizes: [13, 7, 5, channels, 1], voxel_type };
            let header = Written::new([13, 7, 5], mode, endian);
            let source = header.open(&field.bytes("tzyxc", endian == Endian::Big)).unwrap();
            assert_boxes(&*source, field);
            let info = source.info();
            let names: Vec<_> = info.channel_looks.iter().filter_map(|look| look.name.as_deref()).collect();
            let expected: &[&str] = match channels {
                2 => &["real", "imaginary"],
                3 => &["red", "green", "blue"],
                _ => &[],
            };
            assert_eq!(names, expected);
            assert!(info.calibrated && (info.geometry.spacing - DVec3::new(1.5, 2.0, 0.1)).length() < 1e-7);
            assert_eq!((info.geometry.unit.as_deref(), info.geometry.origin), (Some("angstrom"), DVec3::ZERO));
        }
    }
    let halves: Vec<u8> = [1.5f32, -2.0].iter().flat_map(|v| half::f16::from_f32(*v).to_be_bytes()).collect();
    let source = Written::new([2, 1, 1], 12, Endian::Big).open(&halves).unwrap();
    let mut out = [0; 8];
    source.read_box(0, 0, source.info().extent.full_box(), &mut out).unwrap();
    assert_eq!(out, [1.5f32.to_le_bytes(), (-2.0f32).to_le_bytes()].concat()[..]);
}

/// Two numbers in a byte, the first in its lower half; rows of an odd length end with half a byte unused.
#[test]
fn numbers_of_4_bits_become_bytes() {
    for columns in [12u32, 13] {
        let field = Field { sizes: [columns, 7, 5, 1, 1], voxel_type: VoxelType::U8 };
        let number = |x: u32, row: u32| ((x * 5 + row * 3 + 7) % 16) as u8;
        let mut body = vec![0xaa; 64];
        for (row, x) in (0..35).flat_map(|row| (0..columns.div_ceil(2)).map(move |byte| (row, 2 * byte))) {
            let upper = if x + 1 < columns { number(x + 1, row) } else { 9 };
            body.push(number(x, row) | upper << 4);
        }
        let header = plain([columns as i32, 7, 5], 101).ints(92, &[64]);
        let whole = header.with(&body);
        for (name, bytes) in [("a.mrc", whole.clone()), ("a.mrc.gz", gzip(&whole))] {
            let source = open_in(temp_file(name, &bytes), &OpenOptions::default()).unwrap();
            assert_eq!(source.info().voxel_type, field.voxel_type);
            let mut out = vec![0; 35 * columns as usize];
            source.read_box(0, 0, source.info().extent.full_box(), &mut out).unwrap();
            let expected: Vec<u8> = (0..35).flat_map(|row| (0..columns).map(move |x| number(x, row))).collect();
            assert_eq!(out, expected, "{columns}");
        }
        let message = header.open(&body[..body.len() - 1]).err().unwrap();
        assert!(message.contains("cut short"), "{message}");
    }
}

#[test]
fn columns_rows_and_sections_run_along_any_axes() {
    let voxel_type = VoxelType::U16;
    for map in [[1, 2, 3], [1, 3, 2], [2, 1, 3], [2, 3, 1], [3, 1, 2], [3, 2, 1]] {
        // Sizes along x, y, z, and in the file's order.
        let field = Field { sizes: [4, 3, 2, 1, 1], voxel_type };
        let sizes = map.map(|axis| field.sizes[axis as usize - 1] as i32);
        let order: String = map.iter().rev().map(|axis| ["x", "y", "z"][*axis as usize - 1]).collect();
        let header = plain(sizes, 6).ints(28, &[4, 3, 2]).floats(40, &[8.0, 9.0, 10.0]).ints(64, &map);
        let header = header.ints(16, &[10, 20, 30]);
        let source = header.open(&field.bytes(&order, false)).unwrap();
        assert_boxes(&*source, field);
        let start = |axis: i32| f64::from(10 * (1 + map.iter().position(|&a| a == axis).unwrap() as i32));
        let geometry = &source.info().geometry;
        assert_eq!(geometry.spacing, DVec3::new(2.0, 3.0, 5.0));
        assert_eq!(geometry.origin, DVec3::new(start(1) * 2.0, start(2) * 3.0, start(3) * 5.0));
    }
    for bad in [[1, 1, 3], [0, 2, 3], [1, 2, 4], [i32::MIN, 2, 3]] {
        assert!(plain([2, 2, 2], 2).ints(64, &bad).open(&[0; 32]).err().unwrap().contains("no valid MRC header"));
    }
    assert!(plain([2, 2, 2], 2).ints(64, &[0; 3]).open(&[0; 32]).is_ok());
}

#[test]
fn wrong_machine_stamps_are_told_by_the_numbers() {
    let field = Field { sizes: [3, 2, 2, 1, 1], voxel_type: VoxelType::I16 };
    for endian in [Endian::Little, Endian::Big] {
        let header = Written::new([3, 2, 2], 1, endian);
        let other: &[u8] = if endian == Endian::Big { b"\x44\x44\0\0" } else { b"\x11\x11\0\0" };
        for (stamp, words) in [(&[0; 4][..], "no machine stamp"), (other, "the other byte order")] {
            let source = header.clone().bytes(212, stamp).open(&field.bytes("zyx", endian == Endian::Big)).unwrap();
            assert_boxes(&*source, field);
            assert!(is_warned(&said(&source.info().notes), words), "{:?}", source.info().notes);
        }
        // Nothing but the sizes tells.
        let bare = Written::new([3, 2, 2], 0, endian).bytes(208, &[0; 8]).ints(64, &[0; 3]);
        let bytes = Field { voxel_type: VoxelType::I8, ..field };
        assert_boxes(&*bare.open(&bytes.bytes("zyx", false)).unwrap(), bytes);
    }
    assert!(plain([3, 2, 2], 1).bytes(212, &[0x44, 0x41, 0, 0]).open(&[0; 24]).unwrap().info().notes.is_empty());
}

#[test]
fn bytes_are_signed_unless_something_tells_otherwise() {
    let imod = |flags| plain([2, 1, 1], 0).ints(152, &[1146047817, flags]);
    for (header, voxel_type, words) in [
        (plain([2, 1, 1], 0), VoxelType::I8, "note: Bytes (mode 0) are signed"),
        (imod(1), VoxelType::I8, ""),
        (imod(0), VoxelType::U8, "note: Bytes are unsigned, by IMOD's flag"),
        (plain([2, 1, 1], 0).floats(76, &[0.0, 200.0]), VoxelType::U8, "warning: Bytes (mode 0) are read as unsigned"),
        (plain([2, 1, 1], 0).floats(76, &[0.0, 127.0]), VoxelType::I8, "are signed"),
        (plain([2, 1, 1], 0).floats(76, &[-5.0, 200.0]), VoxelType::I8, "are signed"),
    ] {
        let source = header.open(&[1, 200]).unwrap();
        assert_eq!(source.info().voxel_type, voxel_type);
        assert!(said(&source.info().notes).contains(words), "{:?}", source.info().notes);
    }
    assert!(
        imod(16).open(&[1, 200]).err().unwrap().contains("two 4-bit numbers in a byte (IMOD's flag) is not supported")
    );
}

#[test]
fn the_origin_counts_before_the_first_indices() {
    let header = plain([2, 2, 2], 0).floats(40, &[4.0, 6.0, 8.0]);
    let origin = |header: &Written| {
        let info = header.open(&[0; 8]).unwrap().info().clone();
        (info.geometry.origin, said(&info.notes))
    };
    assert_eq!(origin(&header.clone().ints(16, &[1, -2, 3])).0, DVec3::new(2.0, -6.0, 12.0));
    let both = header.clone().ints(16, &[1, -2, 3]).floats(196, &[5.0, 0.0, 0.5]);
    let (at, said) = origin(&both);
    assert_eq!(at, DVec3::new(5.0, 0.0, 0.5));
    assert!(is_warned(&said, "two positions of the first voxel"), "{said}");
    let (at, said) = origin(&header.clone().ints(16, &[1, -2, 3]).floats(196, &[2.0, -6.0, 12.0]));
    assert!(at == DVec3::new(2.0, -6.0, 12.0) && !said.contains("two positions"), "{said}");
    assert!(is_warned(&origin(&header.clone().floats(196, &[f32::NAN, 0.0, 0.0])).1, "no position"));
    let imod = header.clone().floats(196, &[5.0, 0.0, 0.0]).ints(152, &[1146047817, 1]);
    assert!(is_warned(&origin(&imod).1, "opposite sign"));
    assert!(!origin(&imod.ints(156, &[5])).1.contains("opposite sign"));
}

#[test]
fn without_a_cell_the_volume_is_uncalibrated() {
    let info = |header: Written| header.open(&[0; 8]).unwrap().info().clone();
    let none = info(plain([2, 2, 2], 0).floats(40, &[0.0; 3]).floats(196, &[3.0, 0.0, 0.0]));
    assert!(!none.calibrated && none.geometry.unit.is_none() && none.geometry.origin == DVec3::ZERO);
    assert!(said(&none.notes).contains("position is left out"));
    let image = plain([4, 2, 1], 0).floats(40, &[8.0, 6.0, 0.0]).open(&[0; 8]).unwrap().info().clone();
    assert!(image.calibrated && image.geometry.spacing == DVec3::new(2.0, 3.0, 2.0));
    assert!(said(&image.notes).contains("no depth in the header"));
    for header in [
        plain([2, 2, 2], 0).floats(40, &[1.0, 0.0, 1.0]),
        plain([2, 2, 2], 0).floats(40, &[1.0, 1.0, 0.0]),
        plain([2, 2, 2], 0).floats(40, &[1.0, -1.0, 1.0]),
        plain([2, 2, 2], 0).floats(40, &[1.0, f32::NAN, 1.0]),
        plain([2, 2, 2], 0).ints(28, &[2, 0, 2]),
        plain([2, 2, 2], 0).ints(28, &[2, 2, -2]),
    ] {
        let none = info(header);
        assert!(!none.calibrated && is_warned(&said(&none.notes), "gives no voxel size"), "{:?}", none.notes);
    }
}

#[test]
fn cells_that_are_not_right_are_sheared() {
    let header = plain([2, 2, 2], 0).floats(40, &[4.0, 6.0, 8.0]).ints(16, &[1, 1, 0]);
    let info = |angles: &[f32; 3]| header.clone().floats(52, angles).open(&[0; 8]).unwrap().info().clone();
    let hexagonal = info(&[90.0, 90.0, 120.0]);
    let rows = hexagonal.orientation.unwrap().rows();
    let half = 3f64.sqrt() / 2.0;
    let expected = [[2.0, -1.5, 0.0, 0.5], [0.0, 3.0 * half, 0.0, 3.0 * half], [0.0, 0.0, 4.0, 0.0]];
    for (found, expected) in rows.iter().flatten().zip(expected.iter().flatten()) {
        assert!((found - expected).abs() < 1e-9, "{rows:?}");
    }
    assert!(is_warned(&said(&hexagonal.notes), "sheared by a matrix"));
    assert_eq!(hexagonal.geometry.spacing, DVec3::new(2.0, 3.0, 4.0));
    // Lengths are kept whatever the angles.
    let orientation = info(&[80.0, 100.0, 70.0]).orientation.unwrap();
    for (axis, length) in [2.0, 3.0, 4.0].into_iter().enumerate() {
        assert!((orientation.step(axis).length() - length).abs() < 1e-9);
    }
    let cosine = orientation.step(1).dot(orientation.step(2)) / 12.0;
    assert!((cosine - 80f64.to_radians().cos()).abs() < 1e-9);
    for right in [[0.0; 3], [90.0, 90.00002, 90.0]] {
        assert!(info(&right).orientation.is_none() && !said(&info(&right).notes).contains("angles"));
    }
    for bad in [[10.0, 20.0, 120.0], [90.0, 0.0, 90.0], [90.0, f32::NAN, 90.0], [180.0, 90.0, 90.0]] {
        let info = info(&bad);
        assert!(info.orientation.is_none() && is_warned(&said(&info.notes), "right angles are taken"), "{bad:?}");
    }
}

#[test]
fn stacks_are_of_images_or_of_volumes() {
    let field = Field { sizes: [3, 2, 6, 1, 1], voxel_type: VoxelType::I16 };
    let images = plain([3, 2, 6], 1).ints(88, &[0]).ints(36, &[1]).floats(48, &[2.5]);
    let source = images.open(&field.bytes("zyx", false)).unwrap();
    assert_boxes(&*source, field);
    assert!(said(&source.info().notes).contains("note: A stack of images"));
    assert_eq!(source.info().geometry.spacing.z, 2.5);
    let field = Field { sizes: [3, 2, 2, 1, 3], ..field };
    let volumes = plain([3, 2, 6], 1).ints(88, &[401]).ints(36, &[2]).floats(48, &[5.0]);
    let source = volumes.open(&field.bytes("tzyx", false)).unwrap();
    assert_boxes(&*source, field);
    assert_eq!(source.info().geometry.spacing.z, 2.5);
    for depth in [0, -1, 4, 7] {
        let message = volumes.clone().ints(36, &[depth]).open(&[0; 72]).err().unwrap();
        assert!(message.contains(&format!("MZ says {depth}")), "{message}");
    }
    assert!(volumes.ints(64, &[3, 2, 1]).open(&[0; 72]).err().unwrap().contains("(MAPC, MAPR, MAPS) is not supported"));
}

#[test]
fn extended_headers_are_skipped_and_cut_files_refused() {
    let field = Field { sizes: [3, 2, 2, 1, 1], voxel_type: VoxelType::I16 };
    let header = plain([3, 2, 2], 1).ints(92, &[160]);
    let body = [vec![7; 160], field.bytes("zyx", false)].concat();
    assert_boxes(&*header.open(&body).unwrap(), field);
    let message = header.open(&body[..170]).err().unwrap();
    assert!(message.contains("cut short") && message.contains("implies 1208 bytes") && message.contains("found 1194"));
    let longer = header.open(&[&body[..], &[1, 2]].concat()).unwrap();
    assert!(is_warned(&said(&longer.info().notes), "2 bytes after the voxels"));
    assert!(header.clone().ints(92, &[i32::MAX]).open(&body).err().unwrap().contains("cut short"));
    assert!(header.ints(92, &[-1]).open(&body).err().unwrap().contains("-1 bytes of extended header"));
    let huge = plain([i32::MAX; 3], 4).open(&[0; 8]).err().unwrap();
    assert!(huge.contains("2^63"), "{huge}");
    assert!(plain([2, 0, 2], 2).open(&[0; 8]).err().unwrap().contains("[2, 0, 2] columns"));
    let (_folder, path) = temp_file("a.mrc", b"MRC?");
    assert!(super::open(&path, &OpenOptions::default()).err().unwrap().to_string().contains("found 4"));
    for (mode, words) in [(5, "mode 5"), (7, "mode 7")] {
        let message = plain([2, 2, 2], mode).open(&[0; 64]).err().unwrap();
        assert!(message.contains(&format!("{words} is not supported; write it again in mode")), "{message}");
    }
    let skewed = plain([2, 2, 2], 2).ints(96, &[1]).floats(100, &[1.0, 0.0, 0.0, 0.0, 1.0]).open(&[0; 32]).unwrap();
    assert!(is_warned(&said(&skewed.info().notes), "LSKFLG 1"));
}

#[test]
fn files_are_found_by_their_bytes_first() {
    let field = Field { sizes: [3, 2, 2, 1, 1], voxel_type: VoxelType::I16 };
    let file = plain([3, 2, 2], 1).with(&field.bytes("zyx", false));
    let open = |name: &str, bytes: &[u8]| open_in(temp_file(name, bytes), &OpenOptions::default());
    for name in ["a.mrc", "a.xyz", "a.img", "a.dat", "a.nii"] {
        assert_boxes(&*open(name, &file).unwrap(), field);
    }
    for name in ["a.mrc.gz", "a.map.gz", "a.xyz", "a.gz"] {
        let source = open(name, &gzip(&file)).unwrap();
        assert_boxes(&*source, field);
        assert!(said(&source.info().notes).contains("scratch"));
    }
    // 2 or 8 columns look like a group of DICOM.
    for columns in [2, 8] {
        assert_eq!(open("a.mrc", &plain([columns, 1, 1], 0).with(&[0; 8])).unwrap().info().extent.x, columns as u32);
    }
    // Without magic bytes by names, if the header makes sense.
    let bare = plain([3, 2, 2], 1).bytes(208, &[0; 8]).with(&field.bytes("zyx", false));
    for name in ["a.mrc", "a.mrcs", "a.map", "a.ccp4", "a.rec", "a.st", "A.ALI", "a.rec.gz"] {
        let bytes = if name.ends_with("gz") { gzip(&bare) } else { bare.clone() };
        assert_boxes(&*open(name, &bytes).unwrap(), field);
    }
    assert!(open("a.xyz", &bare).err().unwrap().contains("not a supported format"));
    assert!(open("a.map", &[7; 2000]).err().unwrap().contains("not a supported format"));
    assert!(open("a.mrc", &[7; 2000]).err().unwrap().contains("no valid MRC header"));
    let mut damaged = file.clone();
    damaged[..4].copy_from_slice(&[0; 4]);
    assert!(open("a.xyz", &damaged).err().unwrap().contains("no valid MRC header"));
    assert!(open("a.mrc.bz2", b"BZh91AY").err().unwrap().contains("a bzip2 file"));
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    /// Damage leads to an error or wrong voxels, never to a panic.
    #[test]
    fn damaged_headers_do_not_panic(
        damage in prop::collection::vec((0..240usize, any::<u8>()), 1..6),
        mode in prop::sample::select(vec![0, 1, 2, 3, 4, 6, 12, 16, 101]),
        big in any::<bool>(),
        packed in any::<bool>(),
    ) {
        let mut bytes = Written::new([3, 2, 4], mode, if big { Endian::Big } else { Endian::Little }).with(&[9; 200]);
        for (place, value) in damage {
            bytes[place] = value;
        }
        let (_folder, path) = temp_file("a.mrc", &if packed { gzip(&bytes) } else { bytes });
        if let Ok(source) = crate::open(&[path], &OpenOptions::default()) {
            let full = source.info().extent.full_box();
            let mut out = vec![0; full.extent().volume() as usize * source.info().voxel_type.bytes()];
            source.read_box(0, 0, full, &mut out).unwrap();
        }
    }
}
