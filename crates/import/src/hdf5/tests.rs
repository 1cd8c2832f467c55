//! Files made by hand from the format's specification: superblock 2, object headers 2, groups of link messages.

mod committed;

use super::open;
use crate::open::open as open_any;
use crate::options::{NoData, OpenOptions};
use crate::source::Access;
use crate::testing::{Damage, Field, assert_boxes, said, some_damage, spoil, temp_file, try_to_read};
use brickyard_volume::VoxelType;
use hdf5_reader::checksum::jenkins_lookup3;
use proptest::prelude::*;
use std::path::Path;

const UNDEFINED: u64 = u64::MAX;
const OLD_SUPERBLOCK_BYTES: usize = 96;

/// A file under construction.
struct Builder {
    bytes: Vec<u8>,
    links: Vec<(&'static str, u64)>,
    attributes: Vec<Vec<u8>>,
}

/// Where the elements of a test dataset go.
#[derive(Clone, Copy)]
enum Place {
    Piece,
    Compact,
    /// In chunks of this shape; deflated.
    Chunks([u64; 3]),
    Blank,
    Virtual,
}

fn message(kind: u8, body: &[u8]) -> Vec<u8> {
    [&[kind][..], &(body.len() as u16).to_le_bytes(), &[0], body].concat()
}

fn header(messages: &[Vec<u8>]) -> Vec<u8> {
    let body = messages.concat();
    let start = [&b"OHDR\x02\x02"[..], &(body.len() as u32).to_le_bytes(), &body].concat();
    [&start[..], &jenkins_lookup3(&start).to_le_bytes()].concat()
}

fn space(shape: &[u64]) -> Vec<u8> {
    let sizes: Vec<u8> = shape.iter().flat_map(|size| size.to_le_bytes()).collect();
    [&[2, shape.len() as u8, 0, 1][..], &sizes].concat()
}

fn datatype(voxel_type: VoxelType, big: bool) -> Vec<u8> {
    let size = voxel_type.bytes() as u8;
    match voxel_type {
        VoxelType::F32 => {
            [0x11, 0x20 | u8::from(big), 31, 0, 4, 0, 0, 0, 0, 0, 32, 0, 23, 8, 0, 23, 127, 0, 0, 0].into()
        }
        other => {
            let signed = u8::from(other.limits().0 < 0.0) << 3;
            vec![0x10, u8::from(big) | signed, 0, 0, size, 0, 0, 0, 0, 0, size * 8, 0]
        }
    }
}

/// An attribute: a text, or doubles.
fn attribute(name: &str, kind: &[u8], shape: &[u64], data: &[u8]) -> Vec<u8> {
    let (name, space) = ([name.as_bytes(), &[0]].concat(), space(shape));
    let sizes: Vec<u8> =
        [&name, &kind.to_vec(), &space].iter().flat_map(|part| (part.len() as u16).to_le_bytes()).collect();
    message(12, &[&[3, 0][..], &sizes, &[0], &name, kind, &space, data].concat())
}

fn text_attribute(name: &str, text: &str) -> Vec<u8> {
    attribute(name, &[0x13, 0, 0, 0, text.len() as u8, 0, 0, 0], &[1], text.as_bytes())
}

/// A text as an array of characters, as Imaris has it.
fn letters_attribute(name: &str, text: &str) -> Vec<u8> {
    attribute(name, &[0x13, 0, 0, 0, 1, 0, 0, 0], &[text.len() as u64], text.as_bytes())
}

fn number_attribute(name: &str, numbers: &[f64]) -> Vec<u8> {
    let double = [0x11, 0x20, 63, 0, 8, 0, 0, 0, 0, 0, 64, 0, 52, 11, 0, 52, 0xff, 3, 0, 0];
    let data: Vec<u8> = numbers.iter().flat_map(|number| number.to_le_bytes()).collect();
    attribute(name, &double, &[numbers.len() as u64], &data)
}

fn link((name, at): &(&str, u64)) -> Vec<u8> {
    message(6, &[&[1, 0, name.len() as u8][..], name.as_bytes(), &at.to_le_bytes()].concat())
}

impl Builder {
    fn new() -> Self {
        // The longer of the superblocks.
        Self { bytes: vec![0; OLD_SUPERBLOCK_BYTES], links: Vec::new(), attributes: Vec::new() }
    }

    fn put(&mut self, bytes: &[u8]) -> u64 {
        let at = self.bytes.len() as u64;
        self.bytes.extend_from_slice(bytes);
        at
    }

    /// Adds a dataset, and the attributes collected so far to it.
    fn set(mut self, name: &'static str, kind: &[u8], shape: &[u64], data: &[u8], place: Place) -> Self {
        let mut messages = vec![message(1, &space(shape)), message(3, kind)];
        match place {
            Place::Piece => {
                let at = self.put(data);
                let layout = [&[3, 1][..], &at.to_le_bytes(), &(data.len() as u64).to_le_bytes()].concat();
                messages.push(message(8, &layout));
            }
            Place::Compact => {
                messages.push(message(8, &[&[3, 0][..], &(data.len() as u16).to_le_bytes(), data].concat()));
            }
            Place::Blank => {
                messages.push(message(8, &[&[3, 1][..], &UNDEFINED.to_le_bytes(), &0u64.to_le_bytes()].concat()));
            }
            Place::Virtual => {
                messages.push(message(8, &[&[4, 3][..], &UNDEFINED.to_le_bytes(), &[0; 4]].concat()));
            }
            Place::Chunks(chunk) => {
                let tree = self.chunks(shape, chunk, data);
                let sizes: Vec<u8> = chunk.iter().flat_map(|size| (*size as u32).to_le_bytes()).collect();
                let element = (data.len() as u64 / shape.iter().product::<u64>()) as u32;
                let layout = [&[3, 2, 4][..], &tree.to_le_bytes(), &sizes, &element.to_le_bytes()].concat();
                messages.push(message(8, &layout));
                // Deflate, of level 6.
                messages.push(message(11, &[2, 1, 1, 0, 0, 0, 1, 0, 6, 0, 0, 0]));
            }
        }
        messages.append(&mut self.attributes);
        let at = self.put(&header(&messages));
        self.links.push((name, at));
        self
    }

    /// Writes chunks, padded with 0xee, and their B-tree of version 1. Returns the tree's place.
    fn chunks(&mut self, shape: &[u64], chunk: [u64; 3], data: &[u8]) -> u64 {
        let bytes = (data.len() as u64 / shape.iter().product::<u64>()) as usize;
        let mut entries = Vec::new();
        let starts = |a: usize| (0..shape[a]).step_by(chunk[a] as usize);
        for (z, y, x) in starts(0).flat_map(|z| starts(1).flat_map(move |y| starts(2).map(move |x| (z, y, x)))) {
            let mut part = Vec::new();
            for (dz, dy, dx) in
                (0..chunk[0]).flat_map(|dz| (0..chunk[1]).flat_map(move |dy| (0..chunk[2]).map(move |dx| (dz, dy, dx))))
            {
                let place = [z + dz, y + dy, x + dx];
                let is_inside = (0..3).all(|a| place[a] < shape[a]);
                let at = ((place[0] * shape[1] + place[1]) * shape[2] + place[2]) as usize * bytes;
                match is_inside {
                    true => part.extend_from_slice(&data[at..at + bytes]),
                    false => part.extend(std::iter::repeat_n(0xee, bytes)),
                }
            }
            let mut encoder = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::default());
            std::io::Write::write_all(&mut encoder, &part).unwrap();
            let coded = encoder.finish().unwrap();
            let at = self.put(&coded);
            entries.push((coded.len() as u32, [z, y, x], at));
        }
        let key = |size: u32, place: [u64; 3]| {
            let place: Vec<u8> = place.iter().chain(&[0]).flat_map(|at| at.to_le_bytes()).collect();
            [&size.to_le_bytes()[..], &[0; 4], &place].concat()
        };
        let mut node = [&b"TREE\x01\x00"[..], &(entries.len() as u16).to_le_bytes(), &[0xff; 16]].concat();
        for (size, place, at) in entries {
            node.extend(key(size, place));
            node.extend(at.to_le_bytes());
        }
        node.extend(key(0, [shape[0], shape[1], shape[2]]));
        self.put(&node)
    }

    /// Moves all links but the first ones, and the attributes collected so far, into a group.
    fn group(mut self, name: &'static str, kept: usize) -> Self {
        let mut messages: Vec<Vec<u8>> = self.links.split_off(kept).iter().map(link).collect();
        messages.append(&mut self.attributes);
        let at = self.put(&header(&messages));
        self.links.push((name, at));
        self
    }

    /// Adds another link to an object.
    fn again(mut self, name: &'static str, at: u64) -> Self {
        self.links.push((name, at));
        self
    }

    fn with(mut self, attribute: Vec<u8>) -> Self {
        self.attributes.push(attribute);
        self
    }

    /// The file, with the remaining attributes at its root.
    fn finish(mut self) -> Vec<u8> {
        let mut messages: Vec<Vec<u8>> = self.links.iter().map(link).collect();
        messages.append(&mut self.attributes);
        let root = self.put(&header(&messages));
        let end = self.bytes.len() as u64;
        let start = [
            &b"\x89HDF\r\n\x1a\n\x02\x08\x08\x00"[..],
            &0u64.to_le_bytes(),
            &UNDEFINED.to_le_bytes(),
            &end.to_le_bytes(),
            &root.to_le_bytes(),
        ]
        .concat();
        self.bytes[..44].copy_from_slice(&start);
        self.bytes[44..48].copy_from_slice(&jenkins_lookup3(&start).to_le_bytes());
        self.bytes
    }
}

impl Builder {
    /// The file as libraries before 1.8 write it: superblock 0, and a root group by a symbol table, a B-tree and a heap of names.
    fn finish_old(mut self) -> Vec<u8> {
        self.links.sort_unstable();
        let mut names = vec![0; 8];
        let mut symbols = [&b"SNOD\x01\0"[..], &(self.links.len() as u16).to_le_bytes()].concat();
        let mut last = 0u64;
        for (name, at) in &self.links {
            last = names.len() as u64;
            symbols.extend([&last.to_le_bytes()[..], &at.to_le_bytes(), &[0; 24]].concat());
            names.extend(name.bytes());
            names.resize(names.len() / 8 * 8 + 8, 0);
        }
        let symbols = self.put(&symbols);
        let ends = [UNDEFINED, UNDEFINED, 0, symbols, last].map(u64::to_le_bytes).concat();
        let tree = self.put(&[&b"TREE\0\0\x01\0"[..], &ends].concat());
        let segment = self.put(&names);
        let parts = [names.len() as u64, UNDEFINED, segment].map(u64::to_le_bytes).concat();
        let heap = self.put(&[&b"HEAP\0\0\0\0"[..], &parts].concat());
        let table = [&[0x11, 0, 16, 0, 0, 0, 0, 0][..], &tree.to_le_bytes(), &heap.to_le_bytes()].concat();
        let root = self.put(&[&[1, 0, 1, 0, 1, 0, 0, 0, 24, 0, 0, 0, 0, 0, 0, 0][..], &table].concat());
        let end = self.bytes.len() as u64;
        let places = [0, UNDEFINED, end, UNDEFINED, 0, root, 0, 0, 0].map(u64::to_le_bytes).concat();
        let start = [&b"\x89HDF\r\n\x1a\n\0\0\0\0\0\x08\x08\0\x04\0\x10\0\0\0\0\0"[..], &places].concat();
        self.bytes[..OLD_SUPERBLOCK_BYTES].copy_from_slice(&start);
        self.bytes
    }
}

fn refusal(path: &Path, options: &OpenOptions) -> String {
    open_any(&[path.to_owned()], options).err().unwrap().to_string()
}

fn small(place: Place) -> Builder {
    let data: Vec<u8> = (0..24).collect();
    Builder::new().set("a", &datatype(VoxelType::U8, false), &[2, 3, 4], &data, place)
}

#[test]
fn every_type_order_and_place_is_read() {
    let chunks = [[2, 3, 4], [5, 4, 3], [1, 1, 7], [8, 8, 8]].map(Place::Chunks);
    for voxel_type in VoxelType::ALL {
        for big in [false, true] {
            for place in [Place::Piece, Place::Compact].into_iter().chain(chunks) {
                let field = Field { sizes: [7, 5, 4, 1, 1], voxel_type };
                let data = field.bytes("zyx", big);
                let file = Builder::new().set("a", &datatype(voxel_type, big), &[4, 5, 7], &data, place).finish();
                // Also behind a user block, and under a name that says nothing.
                for name in ["a.h5", "b"] {
                    let block = if name == "b" { 512 } else { 0 };
                    let (_folder, path) = temp_file(name, &[&vec![7; block][..], &file].concat());
                    let source = open_any(&[path], &OpenOptions::default()).unwrap();
                    assert_boxes(&*source, field);
                    assert!(said(&source.info().notes).contains("/a is read, the only volume"));
                }
            }
        }
    }
}

#[test]
fn axes_follow_the_user() {
    for (axes, shape) in [("tcyx", [3, 2, 5, 7]), ("xyzc", [7, 5, 4, 2])] {
        let sizes = if axes == "tcyx" { [7, 5, 1, 2, 3] } else { [7, 5, 4, 2, 1] };
        let field = Field { sizes, voxel_type: VoxelType::U16 };
        let data = field.bytes(axes, false);
        let kind = datatype(VoxelType::U16, false);
        let (_folder, path) = temp_file("a.h5", &Builder::new().set("a", &kind, &shape, &data, Place::Piece).finish());
        assert!(refusal(&path, &OpenOptions::default()).contains("`axes`"));
        let told = OpenOptions { axes: Some(axes.parse().unwrap()), ..OpenOptions::default() };
        assert_boxes(&*open(&path, &told).unwrap(), field);
    }
}

#[test]
fn elements_never_written_have_the_fill_value() {
    let (_folder, path) = temp_file("a.h5", &small(Place::Blank).finish());
    let source = open(&path, &OpenOptions::default()).unwrap();
    let mut out = [9; 24];
    source.read_box(0, 0, source.info().extent.full_box(), &mut out).unwrap();
    assert_eq!(out, [0; 24]);
    assert_eq!(source.access(), Access::Planes);
}

#[test]
fn one_dataset_of_several_is_named() {
    let kind = datatype(VoxelType::U8, false);
    let file = Builder::new()
        .set("first", &kind, &[2, 3, 4], &[1; 24], Place::Piece)
        .set("second", &kind, &[2, 2, 2], &[2; 8], Place::Piece)
        .set("line", &kind, &[24], &[3; 24], Place::Piece)
        .finish();
    let (_folder, path) = temp_file("a.h5", &file);
    let message = refusal(&path, &OpenOptions::default());
    assert!(
        message.contains("holds 2 datasets; name one with `variable`") && message.contains("/first (2 x 3 x 4, u8)")
    );
    assert!(!message.contains("/line"), "{message}");
    for name in ["second", "/second"] {
        let told = OpenOptions { variable: Some(name.into()), ..OpenOptions::default() };
        assert_eq!(open(&path, &told).unwrap().info().extent.x, 2);
        let inside = format!("{}::{name}", path.display()).into();
        assert_eq!(open_any(&[inside], &OpenOptions::default()).unwrap().info().extent.x, 2);
    }
    let told = |name: &str| OpenOptions { variable: Some(name.into()), ..OpenOptions::default() };
    assert!(refusal(&path, &told("secondly")).contains("of like names are /second"));
    assert!(refusal(&path, &told("line")).contains("of 1 axis (2 to 5 are read)"));
    let (_other, npy) = temp_file("a.npy", b"\x93NUMPY");
    assert!(refusal(&npy, &told("x")).contains("`variable` is for files of several arrays"));
}

#[test]
fn a_name_in_several_groups_is_ambiguous() {
    let kind = datatype(VoxelType::U8, false);
    let set = |made: Builder, name, value| made.set(name, &kind, &[2, 2, 2], &[value; 8], Place::Piece);
    let made = set(Builder::new(), "temp", 1).group("night", 0);
    let made = set(set(made, "temp", 2), "wind", 3).group("day", 1);
    let told = |name: &str| OpenOptions { variable: Some(name.into()), ..OpenOptions::default() };
    let found = |path: &Path, name: &str| {
        let source = open(path, &told(name)).unwrap();
        let mut out = [0; 8];
        source.read_box(0, 0, source.info().extent.full_box(), &mut out).unwrap();
        (out[0], said(&source.info().notes))
    };
    let (night, day, links) = (made.links[0].1, made.links[1].1, made.links.clone());
    let bytes = made.bytes.clone();
    let (_folder, path) = temp_file("a.h5", &made.finish());
    let message = refusal(&path, &told("temp"));
    assert!(
        message.contains("`variable` temp: is the name of 2 datasets; name one by its whole path, as in a.h5::/")
            && message.contains("/night/temp (2 x 2 x 2, u8)")
            && message.contains("/day/temp (2 x 2 x 2, u8)"),
        "{message}"
    );
    assert!(refusal(&path, &told("/temp")).contains("no such dataset"));
    assert_eq!(found(&path, "/night/temp"), (1, String::new()));
    assert_eq!(found(&path, "day/temp"), (2, String::new()));
    let (value, notes) = found(&path, "wind");
    assert!(value == 3 && notes.contains("`variable` wind is the dataset /day/wind."), "{notes}");
    // The root's own comes before others, and a group under two names has its datasets once.
    let rooted = set(Builder { bytes, links, attributes: Vec::new() }, "temp", 4);
    let (_folder, path) = temp_file("b.h5", &rooted.again("dawn", day).again("dusk", night).finish());
    let (value, notes) = found(&path, "temp");
    assert!(value == 4 && notes.contains("`variable` temp is the dataset /temp."), "{notes}");
    assert_eq!(found(&path, "/temp").0, 4);
}

#[test]
fn packed_numbers_become_values() {
    let data: Vec<u8> = (0..24).collect();
    let file = Builder::new()
        .with(number_attribute("scale_factor", &[0.5]))
        .with(number_attribute("add_offset", &[100.0]))
        .with(number_attribute("_FillValue", &[3.0]))
        .with(text_attribute("units", "K"))
        .with(number_attribute("element_size_um", &[3.0, 2.0, 1.0]))
        .set("a", &datatype(VoxelType::U8, false), &[2, 3, 4], &data, Place::Piece)
        .finish();
    let (_folder, path) = temp_file("a.h5", &file);
    let source = open(&path, &OpenOptions::default()).unwrap();
    let info = source.info();
    assert_eq!((info.voxel_type, info.knows_nodata, info.calibrated), (VoxelType::F32, true, true));
    assert_eq!(
        (info.geometry.spacing, info.geometry.unit.as_deref()),
        (glam::DVec3::new(1.0, 2.0, 3.0), Some("micrometer"))
    );
    assert_eq!(info.channel_looks[0].unit.as_deref(), Some("K"));
    let mut out = [0; 96];
    source.read_box(0, 0, info.extent.full_box(), &mut out).unwrap();
    assert!(VoxelType::F32.read(&out, 23) == 111.5 && VoxelType::F32.read(&out, 3).is_nan());
    let plain = OpenOptions { nodata: NoData::None, ..OpenOptions::default() };
    let plain = open_any(&[path], &plain).unwrap();
    plain.read_box(0, 0, plain.info().extent.full_box(), &mut out).unwrap();
    assert_eq!((plain.info().nodata, VoxelType::F32.read(&out, 3)), (None, 101.5));
}

#[test]
fn cut_and_unsupported_files_are_refused_by_name() {
    let whole = small(Place::Chunks([2, 3, 4])).finish();
    let none = OpenOptions::default();
    for length in [8, 47, 48, 100, whole.len() - 1] {
        let (_folder, path) = temp_file("a.h5", &whole[..length]);
        let message = refusal(&path, &none);
        assert!(message.contains("cut short") || message.contains("damaged"), "{length}: {message}");
    }
    let (_folder, path) = temp_file("a.h5", b"nothing of HDF5");
    assert!(refusal(&path, &none).contains("damaged"));
    for (kind, what) in [
        (vec![0x13, 0, 0, 0, 1, 0, 0, 0], "a string type"),
        (vec![0x14, 0, 0, 0, 1, 0, 0, 0, 0, 0, 8, 0], "a bitfield type"),
        (vec![0x10, 0, 0, 0, 1, 0, 0, 0, 0, 0, 7, 0], "7 bits in 1 bytes"),
    ] {
        let file = Builder::new().set("a", &kind, &[2, 3, 4], &[0; 24], Place::Piece).finish();
        let (_folder, path) = temp_file("a.h5", &file);
        assert!(refusal(&path, &none).contains(what), "{what}");
        let told = OpenOptions { variable: Some("a".into()), ..none.clone() };
        let message = refusal(&path, &told);
        assert!(message.contains(what) && message.contains("is not supported"), "{message}");
    }
}

/// An object that cannot be read hides no other, and is named.
#[test]
fn virtual_datasets_and_links_to_other_files_are_named() {
    let kind = datatype(VoxelType::U8, false);
    let none = OpenOptions::default();
    let told = |name: &str| OpenOptions { variable: Some(name.into()), ..none.clone() };
    let virtually = small(Place::Piece).set("v", &kind, &[2, 3, 4], &[], Place::Virtual).finish();
    let (_folder, path) = temp_file("a.h5", &virtually);
    assert_eq!(open(&path, &told("a")).unwrap().info().extent.x, 4);
    assert!(refusal(&path, &none).contains("/a (2 x 3 x 4, u8); /v cannot be read"), "{}", refusal(&path, &none));
    assert!(refusal(&path, &told("v")).contains("v, a virtual dataset, is not supported"));
    let target = [&[13, 0, 0][..], b"b.h5\0", b"/there\0"].concat();
    let away = message(6, &[&[1, 8, 64, 1][..], b"e", &target].concat());
    let (_folder, path) = temp_file("a.h5", &small(Place::Piece).with(away).finish());
    assert_eq!(open(&path, &told("a")).unwrap().info().extent.x, 4);
    assert!(
        refusal(&path, &told("e"))
            .contains("/e, a link to another file (b.h5::/there), is not supported; pass that as the input")
    );
}

fn floats(numbers: &[f32]) -> Vec<u8> {
    numbers.iter().flat_map(|number| number.to_le_bytes()).collect()
}

/// Adds coordinates from 1 on.
fn line(made: Builder, name: &'static str, count: u64, step: f32) -> Builder {
    let numbers: Vec<f32> = (0..count).map(|n| 1.0 + n as f32 * step).collect();
    made.set(name, &datatype(VoxelType::F32, false), &[count], &floats(&numbers), Place::Piece)
}

/// A NeXus file whose plot links to a dataset of a detector, which comes first in the file. The axes of the plot are `axes`, and told by `more`.
fn of_nexus(axes: &str, more: &[Vec<u8>], field: Option<&'static str>) -> Vec<u8> {
    let made = small(Place::Piece);
    let (_, at) = made.links[0];
    let made = made.group("detector", 0).again("data", at);
    let mut made = line(line(line(made, "p", 2, 10.0), "q", 3, 2.0), "r", 4, 0.5);
    if let Some(name) = field {
        made = line(made, name, 1, 0.0);
    }
    if !axes.is_empty() {
        made = made.with(letters_attribute("axes", axes));
    }
    let made = more.iter().fold(made, |made, attribute| made.with(attribute.clone()));
    made.with(text_attribute("NX_class", "NXdata")).with(text_attribute("signal", "data")).group("plot", 1).finish()
}

#[test]
fn a_plot_of_nexus_may_link_to_its_signal() {
    let spacing = |file: &[u8]| {
        let (_folder, path) = temp_file("a.nxs", file);
        let source = open(&path, &OpenOptions::default()).unwrap();
        (source.info().calibrated.then_some(source.info().geometry.spacing.to_array()), said(&source.info().notes))
    };
    let (found, notes) = spacing(&of_nexus("pqr", &[], None));
    assert_eq!(found, Some([0.5, 2.0, 10.0]));
    assert!(notes.contains("/plot/data is read, the signal") && !notes.contains("not applied"), "{notes}");
    let at = |name, place| number_attribute(name, &[place]);
    let places = [at("p_indices", 0.0), at("q_indices", 1.0), at("r_indices", 2.0)];
    assert_eq!(spacing(&of_nexus("rqp", &places, None)).0, Some([0.5, 2.0, 10.0]));
    assert_eq!(spacing(&of_nexus("rqp", &[], None)).0, None);
    for field in ["data_scaling_factor", "offset"] {
        let (_, notes) = spacing(&of_nexus("pqr", &[], Some(field)));
        assert!(notes.contains(&format!("/plot/{field} of NeXus change the values: they are not applied")), "{notes}");
    }
    // The dataset by its other name has no axes.
    let (_folder, path) = temp_file("a.nxs", &of_nexus("pqr", &[], None));
    let told = OpenOptions { variable: Some("detector/a".into()), ..OpenOptions::default() };
    assert!(!open(&path, &told).unwrap().info().calibrated);
}

#[test]
fn edges_of_bins_give_their_middles() {
    let made = line(line(line(small(Place::Piece), "p", 2, 10.0), "q", 4, 2.0), "r", 4, 0.5);
    let made = made.with(letters_attribute("axes", "pqr")).with(text_attribute("NX_class", "NXdata"));
    let (_folder, path) = temp_file("a.nxs", &made.with(text_attribute("signal", "a")).group("plot", 0).finish());
    let geometry = open(&path, &OpenOptions::default()).unwrap().info().geometry.clone();
    assert_eq!((geometry.spacing.to_array(), geometry.origin.to_array()), ([0.5, 2.0, 10.0], [1.0, 2.0, 1.0]));
}

#[test]
fn old_coordinates_of_nexus_tell_their_axes() {
    let told = |made: Builder, name: &'static str, axis: f64, count: u64, step: f32| {
        line(made.with(number_attribute("axis", &[axis])), name, count, step)
    };
    let made = told(Builder::new().with(number_attribute("primary", &[1.0])), "b", 2.0, 3, 2.0);
    let made = told(told(told(made, "k", 3.0, 4, 3.0), "a", 1.0, 2, 1.0), "other", 2.0, 3, 9.0);
    let data: Vec<u8> = (0..24).collect();
    let kind = datatype(VoxelType::U8, false);
    let made = made.with(number_attribute("signal", &[1.0])).set("counts", &kind, &[2, 3, 4], &data, Place::Piece);
    let (_folder, path) =
        temp_file("a.nxs", &made.with(text_attribute("NX_class", "NXdata")).group("plot", 0).finish());
    let source = open(&path, &OpenOptions::default()).unwrap();
    assert_eq!(source.info().geometry.spacing.to_array(), [3.0, 2.0, 1.0]);
}

/// A dataset under several names is one, and groups may hold themselves.
#[test]
fn links_to_what_was_seen_are_followed_by_name_alone() {
    let made = small(Place::Piece);
    let (_, at) = made.links[0];
    let made = made.again("b", at).group("inner", 0);
    let (_, inner) = made.links[0];
    let (_folder, path) = temp_file("a.h5", &made.again("outer", inner).finish());
    let none = OpenOptions::default();
    assert!(said(&open(&path, &none).unwrap().info().notes).contains("/inner/a is read, the only volume"));
    for name in ["inner/b", "/outer/a", "outer/b", "a", "b"] {
        let told = OpenOptions { variable: Some(name.into()), ..none.clone() };
        assert_eq!(open(&path, &told).unwrap().info().extent.x, 4, "{name}");
    }
    let told = OpenOptions { variable: Some("outer".into()), ..none };
    assert!(refusal(&path, &told).contains("name a dataset in it: /inner/a (2 x 3 x 4, u8)"));
}

/// Steps of an Imaris file, also behind a link to their group, as recent versions write it.
fn of_imaris(steps: &[&'static str], is_linked: bool) -> Vec<u8> {
    let kind = datatype(VoxelType::U8, false);
    let data: Vec<u8> = (0..24).collect();
    let mut made = Builder::new();
    for (n, &step) in steps.iter().enumerate() {
        made = made.set("Data", &kind, &[2, 3, 4], &data, Place::Chunks([2, 2, 2]));
        for (axis, size) in [("ImageSizeX", "3"), ("ImageSizeY", "3"), ("ImageSizeZ", "1")] {
            made = made.with(letters_attribute(axis, size));
        }
        made = made.group("Channel 0", n).group(step, n);
    }
    let made = made.group("ResolutionLevel 0", 0);
    // A coarser level.
    let made = made.set("Data", &kind, &[2, 3, 4], &data, Place::Piece).group("Channel 0", 1).group("TimePoint 0", 1);
    let mut made = made.group("ResolutionLevel 1", 1).group("DataSet", 0);
    if is_linked {
        let (_, at) = made.links[0];
        made = made.group("InitialImages", 0).again("DataSet", at);
    }
    let kept = made.links.len();
    let made = made.with(letters_attribute("Unit", "um"));
    ["0", "1", "2"]
        .iter()
        .fold(made, |made, axis| {
            let name = |end: &str| format!("Ext{end}{axis}");
            made.with(letters_attribute(&name("Min"), "0")).with(letters_attribute(&name("Max"), "6"))
        })
        .group("Image", kept)
        .group("DataSetInfo", kept)
        .finish()
}

#[test]
fn steps_of_imaris_have_no_gaps() {
    let none = OpenOptions::default();
    for is_linked in [false, true] {
        let (_folder, path) = temp_file("a.ims", &of_imaris(&["TimePoint 0", "TimePoint 1"], is_linked));
        let source = open(&path, &none).unwrap();
        let info = source.info();
        assert_eq!((info.extent.to_array(), info.times, info.channels), ([3, 3, 1], 2, 1));
        let unit = info.geometry.unit.as_deref();
        assert_eq!((info.geometry.spacing.to_array(), unit), ([2.0, 2.0, 6.0], Some("micrometer")));
        let mut out = [0; 9];
        source.read_box(1, 0, info.extent.full_box(), &mut out).unwrap();
        assert_eq!(out, [0, 1, 2, 4, 5, 6, 8, 9, 10]);
    }
    for (steps, missing) in [(["TimePoint 0", "TimePoint 2"], 1), (["TimePoint 1", "TimePoint 2"], 0)] {
        let (_folder, path) = temp_file("a.ims", &of_imaris(&steps, false));
        let message = refusal(&path, &none);
        assert!(message.contains(&format!("without TimePoint {missing}, but with later ones")), "{message}");
    }
}

/// Two time points of one setup, of 16-bit numbers.
fn bdv_builder(sizes: [&[u64; 3]; 2]) -> Builder {
    let kind = datatype(VoxelType::I16, false);
    let mut made = Builder::new();
    for (n, shape) in sizes.into_iter().enumerate() {
        let count = shape.iter().product::<u64>() as usize;
        let data = vec![0xf0 + n as u8; 2 * count];
        made = made.set("cells", &kind, shape, &data, Place::Chunks([2, 2, 2]));
        made = made.group("0", n).group("s00", n).group(["t00000", "t00001"][n], n);
    }
    made.set("resolutions", &datatype(VoxelType::U8, false), &[1, 3], &[1, 1, 1], Place::Piece).group("s00", 2)
}

fn of_bdv(sizes: [&[u64; 3]; 2]) -> Vec<u8> {
    bdv_builder(sizes).finish()
}

/// BigDataViewer's XML of one setup at two time points in `a.h5`, with their last transforms.
fn spim_data(loader: &str, unit: &str, affines: [&str; 2], more: &str) -> String {
    let places: String = (0..2)
        .map(|time| {
            let transform =
                |affine: &str| format!("<ViewTransform type=\"affine\"><affine>{affine}</affine></ViewTransform>");
            let (shift, scale) = (transform(affines[time]), transform("0.5 0 0 0 0 0.5 0 0 0 0 2 0"));
            format!("<ViewRegistration timepoint=\"{time}\" setup=\"0\">{shift}{scale}</ViewRegistration>")
        })
        .collect();
    format!(
        "<?xml version=\"1.0\"?>\n<SpimData version=\"0.2\"><BasePath type=\"relative\">.</BasePath><SequenceDescription>\
         <ImageLoader format=\"{loader}\"><hdf5 type=\"relative\">a.h5</hdf5></ImageLoader><ViewSetups><ViewSetup><id>0</id>\
         <name>a &amp; b</name><size>4 3 2</size><voxelSize><unit>{unit}</unit><size>0.5 0.5 2.0</size></voxelSize>\
         </ViewSetup></ViewSetups><Timepoints type=\"range\"><first>0</first><last>1</last></Timepoints>{more}\
         </SequenceDescription><ViewRegistrations>{places}</ViewRegistrations></SpimData>"
    )
}

#[test]
fn views_of_bigdataviewer_are_steps_and_channels() {
    let (folder, path) = temp_file("a.h5", &of_bdv([&[2, 3, 4], &[2, 3, 4]]));
    let none = OpenOptions::default();
    let alone = open_any(std::slice::from_ref(&path), &none).unwrap();
    let info = alone.info();
    assert_eq!((info.extent.to_array(), info.times, info.channels), ([4, 3, 2], 2, 1));
    assert!(!info.calibrated && said(&info.notes).contains("are in the .xml file"));
    let mut out = [0; 48];
    alone.read_box(1, 0, info.extent.full_box(), &mut out).unwrap();
    assert_eq!((info.voxel_type, VoxelType::U16.read(&out, 23)), (VoxelType::U16, 61937.0), "without a sign");
    let told = OpenOptions { variable: Some("/t00001/s00/0/cells".into()), ..none.clone() };
    assert_eq!(open(&path, &told).unwrap().info().voxel_type, VoxelType::U16, "named by its path, too");
    let xml = folder.path().join("a.xml");
    let open_xml = |loader: &str, unit: &str, affines: [&str; 2], more: &str| {
        let text = spim_data(loader, unit, affines, more);
        std::fs::write(&xml, text).unwrap();
        open_any(std::slice::from_ref(&xml), &none)
            .map(|source| source.info().clone())
            .map_err(|error| error.to_string())
    };
    let moved = "1 0 0 5 0 1 0 6 0 0 1 7";
    let info = open_xml("bdv.hdf5", "µm", [moved; 2], "").unwrap();
    assert_eq!(info.channel_looks[0].name.as_deref(), Some("a & b"));
    assert_eq!(
        (info.geometry.spacing, info.geometry.origin, info.geometry.unit.as_deref()),
        (glam::DVec3::new(0.5, 0.5, 2.0), glam::DVec3::new(5.0, 6.0, 7.0), Some("micrometer"))
    );
    let info = open_xml("bdv.hdf5", "um", [moved, "1 0 0 5 0 1 0 6 0 0 1 8"], "").unwrap();
    assert!(said(&info.notes).contains("Time points lie in unlike places"));
    assert_eq!(info.geometry.origin, glam::DVec3::ZERO);
    let turned = "0 -1 0 5 1 0 0 6 0 0 1 7";
    let orientation = open_xml("bdv.hdf5", "um", [turned; 2], "").unwrap().orientation.unwrap();
    assert_eq!(orientation.step(0), glam::DVec3::new(0.0, 0.5, 0.0));
    let missing = "<MissingViews><MissingView timepoint=\"1\" setup=\"0\"/></MissingViews>";
    assert!(open_xml("bdv.hdf5", "um", [moved; 2], missing).unwrap_err().contains("a missing view (time point 1"));
    assert!(open_xml("bdv.n5", "um", [moved; 2], "").unwrap_err().contains("image loader bdv.n5 is not supported"));
    std::fs::remove_file(&path).unwrap();
    let gone = open_xml("bdv.hdf5", "um", [moved; 2], "").unwrap_err();
    assert!(gone.contains("a.xml: its data file") && gone.contains("a.h5 is missing: put it there"), "{gone}");
    let (_folder, path) = temp_file("a.h5", &of_bdv([&[2, 3, 4], &[2, 3, 5]]));
    assert!(refusal(&path, &none).contains("/t00001/s00/0/cells is damaged: it differs"));
    // A view in neither the file nor the list of missing ones.
    let resolutions = datatype(VoxelType::U8, false);
    let more = bdv_builder([&[2, 3, 4]; 2]).set("resolutions", &resolutions, &[1, 3], &[1, 1, 1], Place::Piece);
    let (_folder, path) = temp_file("a.h5", &more.group("s01", 3).finish());
    let message = refusal(&path, &none);
    assert!(message.contains("/t00000/s01/0/cells, a view that is missing or lies in another file"), "{message}");
    let told = OpenOptions { variable: Some("s00".into()), ..none };
    assert_eq!(open(&path, &told).unwrap().info().times, 2);
}

/// One channel of 3 x 3 x 2 voxels, in a dataset padded along x.
fn coloured_imaris() -> Vec<u8> {
    let data: Vec<u8> = (0..24).collect();
    let sizes = [("ImageSizeX", "3"), ("ImageSizeY", "3"), ("ImageSizeZ", "2")];
    let place = [
        ("ExtMin0", "-1"),
        ("ExtMax0", "5"),
        ("ExtMin1", "0"),
        ("ExtMax1", "3"),
        ("ExtMin2", "0"),
        ("ExtMax2", "1"),
        ("Unit", "um"),
    ];
    let look = [("Name", "dye"), ("Color", "1.0 0.5 0"), ("ColorRange", "0 99.5")];
    let with = |made: Builder, texts: &[(&str, &str)]| {
        texts.iter().fold(made, |made, (name, text)| made.with(letters_attribute(name, text)))
    };
    let kind = datatype(VoxelType::U8, false);
    let mut made = Builder::new().set("Data", &kind, &[2, 3, 4], &data, Place::Chunks([2, 2, 2]));
    made = with(made, &sizes).group("Channel 0", 0).group("TimePoint 0", 0);
    made = made.group("ResolutionLevel 0", 0).group("DataSet", 0);
    made = with(with(made, &place).group("Image", 1), &look).group("Channel 0", 2);
    made.group("DataSetInfo", 1).finish()
}

#[test]
fn images_of_imaris_are_read_without_padding() {
    let (_folder, path) = temp_file("a.ims", &coloured_imaris());
    let source = open_any(&[path], &OpenOptions::default()).unwrap();
    let info = source.info();
    let mut out = [0; 18];
    source.read_box(0, 0, info.extent.full_box(), &mut out).unwrap();
    assert_eq!((info.extent.to_array(), out[17]), ([3, 3, 2], 22));
    assert_eq!(
        (info.geometry.spacing, info.geometry.origin),
        (glam::DVec3::new(2.0, 1.0, 0.5), glam::DVec3::new(0.0, 0.5, 0.25))
    );
    let look = &info.channel_looks[0];
    assert_eq!((look.name.as_deref(), look.color, look.window), (Some("dye"), Some([255, 128, 0]), Some([0.0, 99.5])));
}

#[test]
fn groups_of_old_libraries_are_read() {
    let kind = datatype(VoxelType::U8, false);
    let file = small(Place::Piece).set("mask", &kind, &[2, 3, 4], &[1; 24], Place::Piece).finish_old();
    let (_folder, path) = temp_file("a.h5", &file);
    let told = |name: &str| OpenOptions { variable: Some(name.into()), ..OpenOptions::default() };
    let source = open(&path, &told("a")).unwrap();
    let mut out = [0; 24];
    source.read_box(0, 0, source.info().extent.full_box(), &mut out).unwrap();
    assert_eq!(out[23], 23);
    let message = refusal(&path, &OpenOptions::default());
    assert!(message.contains("/a (2 x 3 x 4, u8), /mask (2 x 3 x 4, u8)"), "{message}");
    assert!(refusal(&path, &told("MAS")).contains("of like names are /a (2 x 3 x 4, u8), /mask (2 x 3 x 4, u8)"));
}

#[test]
fn views_in_too_great_a_number_are_refused() {
    let (folder, _) = temp_file("a.h5", &of_bdv([&[2, 3, 4], &[2, 3, 4]]));
    let xml = folder.path().join("a.xml");
    let setups = "<ViewSetup><id>0</id></ViewSetup>".repeat(2);
    let text = spim_data("bdv.hdf5", "um", ["1 0 0 0 0 1 0 0 0 0 1 0"; 2], "");
    let text =
        text.replace("<last>1</last>", "<last>1000000</last>").replace("</ViewSetups>", &(setups + "</ViewSetups>"));
    std::fs::write(&xml, text).unwrap();
    let message = refusal(&xml, &OpenOptions::default());
    assert!(message.contains("3000003 views"), "{message}");
}

/// Makes the checksums of headers and of the superblock good, so that damage in them is read.
fn mend_checksums(bytes: &mut [u8]) {
    let starts: Vec<usize> = (0..bytes.len() - 10).filter(|at| bytes[*at..].starts_with(b"OHDR\x02\x02")).collect();
    for start in starts {
        let length = u32::from_le_bytes(bytes[start + 6..start + 10].try_into().unwrap()) as usize;
        let end = (start + 10).saturating_add(length);
        if end + 4 <= bytes.len() {
            let sum = jenkins_lookup3(&bytes[start..end]);
            bytes[end..end + 4].copy_from_slice(&sum.to_le_bytes());
        }
    }
    if bytes[8] == 2 {
        let sum = jenkins_lookup3(&bytes[..44]);
        bytes[44..48].copy_from_slice(&sum.to_le_bytes());
    }
}

#[test]
fn the_finest_level_of_imaris_is_read_without_its_padding() {
    let sizes = [("ImageSizeX", "3"), ("ImageSizeY", "3"), ("ImageSizeZ", "2")];
    let mut made = Builder::new();
    // Two steps of two channels, [2, 4, 4] as stored; and a coarser level.
    for n in 0..4 {
        let data: Vec<u8> = (0..32).map(|i| 50 * n + i).collect();
        made = made.set("Data", &datatype(VoxelType::U8, false), &[2, 4, 4], &data, Place::Chunks([2, 2, 2]));
        made = sizes.iter().fold(made, |made, (name, size)| made.with(text_attribute(name, size)));
        let (time, channel) = (usize::from(n / 2), usize::from(n % 2));
        made = made.group(["Channel 0", "Channel 1"][channel], time + channel);
        if channel == 1 {
            made = made.group(["TimePoint 0", "TimePoint 1"][time], time);
        }
    }
    made = made.group("ResolutionLevel 0", 0);
    made = made.set("Data", &datatype(VoxelType::U8, false), &[1, 2, 2], &[9; 4], Place::Chunks([1, 2, 2]));
    made = made.group("Channel 0", 1).group("TimePoint 0", 1).group("ResolutionLevel 1", 1).group("DataSet", 0);
    let ends =
        [("ExtMin0", "1"), ("ExtMax0", "4"), ("ExtMin1", "0"), ("ExtMax1", "6"), ("ExtMin2", "0"), ("ExtMax2", "4")];
    made = ends.iter().fold(made, |made, (name, end)| made.with(text_attribute(name, end))).group("Image", 1);
    made = made.with(text_attribute("Name", "GFP")).with(text_attribute("Color", "0 1 0")).group("Channel 0", 2);
    let (_folder, path) = temp_file("a.ims", &made.group("DataSetInfo", 1).finish());
    let source = open_any(&[path], &OpenOptions::default()).unwrap();
    let info = source.info();
    assert_eq!((info.extent.to_array(), info.times, info.channels), ([3, 3, 2], 2, 2));
    let (spacing, origin) = (glam::DVec3::new(1.0, 2.0, 2.0), glam::DVec3::new(1.5, 1.0, 1.0));
    assert_eq!((info.geometry.spacing, info.geometry.origin), (spacing, origin));
    assert_eq!(info.channel_looks[0].name.as_deref(), Some("GFP"));
    let mut out = [0; 18];
    source.read_box(1, 0, info.extent.full_box(), &mut out).unwrap();
    let at = |z: u8, y: u8, x: u8| 100 + 16 * z + 4 * y + x;
    let expected: Vec<u8> = (0..2).flat_map(|z| (0..3).flat_map(move |y| (0..3).map(move |x| at(z, y, x)))).collect();
    assert_eq!(out[..], expected);
}

proptest! {
    #![proptest_config(crate::testing::cases(300))]

    /// Damage leads to an error or wrong voxels, never to a panic.
    #[test]
    fn damaged_files_do_not_panic(damage in some_damage(), is_chunked in any::<bool>(), is_old in any::<bool>()) {
        let place = if is_chunked { Place::Chunks([1, 2, 3]) } else { Place::Piece };
        let made = small(place).with(number_attribute("element_size_um", &[1.0, 2.0, 3.0]));
        let mut bytes = if is_old { made.finish_old() } else { made.finish() };
        spoil(&mut bytes, &damage);
        mend_checksums(&mut bytes);
        let (_folder, path) = temp_file("a.h5", &bytes);
        try_to_read(&[path]);
    }

    /// As above, of BigDataViewer's XML and the file that it names, and of Imaris.
    #[test]
    fn damaged_views_do_not_panic(
        damage in some_damage(),
        text_damage in damage_of_text(),
        is_text in any::<bool>(),
        is_imaris in any::<bool>(),
    ) {
        let missing = "<MissingViews><MissingView timepoint=\"1\" setup=\"7\"/></MissingViews>";
        let mut text = spim_data("bdv.hdf5", "um", ["1 0 0 5 0 1 0 6 0 0 1 7"; 2], missing).into_bytes();
        let mut bytes = if is_imaris && !is_text { coloured_imaris() } else { of_bdv([&[2, 3, 4], &[2, 3, 4]]) };
        if is_text {
            spoil(&mut text, &text_damage);
        } else {
            spoil(&mut bytes, &damage);
            mend_checksums(&mut bytes);
        }
        let (folder, path) = temp_file("a.h5", &bytes);
        let xml = folder.path().join("a.xml");
        std::fs::write(&xml, text).unwrap();
        try_to_read(&[xml]);
        try_to_read(&[path]);
    }
}

/// Changes of text, mostly to letters that have a meaning in it.
fn damage_of_text() -> impl Strategy<Value = Damage> {
    let letter = prop_oneof![any::<u8>(), prop::sample::select(&b"0123456789-:,.eE<>/\"&; "[..])];
    prop::collection::vec((any::<prop::sample::Index>(), letter), 1..6)
}
