//! Files made by hand, in every layout of the formats' descriptions.

use crate::open::open;
use crate::options::OpenOptions;
use crate::testing::{Field, Opened, assert_boxes, is_warned, open_in, said, temp_file};
use brickyard_volume::{Extent, VoxelBox, VoxelType};
use glam::DVec3;
use proptest::prelude::*;
use std::io::Read;
use std::path::Path;

const FIELD: Field = Field { sizes: [7, 5, 4, 1, 1], voxel_type: VoxelType::U16 };

fn xml_type(voxel_type: VoxelType) -> &'static str {
    match voxel_type {
        VoxelType::U8 => "UInt8",
        VoxelType::I8 => "Int8",
        VoxelType::U16 => "UInt16",
        VoxelType::I16 => "Int16",
        VoxelType::U32 => "UInt32",
        VoxelType::I32 => "Int32",
        VoxelType::F32 => "Float32",
    }
}

fn legacy_type(voxel_type: VoxelType) -> &'static str {
    match voxel_type {
        VoxelType::U8 => "unsigned_char",
        VoxelType::I8 => "char",
        VoxelType::U16 => "unsigned_short",
        VoxelType::I16 => "short",
        VoxelType::U32 => "unsigned_int",
        VoxelType::I32 => "int",
        VoxelType::F32 => "float",
    }
}

/// A layout of arrays in an XML file.
#[derive(Clone, Copy, Debug)]
struct Written {
    big: bool,
    long: bool,
    compressor: &'static str,
    format: &'static str,
    raw: bool,
}

const PLAIN: Written = Written { big: false, long: false, compressor: "", format: "appended", raw: true };

impl Written {
    fn number(self, number: usize) -> Vec<u8> {
        match (self.long, self.big) {
            (false, false) => (number as u32).to_le_bytes().to_vec(),
            (false, true) => (number as u32).to_be_bytes().to_vec(),
            (true, false) => (number as u64).to_le_bytes().to_vec(),
            (true, true) => (number as u64).to_be_bytes().to_vec(),
        }
    }

    fn in_text(self, bytes: &[u8]) -> Vec<u8> {
        if self.raw && self.format == "appended" { bytes.to_vec() } else { base64(bytes).into_bytes() }
    }

    /// The array's bytes behind a header, in blocks of 64 if compressed.
    fn coded(self, bytes: &[u8]) -> Vec<u8> {
        let numbers = |numbers: &[usize]| numbers.iter().flat_map(|n| self.number(*n)).collect::<Vec<u8>>();
        if self.compressor.is_empty() {
            return self.in_text(&[numbers(&[bytes.len()]), bytes.to_vec()].concat());
        }
        let blocks: Vec<Vec<u8>> = bytes.chunks(64).map(|block| self.packed(block)).collect();
        let mut header = vec![blocks.len(), 64, bytes.len() % 64];
        header.extend(blocks.iter().map(Vec::len));
        [self.in_text(&numbers(&header)), self.in_text(&blocks.concat())].concat()
    }

    fn packed(self, block: &[u8]) -> Vec<u8> {
        if self.compressor == "vtkLZ4DataCompressor" {
            return lz4_flex::block::compress(block);
        }
        let mut out = Vec::new();
        flate2::read::ZlibEncoder::new(block, flate2::Compression::fast()).read_to_end(&mut out).unwrap();
        out
    }

    /// A file of an image with these attributes, and pieces with the attributes of an array in each.
    fn file(self, image: &str, pieces: &[(&str, &str, &[u8])]) -> Vec<u8> {
        let order = if self.big { "BigEndian" } else { "LittleEndian" };
        let (long, compressor) = (if self.long { "UInt64" } else { "UInt32" }, self.compressor);
        let mut out = format!(
            "<?xml version=\"1.0\"?>\n<!-- by hand -->\n<VTKFile type=\"ImageData\" version=\"1.0\" byte_order=\"{order}\" \
             header_type=\"{long}\" compressor=\"{compressor}\">\n<ImageData {image}>\n"
        )
        .into_bytes();
        let mut appended = Vec::new();
        for (piece, array, bytes) in pieces {
            let section = if array.contains("cells") { "CellData" } else { "PointData" };
            out.extend(format!("<Piece {piece}><{section} Scalars=\"a\">").into_bytes());
            let (format, offset) = (self.format, appended.len());
            out.extend(format!("<DataArray {array} format=\"{format}\" offset=\"{offset}\">\n  ").into_bytes());
            match format {
                "appended" => appended.extend(self.coded(bytes)),
                "ascii" => out.extend(*bytes),
                _ => out.extend(self.coded(bytes)),
            }
            out.extend(format!("\n</DataArray></{section}></Piece>\n").into_bytes());
        }
        out.extend(b"</ImageData>\n");
        if self.format == "appended" {
            let encoding = if self.raw { "raw" } else { "base64" };
            out.extend(format!("<AppendedData encoding=\"{encoding}\">\n   _").into_bytes());
            out.extend(appended);
            out.extend(b"\n</AppendedData>\n");
        }
        out.extend(b"</VTKFile>\n");
        out
    }
}

fn base64(bytes: &[u8]) -> String {
    const LETTERS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut out = String::new();
    for group in bytes.chunks(3) {
        let bits = (0..3).fold(0u32, |bits, i| bits << 8 | u32::from(group.get(i).copied().unwrap_or(0)));
        let letter =
            |i: usize| if i <= group.len() { LETTERS[(bits >> (18 - 6 * i)) as usize & 63] as char } else { '=' };
        out.extend((0..4).map(letter));
    }
    out
}

fn image_of(field: Field) -> (String, String) {
    let [x, y, z, ..] = field.sizes.map(|n| n - 1);
    let extent = format!("Extent=\"0 {x} 0 {y} 0 {z}\"");
    (format!("Whole{extent} Origin=\"1 2 3\" Spacing=\"0.5 1 2\""), extent)
}

fn array_of(field: Field) -> String {
    format!("type=\"{}\" Name=\"a\" NumberOfComponents=\"{}\"", xml_type(field.voxel_type), field.sizes[3])
}

fn opened(bytes: &[u8], options: &OpenOptions) -> Opened {
    open_in(temp_file("a.xyz", bytes), options).unwrap_or_else(|error| panic!("{error}"))
}

fn refusal(bytes: &[u8]) -> String {
    open_in(temp_file("a.vti", bytes), &OpenOptions::default()).err().unwrap()
}

/// Words of a field's numbers.
fn words(field: Field, axes: &str) -> Vec<u8> {
    let bytes = field.bytes(axes, false);
    let numbers = (0..bytes.len() / field.voxel_type.bytes()).map(|i| field.voxel_type.read(&bytes, i).to_string());
    numbers.collect::<Vec<_>>().join(" ").into_bytes()
}

#[test]
fn every_type_order_and_layout_of_the_xml_format_is_read() {
    for voxel_type in VoxelType::ALL {
        for components in [1, 3] {
            let field = Field { sizes: [7, 5, 4, components, 1], voxel_type };
            let ((image, piece), array) = (image_of(field), array_of(field));
            for (big, long) in [(false, false), (true, false), (false, true), (true, true)] {
                for compressor in ["", "vtkZLibDataCompressor", "vtkLZ4DataCompressor"] {
                    for (format, raw) in [("appended", true), ("appended", false), ("binary", true)] {
                        let written = Written { big, long, compressor, format, raw };
                        let bytes = written.file(&image, &[(&piece, &array, &field.bytes("zyxc", big))]);
                        let source = opened(&bytes, &OpenOptions::default());
                        assert_eq!(
                            source.scratch_bytes() == 0,
                            written.raw && format == "appended" && compressor.is_empty()
                        );
                        assert_boxes(&*source, field);
                    }
                }
            }
            let written = Written { format: "ascii", big: true, ..PLAIN };
            assert_boxes(
                &*opened(&written.file(&image, &[(&piece, &array, &words(field, "zyxc"))]), &OpenOptions::default()),
                field,
            );
        }
    }
}

#[test]
fn geometry_names_and_calibration_are_the_files() {
    let field = Field { sizes: [7, 5, 4, 2, 1], ..FIELD };
    let (image, piece) = image_of(field);
    let array = format!("{} ComponentName0=\"u &lt;\" ComponentName1=\"v\"", array_of(field));
    let source = opened(&PLAIN.file(&image, &[(&piece, &array, &field.bytes("zyxc", false))]), &OpenOptions::default());
    let info = source.info();
    assert_eq!((info.geometry.spacing, info.geometry.origin), (DVec3::new(0.5, 1.0, 2.0), DVec3::new(1.0, 2.0, 3.0)));
    assert!(info.calibrated && info.orientation.is_none());
    let names: Vec<_> = info.channel_looks.iter().map(|look| look.name.clone().unwrap()).collect();
    assert_eq!(names, ["u <", "v"]);
    // Cells between points from 2 on.
    let image = "WholeExtent=\"2 9 0 5 0 4\" Spacing=\"1 1 1\"";
    let array = "type=\"UInt16\" Name=\"cells\"";
    let bytes = PLAIN.file(image, &[("Extent=\"2 9 0 5 0 4\"", array, &FIELD.bytes("zyx", false))]);
    let source = opened(&bytes, &OpenOptions::default());
    assert_boxes(&*source, FIELD);
    assert_eq!(source.info().geometry.origin, DVec3::new(2.5, 0.5, 0.5));
    let bare = PLAIN.file("WholeExtent=\"0 6 0 4 0 3\"", &[(&piece, &array_of(FIELD), &FIELD.bytes("zyx", false))]);
    assert!(!opened(&bare, &OpenOptions::default()).info().calibrated);
}

#[test]
fn wide_numbers_are_narrowed_without_loss_or_refused() {
    let (image, piece) = ("WholeExtent=\"0 2 0 0 0 0\"", "Extent=\"0 2 0 0 0 0\"");
    let read = |kind: &str, bytes: &[u8], options: &OpenOptions| {
        let file = PLAIN.file(image, &[(piece, &format!("type=\"{kind}\" Name=\"a\""), bytes)]);
        let (_folder, path) = temp_file("a.vti", &file);
        open(&[path], options).map(|source| {
            let mut out = vec![0; 12];
            source.read_box(0, 0, source.info().extent.full_box(), &mut out).unwrap();
            let voxel_type = source.info().voxel_type;
            (voxel_type, [0, 1, 2].map(|i| voxel_type.read(&out, i)))
        })
    };
    let (none, told) = (OpenOptions::default(), OpenOptions { allow_lossy: true, ..OpenOptions::default() });
    let signed = [-7i64, 8, i32::MAX.into()].map(i64::to_le_bytes).concat();
    assert_eq!(read("Int64", &signed, &none).unwrap(), (VoxelType::I32, [-7.0, 8.0, 2147483647.0]));
    let unsigned = [7u64, 8, u32::MAX.into()].map(u64::to_le_bytes).concat();
    assert_eq!(read("UInt64", &unsigned, &none).unwrap(), (VoxelType::U32, [7.0, 8.0, 4294967295.0]));
    let floats = [0.5f64, -2.0, 0.1].map(f64::to_le_bytes).concat();
    assert!(read("Float64", &floats, &none).unwrap_err().to_string().contains("`allow_lossy`"));
    assert_eq!(read("Float64", &floats, &told).unwrap(), (VoxelType::F32, [0.5, -2.0, f64::from(0.1f32)]));
    let message = read("Bit", &[7], &none).unwrap_err().to_string();
    assert!(message.contains("the type Bit of the array a is not supported"), "{message}");
}

/// Bytes of a box of a field, x fastest.
fn part_of(field: Field, region: VoxelBox) -> Vec<u8> {
    let source = opened(
        &PLAIN.file(&image_of(field).0, &[(&image_of(field).1, &array_of(field), &field.bytes("zyxc", false))]),
        &OpenOptions::default(),
    );
    let mut out = vec![0; region.extent().volume() as usize * 2];
    source.read_box(0, 0, region, &mut out).unwrap();
    out
}

#[test]
fn pieces_are_joined_and_must_leave_nothing_out() {
    // Points where pieces meet are in both.
    let boxes =
        [VoxelBox::new([0, 0, 0], [4, 5, 4]), VoxelBox::new([3, 0, 0], [7, 3, 4]), VoxelBox::new([3, 2, 0], [7, 5, 4])];
    let parts = boxes.map(|region| part_of(FIELD, region));
    let extents = boxes.map(|region| {
        let [min, max] = [region.min.to_array(), region.max.to_array()];
        let pair = |axis: usize| format!("{} {}", min[axis] + 10, max[axis] + 9);
        format!("Extent=\"{} {} {}\"", pair(0), pair(1), pair(2))
    });
    let array = array_of(FIELD);
    let pieces: Vec<(&str, &str, &[u8])> = (0..3).map(|i| (&*extents[i], &*array, &*parts[i])).collect();
    let image = "WholeExtent=\"10 16 10 14 10 13\" Spacing=\"1 1 1\"";
    for written in [PLAIN, Written { compressor: "vtkZLibDataCompressor", raw: false, ..PLAIN }] {
        let source = opened(&written.file(image, &pieces), &OpenOptions::default());
        assert_boxes(&*source, FIELD);
        assert_eq!(source.info().geometry.origin, DVec3::splat(10.0));
        assert!(refusal(&written.file(image, &pieces[..2])).contains("leave points"));
        let other = array.replace("UInt16", "Int16");
        let unlike = [pieces[0], pieces[1], (pieces[2].0, &*other, pieces[2].2)];
        assert!(refusal(&written.file(image, &unlike)).contains("not in all pieces"));
    }
    assert!(refusal(&PLAIN.file("WholeExtent=\"10 15 10 14 10 13\"", &pieces)).contains("leaves the whole extent"));
}

/// A file of several arrays of one byte each.
fn several(scalars: &str, names: &[&str]) -> Vec<u8> {
    let arrays = (0..)
        .zip(names)
        .map(|(i, name)| format!("<DataArray type=\"UInt8\" Name=\"{name}\" format=\"ascii\"> {i} </DataArray>\n"));
    let arrays: String = arrays.collect();
    format!(
        "<VTKFile type=\"ImageData\" version=\"0.1\" byte_order=\"LittleEndian\"><ImageData WholeExtent=\"0 0 0 0 0 0\">\
         <FieldData><DataArray type=\"Float64\" Name=\"TimeValue\" format=\"ascii\">2.5</DataArray></FieldData>\
         <Piece Extent=\"0 0 0 0 0 0\"><PointData {scalars}>{arrays}</PointData><CellData>\
         <DataArray type=\"UInt8\" Name=\"a\" format=\"ascii\">77</DataArray></CellData></Piece></ImageData></VTKFile>"
    )
    .into_bytes()
}

#[test]
fn one_of_several_arrays_is_chosen_by_name() {
    let value = |bytes: &[u8], variable: Option<&str>| {
        let (_folder, path) = temp_file("a.vti", bytes);
        let source = open(&[path], &OpenOptions { variable: variable.map(str::to_owned), ..OpenOptions::default() });
        source.map_err(|error| error.to_string()).map(|source| {
            let mut out = [0];
            source.read_box(0, 0, source.info().extent.full_box(), &mut out).unwrap();
            (out[0], said(&source.info().notes))
        })
    };
    let (value_of_b, notes) = value(&several("Scalars=\"b\"", &["a", "b", "c"]), None).unwrap();
    assert_eq!(value_of_b, 1);
    assert!(
        notes.contains("PointData/b (UInt8, 1 component) are read; `variable`") && notes.contains("CellData/a"),
        "{notes}"
    );
    let all = several("", &["a", "b", "c"]);
    let message = value(&all, None).unwrap_err();
    assert!(
        message.contains("PointData/a (UInt8, 1 component), PointData/b") && message.contains("`variable`"),
        "{message}"
    );
    assert_eq!(value(&all, Some("c")).unwrap().0, 2);
    assert_eq!(value(&all, Some("CellData/a")).unwrap().0, 77);
    assert_eq!(value(&all, Some("PointData/a")).unwrap().0, 0);
    let message = value(&all, Some("a")).unwrap_err();
    assert!(message.contains("several of this name: PointData/a"), "{message}");
    let message = value(&all, Some("d")).unwrap_err();
    assert!(message.contains("no such array; it holds PointData/a"), "{message}");
    let ghosts = several("", &["vtkGhostType"]);
    assert_eq!(value(&ghosts, None).unwrap().0, 77);
    let ghosts = several("Scalars=\"b\"", &["vtkGhostType", "b"]);
    assert!(is_warned(&value(&ghosts, None).unwrap().1, "vtkGhostType marks"));
    let npy =
        [&b"\x93NUMPY\x01\x00\x40\x00{'descr': '|u1', 'fortran_order': False, 'shape': (1, 1), }"[..], &[b' '; 9]]
            .concat();
    assert!(value(&npy, Some("a")).unwrap_err().contains("`variable` is for"));
}

const LEGACY: &str = "# vtk DataFile Version 3.0\nby hand\nBINARY\nDATASET STRUCTURED_POINTS\nDIMENSIONS 7 5 4\nORIGIN 1 2 3\nSPACING 0.5 1 2\n";

#[test]
fn every_type_of_legacy_files_is_read() {
    for voxel_type in VoxelType::ALL {
        for (components, binary) in [(1, true), (3, true), (1, false), (3, false)] {
            let field = Field { sizes: [7, 5, 4, components, 1], voxel_type };
            let kind = legacy_type(voxel_type);
            let body = if binary { field.bytes("zyxc", true) } else { words(field, "zyxc") };
            let head = if binary { LEGACY.into() } else { LEGACY.replace("BINARY", "ASCII") };
            let head = format!("{head}POINT_DATA 140\nSCALARS a%20b {kind} {components}\nLOOKUP_TABLE default\n");
            let source = opened(&[head.as_bytes(), &body, b"\n"].concat(), &OpenOptions::default());
            assert_boxes(&*source, field);
            assert_eq!(source.info().geometry.origin, DVec3::new(1.0, 2.0, 3.0));
            assert_eq!(
                (source.info().geometry.spacing, source.scratch_bytes() == 0),
                (DVec3::new(0.5, 1.0, 2.0), binary)
            );
        }
    }
}

/// All sections, each of which has to be passed over by its own size.
#[test]
fn every_section_of_a_legacy_file_is_walked_over() {
    let part = |text: &str, bytes: usize| [text.as_bytes(), &vec![b'D'; bytes], b"\n"].concat();
    let sections = [
        LEGACY.replace("3.0", "5.1").into_bytes(),
        part("FIELD FieldData 1\nTimeValue 1 1 double\n", 8),
        part("CELL_DATA 72\nSCALARS cells char 1\nLOOKUP_TABLE own\n", 72),
        part("LOOKUP_TABLE own 2\n", 8),
        part("NORMALS n float\n", 72 * 12),
        part("POINT_DATA 140\nCOLOR_SCALARS rgb 3\n", 420),
        part("VECTORS v double\n", 140 * 24),
        b"METADATA\nCOMPONENT_NAMES\nu%20u\nv\nw\nINFORMATION 1\nNAME L2_NORM_RANGE LOCATION vtkDataArray\nDATA 2 1 3 \n\n".to_vec(),
        part("TENSORS t short\n", 140 * 18),
        part("TEXTURE_COORDINATES tc 2 float\n", 140 * 8),
        part("GLOBAL_IDS ids vtkIdType\n", 140 * 4),
        part("FIELD FieldData 3\nbits 1 140 bit\n", 18),
        b"METADATA\nINFORMATION 0\n\n".to_vec(),
        part("long 2 140 long\n", 140 * 16),
        part("last 2 140 unsigned_short\n", 140 * 4),
        b"METADATA\nINFORMATION 0\n\n".to_vec(),
    ];
    let bytes = sections.concat();
    let told = |name: &str| OpenOptions { variable: Some(name.into()), allow_lossy: true, ..OpenOptions::default() };
    let names = |name: &str| -> Vec<String> {
        opened(&bytes, &told(name)).info().channel_looks.iter().filter_map(|look| look.name.clone()).collect()
    };
    assert_eq!(names("v"), ["u u", "v", "w"]);
    assert_eq!(names("rgb"), ["red", "green", "blue"]);
    assert_eq!(names("t").len(), 9);
    assert_eq!(opened(&bytes, &told("last")).info().channels, 2);
    assert_eq!(opened(&bytes, &told("cells")).info().extent, Extent::new(6, 4, 3));
    assert_eq!(opened(&bytes, &told("long")).info().voxel_type, VoxelType::I32);
    let (_folder, path) = temp_file("a.vtk", &bytes);
    assert!(open(std::slice::from_ref(&path), &told("bits")).err().unwrap().to_string().contains("the type bit"));
    let source = open(&[path], &OpenOptions::default()).unwrap();
    assert!(said(&source.info().notes).contains("PointData/rgb"), "{:?}", source.info().notes);
}

/// Texts of every length, of words and empty ones, are passed over as VTK writes them.
#[test]
fn arrays_of_text_are_passed_over_in_legacy_files() {
    let field = Field { sizes: [7, 5, 4, 1, 1], voxel_type: VoxelType::U16 };
    let texts: Vec<String> =
        (0..140).map(|i| "a%20b POINT_DATA".chars().cycle().take([0, 1, 63, 64, 20_000][i % 5]).collect()).collect();
    let behind_length = |text: &String| {
        let mut bytes = match text.len() {
            length @ 0..64 => vec![0xc0 | length as u8],
            length => (0x8000 | length as u16).to_be_bytes().to_vec(),
        };
        if text.len() == 20_000 {
            bytes = (0x4000_0000 | 20_000u32).to_be_bytes().to_vec();
        }
        bytes.extend(text.as_bytes());
        bytes
    };
    for binary in [true, false] {
        let lines = texts.join("\n").into_bytes();
        let all = if binary { texts.iter().flat_map(behind_length).collect() } else { lines.clone() };
        let one = if binary { vec![0u8, 0, 0, 0, 0, 0, 0, 3, b'a', b'\n', b'b'] } else { b"a b".to_vec() };
        let body = if binary { field.bytes("zyx", true) } else { words(field, "zyx") };
        let head = if binary { LEGACY.into() } else { LEGACY.replace("BINARY", "ASCII") };
        let bytes = [
            head.replace("DIMENSIONS", "FIELD FieldData 1\nsaid 1 1 string\n")
                .split_once("string\n")
                .unwrap()
                .0
                .as_bytes(),
            b"string\n",
            &one,
            b"\nMETADATA\nINFORMATION 0\n\nDIMENSIONS 7 5 4\n",
            b"POINT_DATA 140\nFIELD f 3\nnames 1 140 string\n",
            &all,
            b"\nMETADATA\nINFORMATION 0\n\nv 1 140 variant\n",
            &lines,
            b"\nvalues 1 140 unsigned_short\n",
            &body,
            b"\n",
        ]
        .concat();
        let source = opened(&bytes, &OpenOptions::default());
        assert_boxes(&*source, field);
        let said = said(&source.info().notes);
        assert!(
            said.contains("PointData/values (unsigned_short") && said.contains("PointData/names (string"),
            "{said}"
        );
        let told = OpenOptions { variable: Some("names".into()), ..OpenOptions::default() };
        let (_folder, path) = temp_file("a.vtk", &bytes);
        let message = open(&[path], &told).err().unwrap().to_string();
        assert!(message.contains("the type string of the array names is not supported"), "{message}");
    }
}

#[test]
fn legacy_files_whose_sizes_are_wrong_are_refused() {
    let file = |tail: &[u8]| [LEGACY.as_bytes(), tail].concat();
    let long = [&b"POINT_DATA 140\nSCALARS a long\nLOOKUP_TABLE default\n"[..], &[0; 560], b"\n"].concat();
    assert!(refusal(&file(&long)).contains("cut short: the array a implies 1120 bytes"));
    // Longs of 4 bytes with another array behind them.
    let long = [&long[..], b"VECTORS v float\n", &[0; 1680], b"\n"].concat();
    assert!(refusal(&file(&long)).contains("long is taken as 8 bytes"), "{}", refusal(&file(&long)));
    for (tail, words) in [
        ("POINT_DATA 141\n", "POINT_DATA 141, but DIMENSIONS give 7 x 5 x 4"),
        ("SCALARS a char\nLOOKUP_TABLE d\n", "before POINT_DATA"),
        ("POINT_DATA 140\nSCALARS a char\nVECTORS", "expected LOOKUP_TABLE"),
        ("POINT_DATA 140\nSCALARS a char x\n", "is no array"),
        ("POINT_DATA 140\nFIELD f 1\na 1 139 char\n", "has 139 values, expected 140"),
        ("POINT_DATA 140\nFIELD f 1\na 1 140 complex\n", "an array of complex is not supported"),
        ("POINT_DATA 140\nFIELD f 1\na 1 140 string\n", "cut short: ends within its header"),
        ("POINT_DATA 140\nFIELD f 1\na 1 140 string\n\x7fab", "cut short"),
        ("POINT_DATA 140\nFIELD f 1\na 1 140 variant\n3 a\n", "implies 140 lines, found 1"),
        ("POINT_DATA 140\n", "a grid without arrays is not supported"),
        ("POINT_DATA", "cut short"),
    ] {
        let message = refusal(&file(tail.as_bytes()));
        assert!(message.contains(words), "{message}");
    }
    for (from, to, words) in [
        ("STRUCTURED_POINTS", "RECTILINEAR_GRID", "DATASET RECTILINEAR_GRID is not supported; resample"),
        ("Version 3.0", "Version 6.0", "versions 1 to 5 are read"),
        ("BINARY", "binery", "expected ASCII or BINARY"),
        ("DIMENSIONS 7 5 4", "DIMENSIONS 7 0 4", "has no points"),
    ] {
        let message = refusal(&[LEGACY.replace(from, to).as_bytes(), b"POINT_DATA 140\n"].concat());
        assert!(message.contains(words), "{message}");
    }
    let colors = LEGACY.replace("BINARY", "ASCII") + "POINT_DATA 140\nCOLOR_SCALARS a 1\n" + &"0.5 ".repeat(140);
    assert!(refusal(colors.as_bytes()).contains("'0.5' as number 0"));
}

#[test]
fn other_data_sets_and_damage_are_refused_by_name() {
    let (image, piece) = image_of(FIELD);
    let (array, body) = (array_of(FIELD), FIELD.bytes("zyx", false));
    let whole = PLAIN.file(&image, &[(&piece, &array, &body)]);
    let changed = |from: &str, to: &str| -> Vec<u8> {
        let at = whole.windows(from.len()).position(|part| part == from.as_bytes()).unwrap();
        [&whole[..at], to.as_bytes(), &whole[at + from.len()..]].concat()
    };
    for (from, to, words) in [
        ("\"ImageData", "\"RectilinearGrid", "a VTK XML file of RectilinearGrid is not supported; resample"),
        ("\"ImageData", "\"vtkMultiBlockDataSet", "vtkMultiBlockDataSet is not supported"),
        ("\"ImageData", "\"PImageData", "PImageData (.pvti, pieces in files of their own) is not supported"),
        ("version=\"1.0\" byte", "version=\"3.0\" byte", "version 3.0 of VTK's XML files"),
        ("UInt32", "UInt128", "header_type UInt128"),
        ("LittleEndian", "MiddleEndian", "MiddleEndian"),
        (
            "compressor=\"\"",
            "compressor=\"vtkLZMADataCompressor\"",
            "the compressor vtkLZMADataCompressor is not supported",
        ),
        ("0 6 0 4 0 3", "0 6 0 4 0 -1", "has no points"),
        ("0 6 0 4 0 3", "0 6 0 4", "expected 6 numbers"),
        ("type=\"UInt16\"", "type=\"UInt32\"", "280 bytes by its own header, expected 560"),
        ("Spacing=\"0.5", "Spacing=\"x", "expected 3 numbers"),
        ("   _", "   !", "do not start with _"),
        ("NumberOfComponents=\"1\"", "NumberOfComponents=\"0\"", "no components"),
        ("appended", "ninary", "unknown format 'ninary'"),
        ("<Piece", "<Peace", "has no <Piece>"),
        ("offset=\"0\"", "offset=\"99999\"", "cut short"),
        ("NumberOfComponents=\"1\"", "NumberOfComponents=\"4294967295\"", "by its own header"),
        ("1 2 3", "1 2 inf", "infinite numbers"),
    ] {
        let message = refusal(&changed(from, to));
        assert!(message.contains(words), "{from}: {message}");
    }
    let start = whole.windows(4).position(|part| part == b"   _").unwrap();
    let message = refusal(&whole[..start + 100]);
    assert!(message.contains("cut short") && message.contains("missing"), "{message}");
    assert!(refusal(&whole[..200]).contains("cut short"));
    assert!(refusal(b"what is this").contains("not a VTK XML file") || refusal(b"what is this").contains("not a VTK"));
    // Sizes beyond any file.
    let huge = "WholeExtent=\"0 4294967294 0 4294967294 0 4294967294\"";
    assert!(refusal(&PLAIN.file(huge, &[(&huge[5..], &array, &body)])).contains("2^63"));
    let zero = changed("Spacing=\"0.5", "Spacing=\"0");
    let source = opened(&zero, &OpenOptions::default());
    assert!(!source.info().calibrated && is_warned(&said(&source.info().notes), "no distance"));
}

fn write(folder: &Path, name: &str, bytes: &[u8]) {
    std::fs::write(folder.join(name), bytes).unwrap();
}

fn collection(sets: &str) -> Vec<u8> {
    format!("<?xml version=\"1.0\"?>\n<VTKFile type=\"Collection\" version=\"0.1\"><Collection>{sets}</Collection></VTKFile>")
        .into_bytes()
}

#[test]
fn collections_are_steps_in_the_order_of_their_times() {
    let field = Field { sizes: [7, 5, 4, 1, 3], ..FIELD };
    let (image, piece) = image_of(FIELD);
    let bytes = field.bytes("tzyx", false);
    for compressor in ["", "vtkZLibDataCompressor"] {
        let written = Written { compressor, ..PLAIN };
        let folder = tempfile::tempdir().unwrap();
        std::fs::create_dir(folder.path().join("s")).unwrap();
        for (i, step) in bytes.chunks(bytes.len() / 3).enumerate() {
            write(folder.path(), &format!("s/a_{i}.vti"), &written.file(&image, &[(&piece, &array_of(FIELD), step)]));
        }
        let sets = "<DataSet timestep=\"0.5\" part=\"0\" file=\"s/a_1.vti\"/><DataSet timestep=\"7\" group=\"\" file=\"s\\a_2.vti\"/>\
                    <DataSet timestep=\"-1\" file=\"s/a_0.vti\"/>";
        write(folder.path(), "all.pvd", &collection(sets));
        let source = open(&[folder.path().join("all.pvd")], &OpenOptions::default()).unwrap();
        assert_boxes(&*source, field);
        assert_eq!(source.info().time.as_ref().unwrap().stamps, [-1.0, 0.5, 7.0]);
        // The files themselves, numbered by their names.
        let source = open(&[folder.path().join("s")], &OpenOptions::default()).unwrap();
        assert_boxes(&*source, field);
        assert_eq!(source.info().time, None);
        let refusal = |sets: &str| {
            write(folder.path(), "all.pvd", &collection(sets));
            open(&[folder.path().join("all.pvd")], &OpenOptions::default()).err().unwrap().to_string()
        };
        assert!(refusal("<DataSet timestep=\"0\" part=\"1\" file=\"s/a_1.vti\"/>").contains("part above 0"));
        assert!(refusal("").contains("without files"));
        assert!(refusal("<DataSet timestep=\"0\" file=\"all.pvd\"/>").contains("within a collection"));
        assert!(refusal("<DataSet timestep=\"0\" file=\"no.vti\"/>").contains("no.vti is missing"));
        let twice = "<DataSet timestep=\"1\" file=\"s/a_1.vti\"/><DataSet timestep=\"1\" file=\"s/a_2.vti\"/>";
        assert!(refusal(twice).contains("for one time, 1"));
        write(folder.path(), "s/all.pvd", &collection(twice));
        let message = open(&[folder.path().join("s")], &OpenOptions::default()).err().unwrap().to_string();
        assert!(message.contains("3 VTK and 1 .pvd files"), "{message}");
    }
}

#[test]
fn times_in_files_are_those_of_the_steps() {
    let folder = tempfile::tempdir().unwrap();
    for (i, time) in ["0.25", "0.5", "4"].iter().enumerate() {
        let text = String::from_utf8(several("Scalars=\"b\"", &["b"])).unwrap().replace("2.5", time);
        write(folder.path(), &format!("a_{i}.vti"), text.as_bytes());
    }
    let source = open(&[folder.path().to_owned()], &OpenOptions::default()).unwrap();
    assert_eq!(source.info().time.as_ref().unwrap().stamps, [0.25, 0.5, 4.0]);
}

#[test]
fn damage_in_compressed_arrays_is_noticed() {
    let (image, piece) = image_of(FIELD);
    for compressor in ["vtkZLibDataCompressor", "vtkLZ4DataCompressor"] {
        let whole =
            Written { compressor, ..PLAIN }.file(&image, &[(&piece, &array_of(FIELD), &FIELD.bytes("zyx", false))]);
        let start = whole.windows(4).position(|part| part == b"   _").unwrap() + 4;
        // A size of a block, and the array's end.
        let mut longer = whole.clone();
        longer[start + 12] = longer[start + 12].wrapping_add(9);
        assert!(refusal(&longer).contains("damaged"), "{}", refusal(&longer));
        assert!(refusal(&whole[..whole.len() - 60]).contains("cut short"));
    }
}

proptest! {
    #![proptest_config(crate::testing::cases(300))]

    /// Damage leads to an error or wrong voxels, never to a panic.
    #[test]
    fn damaged_headers_do_not_panic(
        damage in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>(), any::<bool>()), 1..6),
        kind in 0..7,
        cut in any::<Option<prop::sample::Index>>(),
    ) {
        let field = Field { sizes: [3, 2, 2, 1, 1], ..FIELD };
        let ((image, piece), array, body) = (image_of(field), array_of(field), field.bytes("zyx", false));
        let file = |written: Written, body: &[u8]| written.file(&image, &[(&piece, &array, body)]);
        let mut bytes = match kind {
            0 => file(PLAIN, &body),
            1 => file(Written { compressor: "vtkZLibDataCompressor", ..PLAIN }, &body),
            2 => file(Written { compressor: "vtkLZ4DataCompressor", format: "binary", long: true, ..PLAIN }, &body),
            3 => file(Written { format: "ascii", ..PLAIN }, &words(field, "zyx")),
            4 => {
                let head = LEGACY.replace("7 5 4", "3 2 2").replace("BINARY", "ASCII") + "POINT_DATA 12\nFIELD f 1\na 1 12 short\n";
                [head.as_bytes(), &words(field, "zyx"), b"\nMETADATA\nCOMPONENT_NAMES\na\n\n"].concat()
            }
            5 => collection("<DataSet timestep=\"1\" part=\"0\" file=\"b.vti\"/><DataSet timestep=\"2\" file=\"c.vti\"/>"),
            _ => {
                let head = LEGACY.replace("7 5 4", "3 2 2") + "POINT_DATA 12\nSCALARS a short 1\nLOOKUP_TABLE default\n";
                [head.as_bytes(), &body, b"\nLOOKUP_TABLE b 1\n1234\n"].concat()
            }
        };
        for (place, value, is_digit) in damage {
            let place = place.index(bytes.len());
            bytes[place] = if is_digit { b'0' + value % 10 } else { value };
        }
        if let Some(cut) = cut {
            bytes.truncate(cut.index(bytes.len()));
        }
        let (_folder, path) = temp_file("a.vti", &bytes);
        let told = OpenOptions { allow_lossy: true, ..OpenOptions::default() };
        if let Ok(source) = open(&[path], &told) {
            let full = source.info().extent.full_box();
            let mut out = vec![0; full.extent().volume() as usize * source.info().voxel_type.bytes()];
            source.read_box(0, 0, full, &mut out).unwrap();
        }
    }
}
