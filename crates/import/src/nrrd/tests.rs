//! NRRD files made by hand from the format's definition.

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

fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

/// A file of version 5 with these fields, and data behind an empty line.
fn nrrd(fields: &str, data: &[u8]) -> Vec<u8> {
    [b"NRRD0005\n", fields.as_bytes(), b"\n", data].concat()
}

fn opened(name: &str, bytes: &[u8]) -> Opened {
    open_in(temp_file(name, bytes), &options()).unwrap()
}

fn refusal(bytes: &[u8]) -> String {
    open_in(temp_file("a.nrrd", bytes), &options()).err().unwrap()
}

/// A description from fields of placement; 2 x 3 x 4 bytes unless they give sizes.
fn placed(fields: &str) -> SourceInfo {
    let sizes = if fields.contains("sizes:") { "" } else { "dimension: 3\nsizes: 2 3 4\n" };
    let bytes = nrrd(&format!("type: uchar\nencoding: raw\n{sizes}{fields}"), &[0; 24]);
    opened("a.nrrd", &bytes).info().clone()
}

const TYPES: [(&str, VoxelType); 7] = [
    ("uchar", VoxelType::U8),
    ("int8_t", VoxelType::I8),
    ("unsigned short int", VoxelType::U16),
    ("Short", VoxelType::I16),
    ("uint32", VoxelType::U32),
    ("signed int", VoxelType::I32),
    ("float", VoxelType::F32),
];

#[test]
fn every_type_order_and_encoding_gives_the_values_written() {
    for ((name, voxel_type), big, packed) in
        TYPES.into_iter().flat_map(|t| [(t, false, false), (t, true, false), (t, false, true), (t, true, true)])
    {
        let field = Field { sizes: [7, 5, 3, 1, 1], voxel_type };
        let (endian, encoding) = (if big { "big" } else { "little" }, if packed { "GZ" } else { "raw" });
        let fields = format!(
            "type: {name}\ndimension: 3\nsizes: 7 5 3\nendian: {endian}\nencoding: {encoding}\n# a: comment\nkey:=value\nhttp://key:=value\na: key:=value\na: kez:=value\n"
        );
        let data = field.bytes("zyx", big);
        let (one, two) = data.split_at(data.len() / 3);
        let data = if packed { [gzip(one), gzip(two)].concat() } else { data.clone() };
        // Any name will do, and so will any line ends.
        let source = opened("a.img", &nrrd(&fields, &data));
        assert_boxes(&*source, field);
        assert_eq!(source.info().notes.iter().any(|n| n.contains("scratch")), packed);
        let head = format!("NRRD0001\n{fields}\n").replace('\n', "\r\n");
        assert_boxes(&*opened("a.nrrd", &[head.as_bytes(), &data].concat()), field);
    }
}

#[test]
fn numbers_of_64_bits_are_narrowed_where_they_fit() {
    let fields = "type: long long\ndimension: 2\nsizes: 2 1\nendian: big\nencoding: raw\n";
    let data: Vec<u8> = [-7i64, 1 << 30].iter().flat_map(|n| n.to_be_bytes()).collect();
    let source = opened("a.nrrd", &nrrd(fields, &data));
    let mut out = [0; 8];
    source.read_box(0, 0, source.info().extent.full_box(), &mut out).unwrap();
    assert_eq!(out, [(-7i32).to_le_bytes(), (1i32 << 30).to_le_bytes()].concat()[..]);
    let double = fields.replace("long long", "double");
    let data: Vec<u8> = [0.1f64, 1e300].iter().flat_map(|n| n.to_be_bytes()).collect();
    assert!(refusal(&nrrd(&double, &data)).contains("`allow_lossy`"));
}

#[test]
fn kinds_name_channels_and_times_in_any_order() {
    let order_of = |kinds: &str| -> String {
        let letters = kinds.split(' ').scan(0, |space, kind| {
            let is_space = matches!(kind, "domain" | "space");
            *space += usize::from(is_space);
            Some(if is_space {
                ["x", "y", "z"][*space - 1]
            } else if kind == "time" {
                "t"
            } else {
                "c"
            })
        });
        letters.collect::<Vec<_>>().into_iter().rev().collect()
    };
    for kinds in [
        "3-vector domain space domain",
        "domain 3-vector domain domain",
        "domain domain domain RGB-color time",
        "time domain domain domain list",
        "domain domain time",
        "vector domain domain",
        "domain time",
    ] {
        let order = order_of(kinds);
        let size = |letter| match letter {
            _ if !order.contains(letter) => 1,
            'x' => 4,
            'c' => 3,
            't' => 2,
            _ => 5,
        };
        let field = Field { sizes: ['x', 'y', 'z', 'c', 't'].map(size), voxel_type: VoxelType::U16 };
        let sizes: Vec<String> = order.chars().rev().map(|letter| size(letter).to_string()).collect();
        let fields = format!(
            "type: ushort\ndimension: {}\nsizes: {}\nkinds: {kinds}\nendian: little\nencoding: raw\n",
            sizes.len(),
            sizes.join(" ")
        );
        let source = opened("a.nrrd", &nrrd(&fields, &field.bytes(&order, false)));
        assert_boxes(&*source, field);
    }
}

#[test]
fn components_have_the_names_of_their_kind() {
    let names = |kind: &str, count: u32| {
        let fields =
            format!("type: uchar\ndimension: 3\nsizes: {count} 2 1\nkinds: {kind} domain domain\nencoding: raw\n");
        let source = opened("a.nrrd", &nrrd(&fields, &vec![0; 2 * count as usize]));
        let names = source.info().channel_looks.iter().map(|look| look.name.clone().unwrap());
        (source.info().channels, names.collect::<Vec<_>>().join(","))
    };
    assert_eq!(names("RGB-color", 3), (3, "red,green,blue".into()));
    assert_eq!(names("RGBA-color", 4), (4, "red,green,blue,alpha".into()));
    assert_eq!(names("complex", 2), (2, "real,imaginary".into()));
    assert_eq!(names("vector", 2), (2, "x,y".into()));
    assert_eq!(names("covariant-vector", 3), (3, "x,y,z".into()));
    assert_eq!(names("vector", 5), (5, String::new()));
    assert_eq!(names("3D-symmetric-matrix", 6), (6, "xx,xy,xz,yy,yz,zz".into()));
    assert_eq!(names("3D-masked-symmetric-matrix", 7).1, "mask,xx,xy,xz,yy,yz,zz");
    assert_eq!(names("3D-matrix", 9).1, "xx,xy,xz,yx,yy,yz,zx,zy,zz");
    assert_eq!(names("list", 3), (3, String::new()));
    assert_eq!(names("scalar", 1).0, 1);
}

#[test]
fn spaces_of_patients_are_turned_to_right_front_and_head() {
    let directions =
        "space directions: (0,2,0) (1, 0, 0) (0,0,-3)\nspace origin: (10,20,30)\nspace units: \"mm\" \"mm\" \"mm\"\n";
    for (name, [x, y]) in [
        ("left-posterior-superior", [-1.0, -1.0]),
        ("LPS", [-1.0, -1.0]),
        ("right-anterior-superior", [1.0, 1.0]),
        ("RAS", [1.0, 1.0]),
        ("left-anterior-superior", [-1.0, 1.0]),
        ("las", [-1.0, 1.0]),
    ] {
        let info = placed(&format!("space: {name}\n{directions}"));
        let rows = [[0.0, x, 0.0, 10.0 * x], [2.0 * y, 0.0, 0.0, 20.0 * y], [0.0, 0.0, -3.0, 30.0]];
        assert_eq!(info.orientation.unwrap().rows(), rows, "{name}");
        assert_eq!((info.geometry.spacing, info.calibrated), (DVec3::new(2.0, 1.0, 3.0), true));
        assert_eq!(info.geometry.unit.as_deref(), Some("millimeter"));
    }
}

#[test]
fn other_spaces_keep_place_and_directions_but_no_patient() {
    let upright = "space directions: (1,0,0) (0,2,0) (0,0,3)\nspace origin: (1,2,3)\n";
    for space in ["space: scanner-xyz", "space: 3D-right-handed", "space dimension: 3"] {
        let info = placed(&format!("{space}\n{upright}"));
        assert_eq!((info.orientation, info.notes.len()), (None, 0));
        assert_eq!(
            (info.geometry.spacing, info.geometry.origin),
            (DVec3::new(1.0, 2.0, 3.0), DVec3::new(1.0, 2.0, 3.0))
        );
        let info = placed(&format!("{space}\nspace directions: (0,1,0) (1,0,0) (0.5,0,3)\n"));
        let rows = [[0.0, 1.0, 0.5, 0.0], [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 3.0, 0.0]];
        assert_eq!(info.orientation.unwrap().rows(), rows);
        assert!(is_warned(&said(&info.notes), "none of a patient's"), "{:?}", info.notes);
    }
}

#[test]
fn fewer_axes_in_space_lie_in_it() {
    let slice = placed(
        "dimension: 3\nsizes: 6 2 2\nkinds: list domain domain\nspace: RAS\nspace directions: none (0,2,0) (0,0,3)\nspace origin: (1,2,3)\n",
    );
    assert_eq!((slice.extent.to_array(), slice.channels), ([2, 2, 1], 6));
    assert_eq!(slice.orientation.unwrap().rows(), [[0.0, 0.0, 1.0, 1.0], [2.0, 0.0, 0.0, 2.0], [0.0, 3.0, 0.0, 3.0]]);
    assert_eq!(slice.geometry.spacing, DVec3::new(2.0, 3.0, 1.0));
    let flat =
        placed("dimension: 2\nsizes: 6 4\nspace dimension: 2\nspace directions: (2,0) (0,3)\nspace origin: (5,6)\n");
    assert_eq!((flat.geometry.spacing, flat.geometry.origin), (DVec3::new(2.0, 3.0, 1.0), DVec3::new(5.0, 6.0, 0.0)));
}

#[test]
fn axes_have_spacings_or_ends() {
    let geometry = |fields: &str| {
        let info = placed(fields);
        (info.geometry.spacing.to_array(), info.geometry.origin.to_array(), info.calibrated)
    };
    let ends = "axis mins: 0 10 20\naxis maxs: 4 16 28\n";
    assert_eq!(geometry(""), ([1.0; 3], [0.0; 3], false));
    assert_eq!(geometry("spacings: 0.5 2 3\n"), ([0.5, 2.0, 3.0], [0.0; 3], true));
    assert_eq!(geometry("spacings: 0.5 nan NaN\n"), ([0.5, 1.0, 1.0], [0.0; 3], false));
    // As ITK reads them.
    assert_eq!(geometry(ends), ([2.0, 2.0, 2.0], [1.0, 11.0, 21.0], true));
    assert_eq!(geometry(&format!("{ends}centers: cell cell cell\n")), ([2.0; 3], [1.0, 11.0, 21.0], true));
    let nodes = geometry(&format!("{ends}centerings: node node node\n"));
    assert_eq!(nodes, ([4.0, 3.0, 8.0 / 3.0], [0.0, 10.0, 20.0], true));
    assert_eq!(geometry("axis mins: 0 10 20\nspacings: 1 2 3\n"), ([1.0, 2.0, 3.0], [0.5, 11.0, 21.5], true));
    let turned = placed("spacings: -1 2 3\n");
    assert!(!turned.calibrated && is_warned(&said(&turned.notes), "must be positive"));
    let micro = placed("spacings: 1 2 3\nunits: \"um\" \"um\" \"um\"\n");
    assert_eq!(micro.geometry.unit.as_deref(), Some("micrometer"));
    let mixed = placed("spacings: 1 2 3\nunits: \"um\" \"um\" \"mm\"\n");
    assert!(mixed.calibrated && mixed.notes.is_empty(), "{:?}", mixed.notes);
    assert_eq!(
        (mixed.geometry.spacing, mixed.geometry.unit.as_deref()),
        (DVec3::new(1.0, 2.0, 3000.0), Some("micrometer"))
    );
    let map = placed("spacings: 1 2 3\nunits: \"degree\" \"degree\" \"hPa\"\nsample units: \"K\"\n");
    assert_eq!(
        (map.geometry.spacing, map.geometry.units_in_words().as_deref()),
        (DVec3::new(1.0, 2.0, 3.0), Some("degree, degree, hPa"))
    );
    assert_eq!(map.channel_looks[0].unit.as_deref(), Some("K"));
    let part = placed("spacings: 1 2 3\nunits: \"mm\" \"???\" \"\"\n");
    assert_eq!(part.geometry.axis_units, Some(["millimeter".into(), String::new(), String::new()]));
    assert!(is_warned(&said(&part.notes), "Some axes of space have no unit"));
    let space = placed(
        "space dimension: 3\nspace directions: (2,0,0) (0,2,0) (0,0,3)\nspace origin: (1,1,1)\nspace units: \"um\" \"um\" \"mm\"\n",
    );
    assert_eq!(
        (space.geometry.spacing, space.geometry.origin),
        (DVec3::new(2.0, 2.0, 3000.0), DVec3::new(1.0, 1.0, 1000.0))
    );
    let unlike =
        placed("space dimension: 3\nspace directions: (2,0,0) (0,2,0) (0,0,3)\nspace units: \"um\" \"s\" \"mm\"\n");
    assert!(!unlike.calibrated && is_warned(&said(&unlike.notes), "different units"));
}

#[test]
fn steps_have_times() {
    let sizes = "dimension: 4\nsizes: 2 3 2 2\n";
    let info = placed(&format!(
        "{sizes}kinds: domain domain domain time\nspacings: 1 1 1 0.5\nunits: \"mm\" \"mm\" \"mm\" \"s\"\n"
    ));
    let time = info.time.unwrap();
    assert_eq!((info.times, time.step, time.start, time.unit.as_deref()), (2, 0.5, 0.0, Some("second")));
    let info = placed(&format!(
        "{sizes}space: LPST\nspace directions: (1,0,0,0) (0,1,0,0) (0,0,1,0) (0,0,0,40)\nspace origin: (1,2,3,4)\n"
    ));
    let time = info.time.unwrap();
    assert_eq!((info.times, time.step, time.start), (2, 40.0, 4.0));
    assert_eq!(info.orientation.unwrap().rows()[0], [-1.0, 0.0, 0.0, -1.0]);
    let info = placed(&format!("{sizes}kinds: domain domain domain domain\n"));
    assert!(info.times == 2 && is_warned(&said(&info.notes), "read as time steps"));
    let info = placed(&format!(
        "{sizes}kinds: domain domain domain domain\nspace: RAS\nspace directions: (1,0,0) (0,1,0) (0,0,1) none\n"
    ));
    assert!(info.times == 2 && is_warned(&said(&info.notes), "outside space"));
}

/// Writes data files of a field's slices, each in this wrapping, beside a header.
fn in_files(header: &str, wrap: impl Fn(&[u8]) -> Vec<u8>) -> (tempfile::TempDir, PathBuf, Field) {
    let field = Field { sizes: [3, 2, 4, 1, 1], voxel_type: VoxelType::U16 };
    let fields = format!("type: ushort\nDimension: 3\nsizes: 3 2 4\nendian: little\n{header}");
    let (folder, path) = temp_file("a.nhdr", format!("NRRD0004\n{fields}").as_bytes());
    for (i, slice) in field.bytes("zyx", false).chunks(12).enumerate() {
        std::fs::write(folder.path().join(format!("s 0{i}.raw")), wrap(slice)).unwrap();
        std::fs::write(folder.path().join(format!("s0{i}.raw")), wrap(slice)).unwrap();
    }
    std::fs::write(folder.path().join("all.raw"), wrap(&field.bytes("zyx", false))).unwrap();
    (folder, path, field)
}

fn read(path: &Path) -> Result<Box<dyn Source>, String> {
    open_any(&[path.to_owned()], &options()).map_err(|error| error.to_string())
}

#[test]
fn data_lie_in_one_file_or_in_several() {
    for (header, name) in [
        ("encoding: raw\ndata file: all.raw\n\n", "one"),
        ("encoding: raw\ndatafile: ./all.raw", "without an end"),
        ("encoding: raw\ndata file: s%02d.raw 0 3 1\n", "counted"),
        ("encoding: raw\ndata file: s%02d.raw 0 3 1 2\n", "counted slices"),
        ("encoding: raw\ndata file: LIST\ns 00.raw\ns01.raw\r\ns02.raw\ns03.raw\n\n", "listed"),
        ("encoding: raw\ndata file: LIST 3\ns00.raw\ns01.raw\ns02.raw\ns03.raw\n", "listed slabs"),
    ] {
        let (_folder, path, field) = in_files(header, <[u8]>::to_vec);
        let source = read(&path).unwrap();
        assert_boxes(&*source, field);
        let is_joined = said(&source.info().notes).contains("note: 4 data files are joined");
        assert_eq!(is_joined, name.contains("ed"), "{name}");
    }
    let (_folder, path, field) = in_files("encoding: gzip\ndata file: s%02d.raw 0 3 1\n", gzip);
    assert_boxes(&*read(&path).unwrap(), field);
    let (_folder, path, field) = in_files("encoding: raw\ndata file: all.raw\n", <[u8]>::to_vec);
    let absolute = path.with_file_name("all.raw").display().to_string();
    let text = std::fs::read_to_string(&path).unwrap().replace("all.raw", &absolute);
    let (_other, path) = temp_file("a.nhdr", text.as_bytes());
    assert_boxes(&*read(&path).unwrap(), field);
}

#[test]
fn lines_are_skipped_in_the_file_and_bytes_in_what_is_decoded() {
    let skip = "line skip: 2\nbyte skip: 3\n";
    let before = |slice: &[u8]| [b"P5\n# x\nabc", slice].concat();
    for files in ["all.raw", "s%02d.raw 0 3 1"] {
        let (_folder, path, field) = in_files(&format!("{skip}encoding: raw\ndata file: {files}\n"), before);
        assert_boxes(&*read(&path).unwrap(), field);
        let coded = |slice: &[u8]| [b"P5\n# x\n".to_vec(), gzip(&[b"abc", slice].concat())].concat();
        let (_folder, path, field) = in_files(&format!("{skip}encoding: gzip\ndata file: {files}\n"), coded);
        assert_boxes(&*read(&path).unwrap(), field);
        let (_folder, path, field) = in_files(&format!("byteskip: -1\nencoding: raw\ndata file: {files}\n"), before);
        assert_boxes(&*read(&path).unwrap(), field);
    }
}

#[test]
fn missing_and_short_data_files_are_named() {
    let message = |header: &str| {
        let (_folder, path, _) = in_files(header, <[u8]>::to_vec);
        read(&path).err().unwrap()
    };
    assert!(message("encoding: raw\ndata file: no.raw\n").contains("no.raw is missing"));
    assert!(message("encoding: raw\ndata file: .\n").contains("no regular file"));
    assert!(message("encoding: raw\ndata file: s%02d.raw 0 4 1\n").contains("5 data files of 2 axes each"));
    assert!(message("encoding: raw\ndata file: s%02d.raw 1 4 1\n").contains("s04.raw is missing"));
    assert!(message("encoding: raw\ndata file: LIST\nall.raw\ns00.raw\n").contains("2 data files of 2 axes each"));
    assert!(message("encoding: raw\nbyte skip: 1\ndata file: s%02d.raw 0 3 1\n").contains("1 missing"));
    assert!(message("encoding: raw\ndata file: s00.raw\n").contains("36 missing"));
    assert!(message("encoding: raw\nbyte skip: -1\ndata file: s00.raw\n").contains("36 missing"));
    assert!(message("encoding: raw\nline skip: 1000\ndata file: s00.raw\n").contains("1000 lines are to be skipped"));
    assert!(message("encoding: gzip\ndata file: s%02d.raw 0 3 1\n").contains("s00.raw"));
    let (folder, path, _) = in_files("encoding: gzip\ndata file: s%02d.raw 0 3 1\n", gzip);
    std::fs::write(folder.path().join("s02.raw"), gzip(b"short")).unwrap();
    let message = read(&path).err().unwrap();
    assert!(message.contains("s02.raw: cut short: expected 12 bytes, 7 missing"), "{message}");
    let (_folder, path, _) = in_files("encoding: raw\ndata file: s%02d.raw 0 3 1\n", |slice| [slice, b"+"].concat());
    assert!(is_warned(&said(&read(&path).unwrap().info().notes), "ignored in 4 of 4 data files"));
}

#[test]
fn several_headers_are_steps() {
    let field = Field { sizes: [3, 2, 4, 1, 2], voxel_type: VoxelType::U8 };
    let folder = tempfile::tempdir().unwrap();
    for (i, step) in field.bytes("tzyx", false).chunks(24).enumerate() {
        let bytes = nrrd("type: uchar\ndimension: 3\nsizes: 3 2 4\nencoding: gzip\n", &gzip(step));
        std::fs::write(folder.path().join(format!("s{i}.nrrd")), bytes).unwrap();
    }
    assert_boxes(&*open_any(&[folder.path().to_owned()], &options()).unwrap(), field);
}

#[test]
fn unused_and_odd_fields_are_told() {
    let info =
        placed("old min: 0\noldmax: 4.5\nspacing: 1 2 3\nSegment0_Name:=liver\nmeasurement frame: (1,0) (0,1)\n");
    let said = said(&info.notes);
    assert!(said.contains("of segments, which the store does not name: 1 liver."), "{said}");
    assert!(said.contains("note: Values were quantized from a range of 0 to 4.5"), "{said}");
    assert!(is_warned(&said, "'spacing' is none of NRRD's"), "{said}");
    let info = placed("space: LPS\nspace origin: (1,2,3)\nspacings: 1 2 3\n");
    assert!(info.geometry.origin == DVec3::ZERO && is_warned(&crate::testing::said(&info.notes), "space origin"));
}

#[test]
fn what_is_not_understood_is_refused_by_its_name() {
    let whole = "type: uchar\ndimension: 3\nsizes: 2 3 4\nencoding: raw\n";
    let with = |from: &str, to: &str| refusal(&nrrd(&whole.replace(from, to), &[0; 24]));
    let plus = |more: &str| with("encoding: raw\n", &format!("encoding: raw\n{more}"));
    for (message, words) in [
        (with("uchar", "block"), "type block is not supported"),
        (with("uchar", "char"), "type char is not supported"),
        (with("uchar", "short"), "lacks the field 'endian'"),
        (with("type: uchar\n", ""), "lacks the field 'type'"),
        (with("raw", "bzip2"), "encoding bzip2 is not supported"),
        (with("raw", "ascii"), "encoding ascii is not supported"),
        (with("raw", "hex"), "encoding hex is not supported"),
        (with("sizes: 2 3 4", "sizes: 2 3"), "no valid 'sizes'"),
        (with("sizes: 2 3 4", "sizes: 2 3 0"), "no valid 'sizes'"),
        (with("sizes: 2 3 4", "sizes: 4294967295 4294967295 4294967295"), "2^63"),
        (with("sizes: 2 3 4", "sizes: 2 3 5"), "cut short"),
        (with("dimension: 3", "dimension: 6"), "dimension 6 (2 to 5 are read)"),
        (with("dimension: 3", "dimension: x"), "no valid 'dimension'"),
        (plus("kinds: domain domain sausage\n"), "the kind sausage"),
        (plus("kinds: RGB-color domain domain\n"), "has 3 samples, but its size is 2"),
        (plus("kinds: list list domain\n"), "two axes of components"),
        (plus("kinds: time time domain\n"), "two axes of time"),
        (plus("kinds: ??? domain domain\n"), "axis 0 without a kind"),
        (plus("kinds: domain domain\n"), "no valid 'kinds'"),
        (plus("space: here\n"), "space here"),
        (plus("space directions: (1,0,0) (0,1,0) (0,0,1)\n"), "neither 'space' nor 'space dimension'"),
        (plus("space: LPS\nspace directions: (1,0,0) (0,1,0)\n"), "no valid 'spacedirections'"),
        (plus("space: LPS\nspace directions: (1,0,0) (0,1,0) (0,1)\n"), "no valid 'spacedirections'"),
        (plus("space: LPS\nspace directions: (1,0,0) (0,1,0) (0,0,1\n"), "no valid 'spacedirections'"),
        (
            plus("space: LPS\nspace directions: (1,0,0) (0,1,0) (0,0,1)\nspace origin: (1,2)\n"),
            "no valid 'spaceorigin'",
        ),
        (plus("space: LPS\nspace directions: (1,0,0) (0,1,0) none\nkinds: space space space\n"), "of kind space"),
        (plus("byte skip: -2\n"), "byte skip -2"),
        (plus("line skip: -1\n"), "no valid 'lineskip'"),
        (plus("type: uchar\n"), "the field 'type' twice"),
        (plus("what is this\n"), "a line without a field, 'what is this'"),
        (plus("data file: s%02d.raw 0 3 0\n"), "no valid 'datafile'"),
        (plus("data file: s%02s.raw 0 3 1\n"), "no valid 'datafile'"),
        (refusal(b"NRRD0009\n"), "the NRRD version 'NRRD0009'"),
        (refusal(b"NRRD0004\ntype: uchar\ndimension: 2\nsizes: 1 1\nencoding: raw\n"), "cut short: neither"),
        (refusal(&nrrd("type: uchar\ndimension: 4\nsizes: 2 2 2 3\nencoding: raw\n", &[0; 24])), "without `kinds`"),
        (refusal(&nrrd(&whole.replace("raw", "gzip"), b"\x1f\x8bnot")), "damaged"),
        (
            refusal(&nrrd("type: uchar\ndimension: 3\nsizes: 9000 9000 9000\nencoding: gzip\n", &gzip(&[0; 24]))),
            "compressed bytes cannot hold the 729000000000 of its header",
        ),
        (refusal(&nrrd(&"#\n".repeat(9 << 20), b"")), "longer than"),
    ] {
        assert!(message.contains(words), "{message}\n{words}");
    }
    let bytes = nrrd(whole, &[0; 24]);
    let (_folder, path) = temp_file("a.nrrd", &bytes);
    let told = OpenOptions { axes: Some("zyx".parse().unwrap()), ..options() };
    assert!(open_any(&[path], &told).err().unwrap().to_string().contains("`axes` is for"));
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    /// Damage leads to an error or other voxels, never to a panic.
    #[test]
    fn damaged_headers_do_not_panic(
        damage in prop::collection::vec((any::<prop::sample::Index>(), prop_oneof![any::<u8>(), prop::sample::select(&b"0123456789-:%() \nLTndeo,\""[..])]), 1..8),
        cut in prop::option::of(any::<prop::sample::Index>()),
        kind in 0usize..4,
    ) {
        let fields = [
            "type: short\ndimension: 4\nsizes: 2 2 3 4\nkinds: vector domain domain domain\nspace: LPS\nspace directions: none (1,0,0) (0,2,0) (0,0,3)\nspace origin: (1,2,3)\nendian: big\nencoding: raw\n",
            "type: uchar\ndimension: 3\nsizes: 2 3 4\nencoding: raw\ndata file: s%02d.raw 0 3 1 2\nline skip: 0\nbyte skip: -1\n",
            "type: float\ndimension: 4\nsizes: 2 3 2 2\nspacings: 1 nan 2 3\naxis mins: 0 1 2 3\naxis maxs: 1 2 3 4\ncenterings: cell node cell cell\nkinds: space space space time\nunits: \"mm\" \"mm\" \"mm\" \"s\"\nendian: little\nencoding: gzip\nbyte skip: 2\n",
            "type: uchar\ndimension: 3\nsizes: 2 3 4\nencoding: gzip\ndata file: LIST 2\ns00.raw\ns01.raw\ns02.raw\ns03.raw\n",
        ][kind];
        let data = match kind { 2 => gzip(&[1; 98]), _ => vec![7; 96] };
        let mut bytes = nrrd(fields, &data);
        let length = bytes.len();
        for (place, value) in damage {
            bytes[9 + place.index(length - 9)] = value;
        }
        bytes.truncate(cut.map_or(length, |cut| cut.index(length)).max(1));
        let (folder, path) = temp_file("a.nrrd", &bytes);
        for i in 0..4 {
            let part = if kind == 3 { gzip(&[i; 6]) } else { vec![i; 6] };
            std::fs::write(folder.path().join(format!("s0{i}.raw")), part).unwrap();
        }
        let told = OpenOptions { allow_lossy: true, ..options() };
        if let Ok(source) = open_any(&[path], &told) {
            let full = source.info().extent.full_box();
            let mut out = vec![0; full.extent().volume() as usize * source.info().voxel_type.bytes()];
            source.read_box(source.info().times - 1, source.info().channels - 1, full, &mut out).unwrap();
        }
    }
}
