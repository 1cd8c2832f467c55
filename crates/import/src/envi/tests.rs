use crate::element::Endian;
use crate::options::OpenOptions;
use crate::testing::{Field, Opened, assert_boxes, is_warned, open_in, said, temp_file};
use brickyard_volume::VoxelType;
use glam::DVec3;
use proptest::prelude::*;

/// A header of 4 samples, 3 lines and 2 bands, with further lines.
fn header(data_type: u32, interleave: &str, more: &str) -> String {
    format!(
        "ENVI\ndescription = {{\n  a = b\n  of two lines}}\nsamples = 4\nLines   = 3\nbands = 2\nheader offset = 0\nfile type = \
         ENVI Standard\ndata type = {data_type}\ninterleave = {interleave}\nbyte order = 0\n{more}\n"
    )
}

/// Opens a header with a raw file beside it.
fn open(header: &str, raw: &str, body: &[u8]) -> Result<Opened, String> {
    let (folder, path) = temp_file("a.hdr", header.as_bytes());
    std::fs::write(path.with_file_name(raw), body).unwrap();
    open_in((folder, path), &OpenOptions { allow_lossy: true, ..OpenOptions::default() })
}

#[test]
fn every_type_order_and_interleave_gives_the_bytes_written() {
    use VoxelType::*;
    for (code, voxel_type, channels) in
        [(1, U8, 1), (2, I16, 1), (3, I32, 1), (4, F32, 1), (6, F32, 2), (12, U16, 1), (13, U32, 1)]
    {
        for (interleave, axes) in [("bsq", "zyxc"), ("BIL", "yzxc"), ("bip", "yxzc")] {
            for endian in [Endian::Little, Endian::Big] {
                let field = Field { sizes: [4, 3, 2, channels, 1], voxel_type };
                let order = if endian == Endian::Big { "byte order = 1" } else { "" };
                let body = field.bytes(axes, endian == Endian::Big);
                let source = open(&header(code, interleave, order), "a", &body).unwrap();
                assert_boxes(&*source, field);
                assert_eq!(source.info().channel_looks.len(), if channels == 2 { 2 } else { 0 });
            }
        }
    }
    for (code, bytes) in [(5, 8), (9, 16), (14, 8), (15, 8)] {
        assert!(open(&header(code, "bsq", ""), "a", &vec![0; 24 * bytes]).is_ok());
    }
}

#[test]
fn the_raw_file_is_that_of_the_name() {
    let field = Field { sizes: [4, 3, 2, 1, 1], voxel_type: VoxelType::U8 };
    for raw in ["a", "a.img", "a.dat", "a.raw", "a.bsq", "a.bil", "a.BIP", "a.bin"] {
        assert_boxes(&*open(&header(1, "bsq", ""), raw, &field.bytes("zyx", false)).unwrap(), field);
    }
    let (folder, path) = temp_file("b.dat.hdr", header(1, "bsq", "").as_bytes());
    let open = |path: &std::path::Path| crate::open(&[path.to_owned()], &OpenOptions::default());
    assert!(open(&path).err().unwrap().to_string().contains("its raw file is missing: expected b.dat"));
    std::fs::write(folder.path().join("b.dat"), field.bytes("zyx", false)).unwrap();
    assert_boxes(&*open(&path).unwrap(), field);
    std::fs::write(folder.path().join("b.dat.img"), field.bytes("zyx", false)).unwrap();
    assert!(open(&path).err().unwrap().to_string().contains("may describe b.dat or b.dat.img"));
    std::fs::rename(&path, path.with_file_name("b.txt")).unwrap();
    assert!(open(&path.with_file_name("b.txt")).err().unwrap().to_string().contains("rename it"));
}

#[test]
fn sizes_and_the_ignored_value_are_kept_and_the_rest_is_noted() {
    let map = "map info = {UTM, 1.000, 1.000, 620105.0, 4840605.0, 30.0, 15.0, 17, North, WGS-84, units=Meters}";
    let more = format!("{map}\ndata ignore value = -9999\nwavelength = {{\n 0.4,\n 0.5}}\ndata gain values = {{2, 2}}");
    let source = open(&header(2, "bsq", &more), "a", &[0; 48]).unwrap();
    let (info, said) = (source.info(), said(&source.info().notes));
    assert_eq!((info.geometry.spacing, info.geometry.unit.as_deref()), (DVec3::new(30.0, 15.0, 1.0), Some("meter")));
    assert!(info.calibrated && info.nodata == Some(-9999.0));
    assert!(said.contains("The 2 bands are the slices along z, 1 apart; their wavelengths are left out"), "{said}");
    assert!(is_warned(&said, "'data gain values' is not applied"), "{said}");
    let spacing = |more: &str| {
        let source = open(&header(1, "bsq", more), "a", &[0; 24]).unwrap();
        source.info().calibrated.then(|| source.info().geometry.spacing.x)
    };
    assert_eq!(spacing("pixel size = {0.5, 0.5, units=Meters}"), Some(0.5));
    assert_eq!(spacing("map info = {UTM, 1, 1, 0, 0, 2, 2, 17, North}"), Some(2.0));
    for none in [
        "map info = {Geographic Lat/Lon, 1, 1, 8.5, 47.2, 0.01, 0.01, WGS-84, units=Degrees}",
        "map info = {Arbitrary, 1, 1, 0, 0, 1, 1}",
        "pixel size = {0, 1, units=Meters}",
        "map info = {UTM}",
        "",
    ] {
        assert_eq!(spacing(none), None, "{none}");
    }
}

#[test]
fn what_is_missing_or_unknown_is_refused() {
    let refusal = |header: &str| open(header, "a", &[0; 24]).err().unwrap();
    for (from, to, words) in [
        ("samples = 4", "", "has no 'samples'"),
        ("data type = 1", "", "has no 'data type'"),
        ("samples = 4", "samples = 0", "'samples' is '0', expected a count above 0"),
        ("samples = 4", "samples = four", "'samples' is 'four'"),
        ("samples = 4", "samples = 99999999999", "expected a count above 0"),
        ("interleave = bsq", "", "'interleave' is '', expected bsq, bil or bip"),
        ("byte order = 0", "byte order = 2", "'byte order' is '2'"),
        ("data type = 1", "data type = 7", "data type 7 is not supported"),
        ("data type = 1", "data type = 2", "cut short"),
        ("header offset = 0", "header offset = -1", "'header offset' is '-1'"),
        ("header offset = 0", "header offset = 7", "cut short"),
        ("file type = ENVI Standard", "file type = TIFF", "the file type 'TIFF' is not supported"),
        ("bands = 2", "bands = 2\nmajor frame offsets = {4, 0}", "'major frame offsets' {4, 0} is not supported"),
        ("bands = 2", "bands = 2\ndata ignore value = none", "expected a number"),
        ("bands = 2", "bands = 2\nband names = {", "the braces of 'band names' do not end"),
    ] {
        let text = header(1, "bsq", "").replace(from, to);
        assert!(refusal(&text).contains(words), "{to}: {}", refusal(&text));
    }
    let no_order = header(2, "bsq", "").replace("byte order = 0", "");
    assert!(refusal(&no_order).contains("'byte order' is ''"));
    let offset = header(1, "bsq", "").replace("header offset = 0", "header offset = 3");
    let source = open(&offset, "a", &[[9, 9, 9].to_vec(), vec![5; 24]].concat()).unwrap();
    let mut out = [0; 24];
    source.read_box(0, 0, source.info().extent.full_box(), &mut out).unwrap();
    assert_eq!(out, [5; 24]);
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    /// Damage leads to an error or wrong voxels, never to a panic.
    #[test]
    fn damaged_headers_do_not_panic(
        damage in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6),
    ) {
        let more = "map info = {UTM, 1, 1, 620105.0, 4840605.0, 30.0, 15.0, 17, North, units=Meters}\ndata ignore value = 1";
        let mut bytes = header(9, "bip", more).into_bytes();
        for (place, value) in damage {
            let place = place.index(bytes.len() - 4) + 4;
            bytes[place] = value;
        }
        let (_folder, path) = temp_file("a.hdr", &bytes);
        std::fs::write(path.with_file_name("a.img"), [9; 400]).unwrap();
        let told = OpenOptions { allow_lossy: true, ..OpenOptions::default() };
        if let Ok(source) = crate::open(&[path], &told) {
            let full = source.info().extent.full_box();
            let mut out = vec![0; full.extent().volume() as usize * source.info().voxel_type.bytes()];
            source.read_box(0, 0, full, &mut out).unwrap();
        }
    }
}
