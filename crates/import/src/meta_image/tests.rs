//! MetaImages made by hand, read as ITK reads them.

use crate::open::open as open_any;
use crate::options::OpenOptions;
use crate::source::{Source, SourceInfo};
use crate::testing::{Field, Opened, assert_boxes, is_warned, open_in, said, temp_file};
use brickyard_volume::VoxelType;
use glam::DVec3;
use proptest::prelude::*;
use std::io::Write;
use std::path::{Path, PathBuf};

fn options() -> OpenOptions {
    OpenOptions::default()
}

fn zlib(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::fast());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

/// A file with these keys, and data behind them.
fn mha(keys: &str, data: &[u8]) -> Vec<u8> {
    [keys.as_bytes(), b"ElementDataFile = LOCAL\n", data].concat()
}

fn opened(name: &str, bytes: &[u8]) -> Opened {
    open_in(temp_file(name, bytes), &options()).unwrap()
}

fn refusal(bytes: &[u8]) -> String {
    open_in(temp_file("a.mha", bytes), &options()).err().unwrap()
}

const BYTES: &str = "ObjectType = Image\nNDims = 3\nBinaryData = True\nDimSize = 2 3 4\nElementType = MET_UCHAR\n";

fn placed(keys: &str) -> SourceInfo {
    opened("a.mha", &mha(&format!("{BYTES}{keys}"), &[0; 24])).info().clone()
}

#[test]
fn every_type_order_and_compression_gives_the_values_written() {
    for (name, voxel_type) in [
        ("MET_UCHAR", VoxelType::U8),
        ("MET_CHAR", VoxelType::I8),
        ("MET_USHORT", VoxelType::U16),
        ("MET_SHORT_ARRAY", VoxelType::I16),
        ("MET_UINT", VoxelType::U32),
        ("MET_ULONG", VoxelType::U32),
        ("MET_INT", VoxelType::I32),
        ("MET_LONG", VoxelType::I32),
        ("MET_FLOAT", VoxelType::F32),
        ("MET_FLOAT_ARRAY", VoxelType::F32),
    ] {
        for (big, packed, channels) in (0..12).map(|i| (i & 1 > 0, i / 4, 1 + (i & 2))) {
            let field = Field { sizes: [7, 5, 3, channels, 1], voxel_type };
            let data = field.bytes("zyxc", big);
            let data = [data.clone(), zlib(&data), gzip(&data)][packed as usize].clone();
            let size = if packed > 0 { format!("CompressedDataSize = {}\n", data.len()) } else { String::new() };
            let order = if channels > 1 { "ElementByteOrderMSB" } else { "BinaryDataByteOrderMSB" };
            let [is_big, is_packed] = [big, packed > 0].map(|is| if is { "True" } else { "False" });
            let keys = format!(
                "NDims = 3\nBinaryData = True\n{order} = {is_big}\nCompressedData = {is_packed}\n{size}DimSize = 7 5 3\n\
                 ElementNumberOfChannels = {channels}\nElementType = {name}\n"
            );
            let source = opened("a.any", &mha(&keys, &data));
            assert_boxes(&*source, field);
            assert_eq!(source.info().notes.len(), usize::from(packed > 0));
        }
    }
}

#[test]
fn carriage_returns_and_colons_are_read() {
    let field = Field { sizes: [2, 3, 4, 1, 1], voxel_type: VoxelType::U8 };
    let head = format!("{BYTES}ElementDataFile = Local\n").replace(" = ", ": ").replace('\n', "\r\n");
    assert_boxes(&*opened("a.mhd", &[head.as_bytes(), &field.bytes("zyx", false)].concat()), field);
}

#[test]
fn two_dimensions_are_a_slice_and_four_are_steps() {
    let field = Field { sizes: [4, 3, 1, 1, 1], voxel_type: VoxelType::U8 };
    let keys = "ObjectType = Image\nNDims = 2\nDimSize = 4 3\nElementSpacing = 2 3\nTransformMatrix = 0 1 1 0\nOffset = 5 6\n\
                ElementType = MET_UCHAR\n";
    let source = opened("a.mha", &mha(keys, &field.bytes("yx", false)));
    assert_boxes(&*source, field);
    assert_eq!(source.info().geometry.spacing, DVec3::new(2.0, 3.0, 1.0));
    let rows = [[0.0, -3.0, 0.0, -5.0], [-2.0, 0.0, 0.0, -6.0], [0.0, 0.0, 1.0, 0.0]];
    assert_eq!(source.info().orientation.unwrap().rows().map(|row| row.map(|n| n + 0.0)), rows);
    let field = Field { sizes: [4, 3, 2, 2, 3], voxel_type: VoxelType::U8 };
    let keys = "ObjectType = Image\nNDims = 4\nDimSize = 4 3 2 3\nElementSpacing = 1 1 1 0.5\nOffset = 0 0 0 7\n\
                ElementNumberOfChannels = 2\nElementType = MET_UCHAR\n";
    let source = opened("a.mha", &mha(keys, &field.bytes("tzyxc", false)));
    assert_boxes(&*source, field);
    let time = source.info().time.clone().unwrap();
    assert_eq!((time.start, time.step, time.unit), (7.0, 0.5, None));
    assert!(said(&source.info().notes).contains("fourth dimension"));
}

#[test]
fn rows_of_the_matrix_are_directions_of_axes() {
    for [matrix, offset] in [["TransformMatrix", "Offset"], ["Rotation", "Position"], ["Orientation", "Origin"]] {
        let info = placed(&format!(
            "ElementSpacing = 1 2 3\n{matrix} = 0 1 0 -1 0 0 0 0 1\n{offset} = 7 8 9\nDistanceUnits = um\n"
        ));
        // The first axis points along y of LPS, which is against y of RAS.
        let rows = [[0.0, 2.0, 0.0, -7.0], [-1.0, 0.0, 0.0, -8.0], [0.0, 0.0, 3.0, 9.0]];
        assert_eq!(info.orientation.unwrap().rows().map(|row| row.map(|n| n + 0.0)), rows);
        assert_eq!((info.geometry.spacing, info.calibrated), (DVec3::new(1.0, 2.0, 3.0), true));
        assert_eq!(info.geometry.unit.as_deref(), Some("micrometer"));
    }
    let turned = placed("ElementSpacing = -1 2 3\n");
    assert_eq!(turned.geometry.spacing, DVec3::new(1.0, 2.0, 3.0));
    assert_eq!(turned.orientation.unwrap().rows()[0][0], 1.0);
}

#[test]
fn sizes_of_elements_stand_in_for_spacings() {
    assert_eq!(placed("ElementSize = 2 3 4\n").geometry.spacing, DVec3::new(2.0, 3.0, 4.0));
    assert_eq!(placed("ElementSize = 2 3 4\nElementSpacing = 1 1 2\n").geometry.spacing, DVec3::new(1.0, 1.0, 2.0));
    let none = placed("");
    assert!(!none.calibrated && none.orientation.is_none() && none.notes.is_empty());
    let zero = placed("ElementSpacing = 1 0 2\n");
    assert!(!zero.calibrated && is_warned(&said(&zero.notes), "has a 0"));
}

#[test]
fn contradictions_and_defaults_are_told() {
    let info = placed("TransformMatrix = 1 0 0 0 1 0 0 0 1\nAnatomicalOrientation = RAI\n");
    assert_eq!(info.notes, []);
    let info = placed("TransformMatrix = 1 0 0 0 1 0 0 0 1\nAnatomicalOrientation = LPI\nCenterOfRotation = 1 0 0\n");
    let said = said(&info.notes);
    assert!(is_warned(&said, "AnatomicalOrientation LPI") && is_warned(&said, "CenterOfRotation"), "{said}");
    let sequence = placed("Kinds = domain domain list\n");
    assert!(is_warned(&crate::testing::said(&sequence.notes), "Kinds = domain domain list"));
    let keys = BYTES.replace("UCHAR", "SHORT").replace("DimSize = 2", "DimSize = 1");
    let info = opened("a.mha", &mha(&keys, &[0; 24])).info().clone();
    assert!(is_warned(&crate::testing::said(&info.notes), "little-endian"));
}

#[test]
fn intensities_are_scaled() {
    let keys = "NDims = 2\nDimSize = 2 1\nElementToIntensityFunctionSlope = 0.5\nElementToIntensityFunctionOffset = -3\nElementType = MET_UCHAR\n";
    let source = opened("a.mha", &mha(keys, &[1, 255]));
    let mut out = [0; 8];
    source.read_box(0, 0, source.info().extent.full_box(), &mut out).unwrap();
    assert_eq!(out, [(-2.5f32).to_le_bytes(), 124.5f32.to_le_bytes()].concat()[..]);
    assert!(said(&source.info().notes).contains("scaled by 0.5"));
}

/// Writes data files of a field's slices beside a header.
fn in_files(header: &str) -> (tempfile::TempDir, PathBuf, Field) {
    let field = Field { sizes: [3, 2, 4, 1, 1], voxel_type: VoxelType::U16 };
    let keys =
        "ObjectType = Image\nNDims = 3\nDimSize = 3 2 4\nBinaryDataByteOrderMSB = False\nElementType = MET_USHORT\n";
    let (folder, path) = temp_file("a.mhd", format!("{keys}{header}\n").as_bytes());
    let all = field.bytes("zyx", false);
    for (i, slice) in all.chunks(12).enumerate() {
        std::fs::write(folder.path().join(format!("s0{i}.raw")), [b"xx", slice].concat()).unwrap();
    }
    std::fs::write(folder.path().join("all 1.raw"), [b"xx", &all[..]].concat()).unwrap();
    std::fs::write(folder.path().join("all.zraw"), zlib(&all)).unwrap();
    (folder, path, field)
}

fn read(path: &Path) -> Result<Box<dyn Source>, String> {
    open_any(&[path.to_owned()], &options()).map_err(|error| error.to_string())
}

#[test]
fn data_lie_in_one_file_or_in_several() {
    for header in [
        "HeaderSize = 2\nElementDataFile = all 1.raw",
        "HeaderSize = -1\nElementDataFile = all 1.raw",
        "CompressedData = True\nElementDataFile = all.zraw",
        "HeaderSize = 2\nElementDataFile = s%02d.raw 0 3 1",
        "HeaderSize = -1\nElementDataFile = s%02d.raw 0 3",
        "HeaderSize = 2\nElementDataFile = LIST\ns00.raw\ns01.raw\n\ns02.raw\r\ns03.raw",
        "HeaderSize = 2\nElementDataFile = LIST 2\ns00.raw\ns01.raw\ns02.raw\ns03.raw",
        "HeaderSize = 2\nElementDataFile = LIST 3D\nall 1.raw",
    ] {
        let (_folder, path, field) = in_files(header);
        assert_boxes(&*read(&path).unwrap(), field);
    }
    for (header, words) in [
        ("ElementDataFile = all.raw", "all.raw is missing"),
        ("ElementDataFile = .", "no regular file"),
        ("ElementDataFile = s%02d.raw 0 4 1", "5 data files of 2 axes"),
        ("ElementDataFile = s%02d.raw 1 4 1", "s04.raw is missing"),
        ("ElementDataFile = s%02d.raw 3 0 1", "no valid 'ElementDataFile'"),
        ("ElementDataFile = LIST 9", "no valid 'ElementDataFile'"),
        ("ElementDataFile = LIST\ns00.raw", "1 data file of 2 axes"),
        ("HeaderSize = 3\nElementDataFile = s%02d.raw 0 3 1", "1 missing"),
        ("CompressedData = True\nElementDataFile = s%02d.raw 0 3 1", "CompressedData in several data files"),
        ("CompressedData = True\nHeaderSize = -1\nElementDataFile = all.zraw", "HeaderSize = -1"),
        ("HeaderSize = 3\nElementDataFile = all 1.raw", "1 missing"),
    ] {
        let (_folder, path, _) = in_files(header);
        let message = read(&path).err().unwrap();
        assert!(message.contains(words), "{message}\n{words}");
    }
}

#[test]
fn what_is_not_understood_is_refused_by_its_name() {
    let with = |from: &str, to: &str| refusal(&mha(&BYTES.replace(from, to), &[0; 24]));
    let plus = |keys: &str| refusal(&mha(&format!("{BYTES}{keys}"), &[0; 24]));
    for (message, words) in [
        (with("Image", "Tube"), "the ObjectType Tube is not supported"),
        (with("BinaryData = True", "BinaryData = False"), "BinaryData = False is not supported"),
        (with("MET_UCHAR", "MET_STRING"), "ElementType MET_STRING"),
        (with("NDims = 3", "NDims = 5"), "NDims = 5 (2 to 4 are read)"),
        (with("NDims = 3\n", ""), "lacks the key 'NDims'"),
        (with("2 3 4", "2 3"), "no valid 'DimSize'"),
        (with("2 3 4", "2 3 0"), "no valid 'DimSize'"),
        (with("2 3 4", "2 3 5"), "cut short"),
        (with("2 3 4", "4294967295 4294967295 4294967295"), "2^63"),
        (plus("ElementNumberOfChannels = 0\n"), "no valid 'ElementNumberOfChannels'"),
        (plus("TransformMatrix = 1 0 0 0 1 0 0 0\n"), "no valid 'TransformMatrix'"),
        (plus("Offset = 1 2 3\nPosition = 1 2 4\n"), "'Offset' and 'Position' differ"),
        (plus("ElementByteOrderMSB = True\nBinaryDataByteOrderMSB = False\n"), "differ"),
        (plus("ElementSpacing = 1 x 2\n"), "no valid 'ElementSpacing'"),
        (plus("ElementToIntensityFunctionSlope = 0\n"), "no valid 'ElementToIntensityFunctionSlope'"),
        (plus("CompressedData = perhaps\n"), "no valid 'CompressedData'"),
        (plus("CompressedData = True\n"), "damaged"),
        (plus("HeaderSize = -2\n"), "HeaderSize = -2"),
        (plus("NDims = 3\n"), "the key 'NDims' twice"),
        (plus("what is this\n"), "a line without a key, 'what is this'"),
        (refusal(BYTES.as_bytes()), "lacks the key 'ElementDataFile'"),
        (refusal(&"a\n".repeat(2).into_bytes()), "a line without a key"),
    ] {
        assert!(message.contains(words), "{message}\n{words}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    /// Damage leads to an error or other voxels, never to a panic.
    #[test]
    fn damaged_headers_do_not_panic(
        damage in prop::collection::vec((any::<prop::sample::Index>(), prop_oneof![any::<u8>(), prop::sample::select(&b"0123456789-=% \nLTFd."[..])]), 1..8),
        cut in prop::option::of(any::<prop::sample::Index>()),
        kind in 0usize..3,
    ) {
        let keys = [
            "ObjectType = Image\nNDims = 4\nDimSize = 2 3 2 2\nElementSpacing = 1 2 3 4\nTransformMatrix = 1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1\nOffset = 1 2 3 4\nElementNumberOfChannels = 2\nAnatomicalOrientation = RAI\nElementByteOrderMSB = True\nElementType = MET_SHORT\nElementDataFile = LOCAL\n",
            "NDims = 3\nDimSize = 2 3 4\nHeaderSize = -1\nDistanceUnits = mm\nElementType = MET_UCHAR\nElementDataFile = s%02d.raw 0 3 1\n",
            "NDims = 3\nDimSize = 2 3 4\nCompressedData = True\nElementToIntensityFunctionSlope = 2\nElementType = MET_UCHAR\nElementDataFile = LOCAL\n",
        ][kind];
        let data = if kind == 2 { zlib(&[7; 24]) } else { vec![7; 96] };
        let mut bytes = [keys.as_bytes(), &data].concat();
        let length = bytes.len();
        for (place, value) in damage {
            bytes[place.index(length)] = value;
        }
        bytes.truncate(cut.map_or(length, |cut| cut.index(length)).max(1));
        let (folder, path) = temp_file("a.mhd", &bytes);
        for i in 0..4 {
            std::fs::write(folder.path().join(format!("s0{i}.raw")), [i; 7]).unwrap();
        }
        let told = OpenOptions { allow_lossy: true, ..options() };
        if let Ok(source) = open_any(&[path], &told) {
            let full = source.info().extent.full_box();
            let mut out = vec![0; full.extent().volume() as usize * source.info().voxel_type.bytes()];
            source.read_box(source.info().times - 1, source.info().channels - 1, full, &mut out).unwrap();
        }
    }
}
