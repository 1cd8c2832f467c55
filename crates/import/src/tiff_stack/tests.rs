//! TIFF files built byte by byte (layouts) and by the library's encoder (compressions), read back.

mod copies;
mod described;
mod sets;

use crate::error::ImportError;
use crate::open::open;
use crate::options::{NoData, OpenOptions};
use crate::source::{Access, Source};
use crate::testing::{Field, alone_with, assert_boxes, assert_takes_what_it_says, is_warned, said, temp_file};
use brickyard_volume::{VoxelBox, VoxelType};
use glam::DVec3;
use proptest::prelude::*;
use std::path::{Path, PathBuf};
use tiff::encoder::{Compression, DeflateLevel, Predictor, TiffEncoder, colortype};

/// Layout of a stack for [`written`].
#[derive(Clone)]
struct Layout {
    big_endian: bool,
    big_tiff: bool,
    /// Width and height of tiles, or the rows of a strip.
    chunk: Result<[u32; 2], u32>,
    samples: u32,
    planar: bool,
    photometric: u16,
    description: String,
    /// Pixels per unit.
    resolution: Option<u32>,
    /// Number of directories, if not one per plane.
    directories: Option<usize>,
    /// The predictor of LZW.
    lzw: Option<u64>,
    /// Additional or replaced directory entries: tag and number.
    tags: Vec<(u16, u64)>,
    /// Additional entries of the first directory: tag, type and numbers, floats by their bits.
    lists: Vec<(u16, u16, Vec<u64>)>,
    /// The same for all other directories.
    other_lists: Vec<(u16, u16, Vec<u64>)>,
    /// Whether the only directory lies before the planes.
    directory_first: bool,
}

impl Default for Layout {
    fn default() -> Self {
        Self {
            big_endian: false,
            big_tiff: false,
            chunk: Err(3),
            samples: 1,
            planar: false,
            photometric: 1,
            description: String::new(),
            resolution: None,
            directories: None,
            lzw: None,
            tags: Vec::new(),
            lists: Vec::new(),
            other_lists: Vec::new(),
            directory_first: false,
        }
    }
}

struct Writer {
    bytes: Vec<u8>,
    layout: Layout,
}

impl Writer {
    fn number(&self, value: u64, width: usize) -> Vec<u8> {
        let mut bytes = value.to_le_bytes()[..width].to_vec();
        if self.layout.big_endian {
            bytes.reverse();
        }
        bytes
    }

    fn put_at(&mut self, at: usize, value: u64, width: usize) {
        let number = self.number(value, width);
        self.bytes[at..at + width].copy_from_slice(&number);
    }

    /// Appends a directory; returns the position of the pointer to the next one.
    fn directory(&mut self, mut tags: Vec<(u16, u16, Vec<u64>)>) -> usize {
        tags.sort_by_key(|t| t.0);
        let (count_width, width) = if self.layout.big_tiff { (8, 8) } else { (2, 4) };
        // Values too long for their entry go before the directory.
        let mut entries = Vec::new();
        for (tag, kind, values) in tags {
            let size = [0, 1, 1, 2, 4, 4, 1, 0, 0, 0, 0, 0, 8, 0, 0, 0, 8][kind as usize];
            let count = if kind == 5 { values.len() / 2 } else { values.len() };
            let data: Vec<u8> = values.iter().flat_map(|&v| self.number(v, size)).collect();
            let mut field = if data.len() > width {
                let at = self.bytes.len() as u64;
                self.bytes.extend(&data);
                self.number(at, width)
            } else {
                data
            };
            field.resize(width, 0);
            entries.extend([
                self.number(tag as u64, 2),
                self.number(kind as u64, 2),
                self.number(count as u64, width),
                field,
            ]);
        }
        let start = self.bytes.len();
        let count = self.number(entries.len() as u64 / 4, count_width);
        self.bytes.extend(count);
        self.bytes.extend(entries.concat());
        self.bytes.extend(vec![0; width]);
        start
    }
}

/// The field as a TIFF file; pages run through the given axes, slowest first, each holding `samples` channels.
fn written(field: Field, page_axes: &str, layout: &Layout) -> Vec<u8> {
    let mut w = Writer { bytes: Vec::new(), layout: layout.clone() };
    w.bytes.extend(if layout.big_endian { b"MM" } else { b"II" });
    let width = if layout.big_tiff { 8 } else { 4 };
    let version = if layout.big_tiff { vec![(43, 2), (8, 2), (0, 2), (0, 8)] } else { vec![(42, 2), (0, 4)] };
    for (value, bytes) in version {
        let number = w.number(value, bytes);
        w.bytes.extend(number);
    }
    let mut link = w.bytes.len() - width;
    let [columns, rows, ..] = field.sizes;
    let voxel = field.voxel_type.bytes();
    // Chunky samples are the fastest axis, planar ones come between the page and its rows.
    let (page_axes, within) = match (layout.samples, layout.planar) {
        (1, _) => (page_axes.to_owned(), "yx"),
        (_, false) => (page_axes.replace('c', ""), "yxc"),
        (_, true) => (page_axes.replace('c', ""), "cyx"),
    };
    let all = field.bytes(&format!("{page_axes}{within}"), layout.big_endian);
    let page_bytes = (columns * rows * layout.samples) as usize * voxel;
    let pages = all.len() / page_bytes;
    let body = w.bytes.len();
    if layout.directories == Some(1) && !layout.directory_first {
        w.bytes.extend(&all);
    }
    for page in all.chunks(page_bytes).take(layout.directories.unwrap_or(pages)) {
        let planes = if layout.planar { layout.samples } else { 1 };
        let pixel = voxel * (layout.samples / planes) as usize;
        let [cw, ch] = layout.chunk.unwrap_or_else(|rows| [columns, rows]);
        let (mut offsets, mut counts) = (Vec::new(), Vec::new());
        for plane in page.chunks(page.len() / planes as usize) {
            for (y0, x0) in
                (0..rows.div_ceil(ch)).flat_map(|r| (0..columns.div_ceil(cw)).map(move |c| (r * ch, c * cw)))
            {
                let start = w.bytes.len();
                let mut chunk = Vec::new();
                // Strips end with the image, tiles are padded.
                let end = if layout.chunk.is_ok() { y0 + ch } else { (y0 + ch).min(rows) };
                for (y, x) in (y0..end).flat_map(|y| (x0..x0 + cw).map(move |x| (y, x))) {
                    let from = (y * columns + x) as usize * pixel;
                    let inside = x < columns && y < rows;
                    chunk.extend(if inside { plane[from..from + pixel].to_vec() } else { vec![0xee; pixel] });
                }
                w.bytes.extend(match layout.lzw {
                    Some(predictor) => {
                        let samples = (layout.samples / planes) as usize;
                        predict(&mut chunk, predictor, layout.big_endian, cw as usize, voxel, samples);
                        weezl::encode::Encoder::with_tiff_size_switch(weezl::BitOrder::Msb, 8).encode(&chunk).unwrap()
                    }
                    None => chunk,
                });
                offsets.push(start as u64);
                counts.push((w.bytes.len() - start) as u64);
            }
        }
        if layout.directories == Some(1) {
            offsets = vec![body as u64];
            counts = vec![page_bytes as u64];
        }
        let format = match field.voxel_type {
            VoxelType::F32 => 3,
            VoxelType::I8 | VoxelType::I16 | VoxelType::I32 => 2,
            _ => 1,
        };
        let per_sample = |v: u64| vec![v; layout.samples as usize];
        let wide = if layout.big_tiff { 16 } else { 4 };
        let mut tags = vec![
            (256, 4, vec![columns as u64]),
            (257, 4, vec![rows as u64]),
            (258, 3, per_sample(voxel as u64 * 8)),
            (259, 3, vec![if layout.lzw.is_some() { 5 } else { 1 }]),
            (262, 3, vec![layout.photometric as u64]),
            (277, 3, vec![layout.samples as u64]),
            (284, 3, vec![1 + layout.planar as u64]),
            (339, 3, per_sample(format)),
        ];
        if layout.chunk.is_ok() {
            let size = [(322, 4, vec![cw as u64]), (323, 4, vec![ch as u64])];
            tags.extend(size.into_iter().chain([(324, wide, offsets), (325, wide, counts)]));
        } else {
            let whole = layout.directories == Some(1);
            let rows_per_strip = if whole { rows } else { ch };
            tags.extend([(278, 4, vec![rows_per_strip as u64]), (273, wide, offsets), (279, wide, counts)]);
        }
        if !layout.description.is_empty() {
            tags.push((270, 2, layout.description.bytes().chain([0]).map(u64::from).collect()));
        }
        if let Some(r) = layout.resolution {
            tags.extend([(282, 5, vec![r as u64, 1]), (283, 5, vec![r as u64, 1])]);
        }
        tags.extend(layout.lzw.map(|predictor| (317, 3, vec![predictor])));
        for &(tag, number) in &layout.tags {
            tags.retain(|(t, ..)| *t != tag);
            tags.push((tag, 3, vec![number]));
        }
        tags.append(&mut w.layout.lists);
        w.layout.lists = layout.other_lists.clone();
        if layout.directory_first {
            w.bytes.truncate(body);
            let mut probe = Writer { bytes: w.bytes.clone(), layout: w.layout.clone() };
            probe.directory(tags.clone());
            tags.iter_mut().filter(|tag| tag.0 == 273).for_each(|tag| tag.2 = vec![probe.bytes.len() as u64]);
        }
        let at = w.directory(tags);
        w.put_at(link, at as u64, width);
        link = w.bytes.len() - width;
        if layout.directory_first {
            w.bytes.extend(&all);
        }
    }
    w.bytes
}

/// Takes differences within the rows of a strip or tile, as predictors 2 (of numbers) and 3 (of floats' bytes) do.
fn predict(chunk: &mut [u8], predictor: u64, big_endian: bool, columns: usize, width: usize, samples: usize) {
    for row in chunk.chunks_mut(columns * width * samples) {
        let numbers: Vec<u64> = row
            .chunks(width)
            .map(|b| {
                b.iter()
                    .enumerate()
                    .fold(0, |n, (i, &b)| n | (b as u64) << (8 * if big_endian { width - 1 - i } else { i }))
            })
            .collect();
        match predictor {
            2 => {
                for (i, out) in row.chunks_mut(width).enumerate() {
                    let before = i.checked_sub(samples).map_or(0, |i| numbers[i]);
                    let bytes = numbers[i].wrapping_sub(before).to_le_bytes();
                    out.iter_mut()
                        .enumerate()
                        .for_each(|(i, b)| *b = bytes[if big_endian { width - 1 - i } else { i }]);
                }
            }
            3 => {
                let by_weight = |weight: usize| numbers.iter().map(move |n| (n >> (8 * (width - 1 - weight))) as u8);
                let sorted: Vec<u8> = (0..width).flat_map(by_weight).collect();
                for (i, out) in row.iter_mut().enumerate() {
                    *out = sorted[i].wrapping_sub(i.checked_sub(samples).map_or(0, |i| sorted[i]));
                }
            }
            _ => {}
        }
    }
}

fn options() -> OpenOptions {
    OpenOptions::default()
}

fn opened(path: &Path) -> Result<Box<dyn Source>, ImportError> {
    open(&[path.to_owned()], &options())
}

fn refusal(bytes: &[u8], options: &OpenOptions) -> String {
    let (_folder, path) = temp_file("a.tif", bytes);
    open(&[path], options).err().unwrap().to_string()
}

/// An image of 5 x 4 pixels in a strip of 40 bytes, with another value of one tag.
fn with_tag(tag: u16, value: u64) -> (Field, Vec<u8>) {
    let field = Field { sizes: [5, 4, 1, 1, 1], voxel_type: VoxelType::U16 };
    (field, written(field, "z", &Layout { chunk: Err(4), tags: vec![(tag, value)], ..Layout::default() }))
}

#[test]
fn pages_of_several_slices_are_refused() {
    for tag in [32997, 32998] {
        let (_, bytes) = with_tag(tag, 3);
        assert!(refusal(&bytes, &options()).contains("3 slices"), "{}", refusal(&bytes, &options()));
        let (field, bytes) = with_tag(tag, 1);
        let (_folder, path) = temp_file("a.tif", &bytes);
        assert_boxes(&*opened(&path).unwrap(), field);
    }
}

#[test]
fn directories_at_impossible_places_are_damage() {
    // A BigTIFF whose first directory is beyond any file's end.
    let bytes = [&b"II+\0\x08\0\0\0"[..], &u64::MAX.to_le_bytes()].concat();
    assert!(refusal(&bytes, &options()).contains("damaged"), "{}", refusal(&bytes, &options()));
}

#[test]
fn several_images_in_ome_xml_are_refused_unless_axes_are_told() {
    let field = Field { sizes: [5, 4, 2, 1, 1], voxel_type: VoxelType::U16 };
    let pixels = r#"<Pixels DimensionOrder="XYZCT" SizeX="5" SizeY="4" SizeZ="1" SizeC="1" SizeT="1"/>"#;
    let description = format!(r#"<OME><Image Name="a">{pixels}</Image><Image Name="b">{pixels}</Image></OME>"#);
    let bytes = written(field, "z", &Layout { description, ..Layout::default() });
    let message = refusal(&bytes, &options());
    assert!(message.contains("2 images, 'a' to 'b'") && message.contains("`axes`"), "{message}");
    let (_folder, path) = temp_file("a.tif", &bytes);
    let told = OpenOptions { axes: Some("zyx".parse().unwrap()), ..options() };
    assert_boxes(&*open(&[path], &told).unwrap(), field);
}

#[test]
fn strips_without_all_their_pixels_are_refused_and_longer_ones_read() {
    const BYTE_COUNTS: u16 = 279;
    let refused = |count| refusal(&with_tag(BYTE_COUNTS, count).1, &options());
    assert!(refused(0).contains("sparse"), "{}", refused(0));
    for count in [39, 60_000] {
        let message = refused(count);
        assert!(message.contains("take 40 bytes") && message.contains(&format!("directory has {count}")), "{message}");
    }
    let (field, bytes) = with_tag(BYTE_COUNTS, 50);
    let (_folder, path) = temp_file("a.tif", &bytes);
    assert_boxes(&*opened(&path).unwrap(), field);
}

#[test]
fn strips_and_tiles_of_every_type_and_order_are_read() {
    for (i, voxel_type) in VoxelType::ALL.into_iter().enumerate() {
        for (j, chunk) in [Err(3), Err(1), Err(100), Ok([16, 16]), Ok([16, 32])].into_iter().enumerate() {
            let field = Field { sizes: [37, 19, 3, 1, 1], voxel_type };
            let layout = Layout { big_endian: (i + j) % 2 == 0, big_tiff: j % 2 == 0, chunk, ..Layout::default() };
            let (_folder, path) = temp_file("a b.tif", &written(field, "z", &layout));
            let source = opened(&path).unwrap();
            assert_eq!(source.access(), Access::Planes);
            assert_boxes(&*source, field);
        }
    }
}

#[test]
fn samples_become_channels() {
    let field = Field { sizes: [21, 18, 2, 3, 1], voxel_type: VoxelType::U16 };
    for planar in [false, true] {
        for chunk in [Err(5), Ok([16, 16])] {
            let layout = Layout { samples: 3, photometric: 2, planar, chunk, ..Layout::default() };
            let (_folder, path) = temp_file("a.tif", &written(field, "zc", &layout));
            let source = opened(&path).unwrap();
            assert_boxes(&*source, field);
            assert!(source.info().notes[0].contains("3 samples"));
        }
    }
}

#[test]
fn white_is_zero_keeps_the_stored_values() {
    let field = Field { sizes: [7, 5, 2, 1, 1], voxel_type: VoxelType::U16 };
    let layout = Layout { photometric: 0, ..Layout::default() };
    let (_folder, path) = temp_file("a.tif", &written(field, "z", &layout));
    let source = opened(&path).unwrap();
    assert_boxes(&*source, field);
    assert!(said(&source.info().notes).starts_with("note: Small values are meant to be shown bright"));
    // Floats are not undone.
    let floats = Field { voxel_type: VoxelType::F32, ..field };
    let message = refusal(&written(floats, "z", &layout), &options());
    assert!(message.contains("MINISBLACK"), "{message}");
}

#[test]
fn indices_into_a_palette_are_the_values() {
    for (big_endian, big_tiff, lzw, voxel_type) in [
        (false, false, None, VoxelType::U8),
        (true, false, Some(2), VoxelType::U16),
        (false, true, Some(1), VoxelType::U8),
        (true, true, None, VoxelType::U16),
    ] {
        let field = Field { sizes: [7, 5, 3, 1, 1], voxel_type };
        let layout = Layout { photometric: 3, big_endian, big_tiff, lzw, ..Layout::default() };
        let (_folder, path) = temp_file("a.tif", &written(field, "z", &layout));
        let source = opened(&path).unwrap();
        assert_boxes(&*source, field);
        assert!(source.info().notes.iter().any(|note| note.contains("the indices are read")));
    }
    // Beside pages of numbers, and with fewer bits than supported.
    let field = Field { sizes: [7, 5, 2, 1, 1], voxel_type: VoxelType::U8 };
    let mut bytes = written(field, "z", &Layout { photometric: 3, ..Layout::default() });
    let at = bytes.windows(10).rposition(|w| w == [6, 1, 3, 0, 1, 0, 0, 0, 3, 0]).unwrap();
    bytes[at + 8] = 1;
    assert!(refusal(&bytes, &options()).contains("(indices into a palette)"));
    let few = Layout { photometric: 3, tags: vec![(258, 4)], ..Layout::default() };
    let message = refusal(&written(field, "z", &few), &options());
    assert!(message.contains("is not supported; write its pixels again as numbers of 8"), "{message}");
}

#[test]
fn compressions_and_predictors_are_undone() {
    let field = Field { sizes: [33, 14, 3, 1, 1], voxel_type: VoxelType::U16 };
    let values: Vec<u16> = field.bytes("zyx", false).as_chunks().0.iter().map(|b| u16::from_le_bytes(*b)).collect();
    let compressions =
        [Compression::Uncompressed, Compression::Lzw, Compression::Deflate(DeflateLevel::Fast), Compression::Packbits];
    for compression in compressions {
        for predictor in [Predictor::None, Predictor::Horizontal] {
            let (_folder, path) = temp_file("a.tif", b"");
            let file = std::fs::File::create(&path).unwrap();
            let mut encoder = TiffEncoder::new(file).unwrap().with_compression(compression).with_predictor(predictor);
            for plane in values.chunks(33 * 14) {
                encoder.write_image::<colortype::Gray16>(33, 14, plane).unwrap();
            }
            drop(encoder);
            assert_boxes(&*opened(&path).unwrap(), field);
        }
    }
}

#[test]
fn lzw_strips_and_tiles_of_every_type_are_read() {
    let mut cases = 0..;
    for voxel_type in VoxelType::ALL {
        for chunk in [Err(3), Err(100), Ok([16, 16]), Ok([32, 16]), Ok([64, 32])] {
            for predictor in [1, 2, 3] {
                if predictor == 3 && voxel_type != VoxelType::F32 {
                    continue;
                }
                let i = cases.next().unwrap();
                let samples = 1 + i % 3;
                let field = Field { sizes: [37, 19 + i % 7, 2, samples, 1], voxel_type };
                let layout = Layout {
                    big_endian: i % 2 == 0,
                    big_tiff: i % 5 == 0,
                    planar: i % 4 == 0,
                    lzw: Some(predictor),
                    samples,
                    chunk,
                    ..Layout::default()
                };
                let (_folder, path) = temp_file("a.tif", &written(field, "zc", &layout));
                assert_boxes(&*opened(&path).unwrap(), field);
            }
        }
    }
}

#[test]
fn an_lzw_tile_that_claims_too_much_is_refused() {
    let field = Field { sizes: [7, 5, 1, 1, 1], voxel_type: VoxelType::U8 };
    let mut bytes = written(field, "z", &Layout { lzw: Some(1), chunk: Ok([16, 16]), ..Layout::default() });
    let width = bytes.windows(4).rposition(|w| w == [0x42, 1, 4, 0]).unwrap() + 8;
    bytes[width..width + 4].copy_from_slice(&0xffff_fff0u32.to_le_bytes());
    let (_folder, path) = temp_file("a.tif", &bytes);
    let read = opened(&path).and_then(|source| source.read_box(0, 0, source.info().extent.full_box(), &mut [0; 35]));
    assert!(read.unwrap_err().to_string().contains("cannot hold 5 rows of 4294967280"));
}

#[test]
fn damaged_lzw_names_the_chunk() {
    let field = Field { sizes: [37, 19, 1, 1, 1], voxel_type: VoxelType::U8 };
    let bytes = written(field, "z", &Layout { lzw: Some(1), chunk: Ok([16, 16]), ..Layout::default() });
    let mut short = bytes.clone();
    // The third tile, cut to a clear and an end code.
    let entry = short.windows(4).rposition(|w| w == [0x44, 1, 4, 0]).unwrap();
    let list = u32::from_le_bytes(short[entry + 8..entry + 12].try_into().unwrap()) as usize + 8;
    let third = u32::from_le_bytes(short[list..list + 4].try_into().unwrap()) as usize;
    short[third..third + 4].copy_from_slice(&[0x80, 0x40, 0x40, 0x20]);
    let (_folder, path) = temp_file("a.tif", &short);
    let source = opened(&path).unwrap();
    let mut out = vec![0; 37 * 19];
    let message = source.read_box(0, 0, source.info().extent.full_box(), &mut out).unwrap_err().to_string();
    assert!(message.contains("strip or tile 2 cannot be decoded") && message.contains("of 256 bytes"), "{message}");
}

#[test]
fn packings_that_cannot_be_read_are_refused_at_opening() {
    let field = Field { sizes: [7, 5, 2, 1, 1], voxel_type: VoxelType::U8 };
    for (tag, number, words) in [
        (259, 34925, "compression 34925 (LZMA) is not supported; write it again"),
        (259, 50001, "WebP"),
        (259, 34887, "LERC"),
        (259, 4711, "compression 4711 (unknown)"),
        (266, 2, "FillOrder"),
    ] {
        let layout = Layout { tags: vec![(tag, number)], ..Layout::default() };
        let message = refusal(&written(field, "z", &layout), &options());
        assert!(message.contains("a.tif: ") && message.contains(words), "{message}");
    }
    // Four samples, the fourth of unknown meaning; and a predictor for floats.
    let four = Field { sizes: [7, 5, 2, 4, 1], ..field };
    let extra = Layout { samples: 4, photometric: 2, tags: vec![(338, 0)], ..Layout::default() };
    let message = refusal(&written(four, "zc", &extra), &options());
    assert!(message.contains("4 samples a pixel, of which only 3 have a known meaning"), "{message}");
    let floats = Layout { tags: vec![(317, 3)], lzw: Some(1), ..Layout::default() };
    assert!(refusal(&written(field, "z", &floats), &options()).contains("predictor of integers"));
    let signed = Layout { photometric: 0, ..Layout::default() };
    let message = refusal(&written(Field { voxel_type: VoxelType::I16, ..field }, "z", &signed), &options());
    assert!(message.contains("not supported"), "{message}");
}

#[test]
fn pixels_and_directories_that_are_not_read_are_named() {
    for (tag, number, words) in [
        (258, 24, "write its pixels again as numbers of 8, 16, 32 or 64 bits"),
        (262, 77, "PhotometricInterpretation"),
        (339, 5, "complex numbers"),
        (339, 9, "samples of a non-standard format (9)"),
        (
            278,
            2,
            "number of strips, tiles or samples in its directory does not match its sizes (pages of several slices",
        ),
    ] {
        let message = refusal(&with_tag(tag, number).1, &options());
        assert!(message.contains("a.tif: ") && message.contains(words), "{message}");
        assert!(!message.contains("is unsupported"), "{message}");
    }
    let floats = Layout { tags: vec![(258, 24), (339, 3)], ..Layout::default() };
    let field = Field { sizes: [5, 4, 1, 1, 1], voxel_type: VoxelType::F32 };
    let message = refusal(&written(field, "z", &floats), &options());
    assert!(message.contains("numbers of 24 bits is not supported; write its pixels again"), "{message}");
    let (_, mut bytes) = with_tag(259, 1);
    let at = bytes.windows(4).position(|w| w == [23, 1, 4, 0]).unwrap();
    // Another tag in place of the strips' lengths.
    bytes[at] = 24;
    let message = refusal(&bytes, &options());
    assert!(message.contains("lacks the offsets or the lengths of strips") && message.contains("tiffcp"), "{message}");
    // A directory that links to itself.
    let (_, mut bytes) = with_tag(259, 1);
    let directory: [u8; 4] = bytes[4..8].try_into().unwrap();
    let link = bytes.len() - 4;
    bytes[link..].copy_from_slice(&directory);
    let message = refusal(&bytes, &options());
    assert!(message.contains("its directories form a loop; `tiffcp IN,0 OUT`"), "{message}");
}

#[test]
fn damaged_data_are_told_from_damaged_directories() {
    for (compression, byte, words) in [
        (8, 0x55, "its data are damaged (corrupt deflate stream)"),
        // Only bytes without effect.
        (32773, 0x80, "its data end before its pixels do"),
        (50000, 0x55, "its data are damaged ("),
    ] {
        let (_, mut bytes) = with_tag(259, compression);
        bytes[8..48].fill(byte);
        let (_folder, path) = temp_file("a.tif", &bytes);
        let source = opened(&path).unwrap();
        let error = source.read_box(0, 0, source.info().extent.full_box(), &mut [0; 40]).unwrap_err();
        let expected = format!("a.tif: strip or tile 0 cannot be decoded: {words}");
        let message = error.to_string();
        assert!(message.contains(&expected) && message.ends_with("; fetch the file again"), "{message}");
    }
}

#[test]
fn jpeg_that_is_not_read_is_no_damage() {
    for (marker, kind) in [(0xc3, "lossless"), (0xc9, "arithmetic-coded"), (0xc5, "hierarchical")] {
        let (_, mut bytes) = with_tag(259, 7);
        // The strip begins behind the file's header. Tables and a note come before the frame.
        let head = [0xff, 0xd8, 0xff, 0xff, 0xe0, 0, 4, 1, 2, 0xff, 0xc4, 0, 2, 0xff, marker, 0, 2];
        bytes[8..8 + head.len()].copy_from_slice(&head);
        let message = refusal(&bytes, &options());
        assert!(message.contains(&format!("{kind} JPEG is not supported; write it again")), "{message}");
    }
}

/// All voxels of a source of one channel and step.
fn values(source: &dyn Source) -> Vec<f64> {
    let info = source.info();
    let count = info.extent.volume() as usize;
    let mut out = vec![0; count * info.voxel_type.bytes()];
    source.read_box(0, 0, info.extent.full_box(), &mut out).unwrap();
    (0..count).map(|i| info.voxel_type.read(&out, i)).collect()
}

#[test]
fn imagej_values_are_calibrated() {
    let field = Field { sizes: [7, 5, 3, 1, 1], voxel_type: VoxelType::U16 };
    let plain = Layout { description: "ImageJ=1.53t\nimages=3\nslices=3\n".into(), ..Layout::default() };
    let (_folder, path) = temp_file("a.tif", &written(field, "z", &plain));
    let stored = values(&*opened(&path).unwrap());
    for directories in [None, Some(1)] {
        for (lines, scale, voxel_type) in [
            ("cf=0\nc0=-32768.0\nc1=1.0\nvunit=Gray Value\n", (1.0, -32768.0), VoxelType::I16),
            ("c0=10\nc1=0.5\nvunit=HU\n", (0.5, 10.0), VoxelType::F32),
            ("cf=7\nc0=10\nc1=0.5\nvunit=HU\n", (1.0, 0.0), VoxelType::U16),
            ("cf=20\nc0=10\nc1=0.5\n", (1.0, 0.0), VoxelType::U16),
        ] {
            let description = format!("{}{lines}", plain.description);
            let layout = Layout { description, directories, big_endian: true, ..plain.clone() };
            let (_folder, path) = temp_file("a.tif", &written(field, "z", &layout));
            let source = opened(&path).unwrap();
            let expected: Vec<f64> = stored.iter().map(|v| v * scale.0 + scale.1).collect();
            assert_eq!((source.info().voxel_type, values(&*source)), (voxel_type, expected), "{lines}");
            let notes = said(&source.info().notes);
            assert_eq!(notes.contains("scaled by"), scale != (1.0, 0.0), "{notes}");
            let unit = source.info().channel_looks.iter().find_map(|look| look.unit.as_deref());
            assert_eq!(unit, (scale.0 == 0.5).then_some("HU"), "{lines}");
            assert_eq!(notes.contains("Rodbard (cf=7), is not applied"), lines.starts_with("cf=7"), "{notes}");
        }
    }
}

/// ImageJ 1.53t writes `min=32688` for -80 in an image of signed numbers, which it stores with an offset.
#[test]
fn imagej_display_ranges_are_of_stored_numbers() {
    for (voxel_type, lines, expected) in [
        (VoxelType::U16, "min=32688.0\nmax=32808.0\n", Some([32688.0, 32808.0])),
        (VoxelType::U16, "c0=-32768.0\nc1=1.0\nmin=32688.0\nmax=32808.0\n", Some([-80.0, 40.0])),
        (VoxelType::U8, "c0=10.0\nc1=0.5\nmin=2.0\nmax=6.0\n", Some([11.0, 13.0])),
        (VoxelType::U8, "c0=10.0\nc1=-1.0\nmin=2.0\nmax=6.0\n", Some([4.0, 8.0])),
        (VoxelType::U8, "cf=7\nc0=10.0\nc1=0.5\nmin=2.0\nmax=6.0\n", Some([2.0, 6.0])),
        (VoxelType::I16, "min=32688.0\nmax=32808.0\n", Some([-80.0, 40.0])),
        (VoxelType::I16, "c0=-32768.0\nc1=1.0\nmin=32688.0\nmax=32808.0\n", Some([-80.0, 40.0])),
        (VoxelType::I8, "min=200.0\nmax=210.0\n", None),
        (VoxelType::F32, "min=-2.5\nmax=3.0\n", Some([-2.5, 3.0])),
    ] {
        let field = Field { sizes: [7, 5, 3, 1, 1], voxel_type };
        let description = format!("ImageJ=1.53t\nimages=3\nslices=3\n{lines}");
        let (_folder, path) = temp_file("a.tif", &written(field, "z", &Layout { description, ..Layout::default() }));
        let found = opened(&path).unwrap().info().channel_looks.first().and_then(|look| look.window);
        assert_eq!(found, expected, "{voxel_type}: {lines}");
    }
}

#[test]
fn planes_that_are_calibrated_unalike_are_refused() {
    let field = Field { sizes: [7, 5, 1, 1, 1], voxel_type: VoxelType::U8 };
    let folder = tempfile::tempdir().unwrap();
    for (i, c0) in [-5, -5, -6].into_iter().enumerate() {
        let layout = Layout { description: format!("ImageJ=1.53t\nc0={c0}\nc1=1\n"), ..Layout::default() };
        std::fs::write(folder.path().join(format!("s{i}.tif")), written(field, "z", &layout)).unwrap();
    }
    let message = opened(folder.path()).err().unwrap().to_string();
    assert!(message.contains("s2.tif: its values are calibrated"), "{message}");
    std::fs::remove_file(folder.path().join("s2.tif")).unwrap();
    assert_eq!(opened(folder.path()).unwrap().info().voxel_type, VoxelType::I16);
}

#[test]
fn halves_are_widened_and_doubles_kept_where_they_fit() {
    let halves = Field { sizes: [8, 5, 2, 1, 1], voxel_type: VoxelType::I16 };
    for lzw in [None, Some(1)] {
        let layout = Layout { tags: vec![(339, 3)], lzw, big_endian: true, ..Layout::default() };
        let (_folder, path) = temp_file("a.tif", &written(halves, "z", &layout));
        let source = opened(&path).unwrap();
        assert_eq!(source.info().voxel_type, VoxelType::F32);
        let bits: Vec<u16> = halves.bytes("zyx", false).as_chunks().0.iter().map(|b| u16::from_le_bytes(*b)).collect();
        for (found, bits) in values(&*source).into_iter().zip(bits) {
            let expected = half::f16::from_bits(bits).to_f64();
            assert!(found == expected || found.is_nan() && expected.is_nan(), "{found} {expected}");
        }
    }
    let file = |values: [f64; 4]| {
        let (folder, path) = temp_file("a.tif", b"");
        let mut encoder = TiffEncoder::new(std::fs::File::create(&path).unwrap()).unwrap();
        encoder.write_image::<colortype::Gray64Float>(2, 2, &values).unwrap();
        drop(encoder);
        (folder, path)
    };
    let (_folder, path) = file([0.5, -3.0, f64::NAN, 16777216.0]);
    assert_eq!(values(&*opened(&path).unwrap())[..2], [0.5, -3.0]);
    let (_folder, path) = file([0.5, 1e39, 0.1, 0.0]);
    assert!(opened(&path).err().unwrap().to_string().contains("`allow_lossy`"));
    let source = open(&[path], &OpenOptions { allow_lossy: true, ..options() }).unwrap();
    assert_eq!(values(&*source)[1], f64::INFINITY);
    assert!(said(&source.info().notes).contains("of 4 values in a.tif, 1 infinite, 1 rounded"));
    assert!(is_warned(&said(&source.info().notes), "of 4 values in a.tif, 1 infinite, 1 rounded"));
}

/// An entry holds up to four characters itself; [`with_tag`] writes 16 bits, so two of them.
#[test]
fn pixels_without_data_are_those_of_gdals_tag() {
    let [file, of_letters] = ["17", "x9"].map(|text| {
        let number = u16::from_le_bytes(text.as_bytes().try_into().unwrap());
        with_tag(42113, number.into()).1
    });
    let nodata = |bytes: &[u8], options: &OpenOptions| {
        let (_folder, path) = temp_file("a.tif", bytes);
        open(&[path], options).map(|source| source.info().nodata).map_err(|error| error.to_string())
    };
    // A 16-bit number is no text.
    assert_eq!(nodata(&file, &options()), Ok(None));
    let as_text = |bytes: &[u8]| {
        let mut bytes = bytes.to_vec();
        let entry = bytes.windows(4).position(|w| w == [0x81, 0xa4, 3, 0]).unwrap();
        bytes[entry + 2..entry + 8].copy_from_slice(&[2, 0, 2, 0, 0, 0]);
        bytes
    };
    assert_eq!(nodata(&as_text(&file), &options()), Ok(Some(17.0)));
    assert_eq!(nodata(&as_text(&of_letters), &options()), Ok(None));
    let with = |nodata| OpenOptions { nodata, ..options() };
    assert_eq!(nodata(&as_text(&file), &with(NoData::None)), Ok(None));
    assert_eq!(nodata(&as_text(&file), &with(NoData::Value(9.0))), Ok(Some(9.0)));
    let refused = nodata(&as_text(&file), &with(NoData::Value(-1.0))).unwrap_err();
    assert!(
        refused.contains("`nodata` -1: voxels are u16, expected one of the whole numbers from 0 to 65535"),
        "{refused}"
    );
}

const HYPERSTACK: &str =
    "ImageJ=1.53t\nimages=30\nchannels=2\nslices=5\nframes=3\nhyperstack=true\nspacing=2.5\nunit=um\n";

#[test]
fn imagej_hyperstacks_are_unravelled() {
    let field = Field { sizes: [7, 5, 5, 2, 3], voxel_type: VoxelType::U16 };
    for directories in [None, Some(1)] {
        let layout = Layout {
            description: HYPERSTACK.into(),
            resolution: Some(4),
            directories,
            big_endian: true,
            ..Layout::default()
        };
        let bytes = written(field, "tzc", &layout);
        let (_folder, path) = temp_file("a.tif", &bytes);
        let source = opened(&path).unwrap();
        assert_boxes(&*source, field);
        let info = source.info();
        assert_eq!((info.geometry.spacing, info.calibrated), (DVec3::new(0.25, 0.25, 2.5), true));
        assert_eq!(info.geometry.unit.as_deref(), Some("micrometer"));
    }
}

#[test]
fn imagej_composites_may_have_their_channels_as_samples() {
    let field = Field { sizes: [5, 4, 1, 3, 1], voxel_type: VoxelType::U16 };
    for planar in [false, true] {
        let layout = Layout {
            samples: 3,
            planar,
            photometric: 2,
            description: "ImageJ=1.53c\nchannels=3\nmode=composite\n".into(),
            ..Layout::default()
        };
        let (_folder, path) = temp_file("a.tif", &written(field, "zc", &layout));
        let source = opened(&path).unwrap();
        assert_boxes(&*source, field);
        let look = &source.info().channel_looks[1];
        assert_eq!((look.name.as_deref(), look.color), (Some("green"), Some([0, 255, 0])));
    }
}

#[test]
fn imagej_latin_1_units_are_understood() {
    let field = Field { sizes: [2, 2, 2, 1, 1], voxel_type: VoxelType::U8 };
    let layout =
        Layout { description: "ImageJ=1.0\nimages=2\nunit=#m\n".into(), resolution: Some(1), ..Layout::default() };
    let mut bytes = written(field, "z", &layout);
    for i in bytes.windows(7).enumerate().filter(|w| w.1 == b"unit=#m").map(|w| w.0).collect::<Vec<_>>() {
        bytes[i + 5] = 0xb5;
    }
    let (_folder, path) = temp_file("a.tif", &bytes);
    assert_eq!(opened(&path).unwrap().info().geometry.unit.as_deref(), Some("micrometer"));
}

#[test]
fn declared_counts_that_disagree_name_both() {
    let field = Field { sizes: [7, 5, 5, 2, 2], voxel_type: VoxelType::U8 };
    let layout = Layout { description: HYPERSTACK.into(), ..Layout::default() };
    let bytes = written(field, "tzc", &layout);
    let message = refusal(&bytes, &options());
    assert!(message.contains("30 planes") && message.contains("20 pages") && message.contains("`axes`"), "{message}");
    // The user may override the description.
    let (_folder, path) = temp_file("a.tif", &bytes);
    let told = OpenOptions { axes: Some("zyx".parse().unwrap()), ..options() };
    assert_eq!(open(&[path], &told).unwrap().info().extent.z, 20);
    // One directory, without all planes behind it.
    let layout = Layout { directories: Some(1), ..layout };
    let message = refusal(&written(Field { voxel_type: VoxelType::U16, ..field }, "tzc", &layout), &options());
    assert!(message.contains("30 planes") && message.contains("missing"), "{message}");
}

#[test]
fn ome_xml_orders_pages() {
    let field = Field { sizes: [7, 5, 4, 2, 3], voxel_type: VoxelType::U16 };
    for (order, axes) in [("XYZCT", "tcz"), ("XYCZT", "tzc"), ("XYTZC", "czt")] {
        let description = format!(
            "<?xml version=\"1.0\"?><OME><Image><Pixels DimensionOrder=\"{order}\" SizeX=\"7\" SizeY=\"5\" SizeZ=\"4\" \
             SizeC=\"2\" SizeT=\"3\" PhysicalSizeX=\"0.5\" PhysicalSizeY=\"0.5\" PhysicalSizeZ=\"1.5\"/></Image></OME>"
        );
        let layout = Layout { description: description.clone(), ..Layout::default() };
        let (_folder, path) = temp_file("a.ome.tif", &written(field, axes, &layout));
        let source = opened(&path).unwrap();
        assert_boxes(&*source, field);
        assert_eq!(source.info().geometry.spacing, DVec3::new(0.5, 0.5, 1.5));
        let more = Layout { description: description.replace("SizeZ=\"4\"", "SizeZ=\"9\""), ..Layout::default() };
        let message = refusal(&written(field, axes, &more), &options());
        assert!(message.contains("54 planes") && message.contains("24 pages"), "{message}");
    }
}

#[test]
fn pages_go_where_the_user_says() {
    let field = Field { sizes: [7, 5, 4, 2, 3], voxel_type: VoxelType::U8 };
    let (_folder, path) = temp_file("a.tif", &written(field, "ctz", &Layout::default()));
    let told =
        |axes: &str, channels, times| OpenOptions { axes: Some(axes.parse().unwrap()), channels, times, ..options() };
    assert_boxes(&*open(std::slice::from_ref(&path), &told("ctzyx", Some(2), Some(3))).unwrap(), field);
    assert_eq!(open(std::slice::from_ref(&path), &told("tyx", None, None)).unwrap().info().times, 24);
    let why = |o| open(std::slice::from_ref(&path), &o).err().unwrap().to_string();
    assert!(why(told("ctzyx", Some(2), None)).contains("`times`"));
    assert!(why(told("ctzyx", Some(5), Some(3))).contains("do not divide"));
    assert!(why(told("zxy", None, None)).contains("do not end in yx"));
}

/// Single-plane files `s0.tif`, `s1.tif`, ... in one folder.
fn planes(field: Field) -> (tempfile::TempDir, Vec<PathBuf>) {
    let folder = tempfile::tempdir().unwrap();
    let all = field.bytes("zyx", false);
    let [x, y, z, ..] = field.sizes;
    let paths = (0..z).map(|i| {
        // A plane's file is a stack of one, with its bytes replaced by the plane's.
        let one = Field { sizes: [x, y, 1, 1, 1], ..field };
        let mut bytes = written(one, "z", &Layout { chunk: Err(y), ..Layout::default() });
        let plane = &all[i as usize * all.len() / z as usize..][..all.len() / z as usize];
        bytes[8..8 + plane.len()].copy_from_slice(plane);
        let path = folder.path().join(format!("s{i}.tif"));
        std::fs::write(&path, bytes).unwrap();
        path
    });
    let paths = paths.collect();
    (folder, paths)
}

#[test]
fn folders_and_lists_of_planes_are_read_in_natural_order() {
    let field = Field { sizes: [7, 5, 12, 1, 1], voxel_type: VoxelType::U16 };
    let (folder, mut paths) = planes(field);
    std::fs::write(folder.path().join("notes.txt"), "x").unwrap();
    let source = opened(folder.path()).unwrap();
    assert_boxes(&*source, field);
    assert!(source.info().notes[0].contains("from s0.tif to s11.tif"), "{:?}", source.info().notes);
    // In a shell's order.
    paths.sort();
    assert_boxes(&*open(&paths, &options()).unwrap(), field);
}

#[test]
fn planes_that_disagree_name_the_odd_one() {
    let field = Field { sizes: [7, 5, 4, 1, 1], voxel_type: VoxelType::U16 };
    let (folder, paths) = planes(field);
    let odd = Field { sizes: [5, 7, 1, 1, 1], ..field };
    std::fs::write(&paths[2], written(odd, "z", &Layout::default())).unwrap();
    let message = opened(folder.path()).err().unwrap().to_string();
    assert!(message.contains("s2.tif") && message.contains("5x7") && message.contains("7x5"), "{message}");
    std::fs::write(&paths[2], written(field, "z", &Layout::default())).unwrap();
    let message = opened(folder.path()).err().unwrap().to_string();
    assert!(message.contains("s2.tif") && message.contains("several planes"), "{message}");
    let empty = tempfile::tempdir().unwrap();
    assert!(opened(empty.path()).err().unwrap().to_string().contains("without readable files"));
}

#[test]
fn pages_of_another_size_within_a_file_are_refused() {
    let field = Field { sizes: [7, 5, 3, 1, 1], voxel_type: VoxelType::U8 };
    let mut bytes = written(field, "z", &Layout::default());
    // The last directory's width is the first value of tag 256.
    let at = bytes.windows(8).rposition(|w| w == [0, 1, 4, 0, 1, 0, 0, 0]).unwrap() + 8;
    bytes[at] = 6;
    let message = refusal(&bytes, &options());
    assert!(message.contains("page 3 is 6x5 u8") && message.contains("page 1 is 7x5 u8"), "{message}");
}

#[test]
fn cut_files_are_refused_at_opening() {
    let field = Field { sizes: [40, 30, 3, 1, 1], voxel_type: VoxelType::U8 };
    let bytes = written(field, "z", &Layout::default());
    for keep in [bytes.len() - 1, bytes.len() / 2, 100, 9, 3, 0] {
        let message = refusal(&bytes[..keep], &options());
        assert!(message.contains("a.tif"), "{message}");
    }
    // A whole directory before truncated data.
    let mut late = bytes.clone();
    let strips = late.windows(2).rposition(|w| w == [0x11, 1]).unwrap();
    let list = u32::from_le_bytes(late[strips + 8..strips + 12].try_into().unwrap()) as usize;
    late[list..list + 4].copy_from_slice(&(bytes.len() as u32).to_le_bytes());
    let message = refusal(&late, &options());
    assert!(message.contains("data of page 3") && message.contains("missing"), "{message}");
}

/// The pixels are all there, but neither their values nor their sizes could be known.
#[test]
fn tags_whose_values_are_cut_off_are_damage() {
    let field = Field { sizes: [7, 5, 1, 1, 1], voxel_type: VoxelType::U16 };
    let description = "ImageJ=1.53t\ncf=0\nc0=-100.0\nc1=2.0\n".into();
    let layout = Layout { description, resolution: Some(3), ..Layout::default() };
    let bytes = written(field, "", &layout);
    assert!(opened(&temp_file("a.tif", &bytes).1).is_ok());
    for entry in [[0x0e, 1, 2, 0], [0x1a, 1, 5, 0]] {
        let mut cut = bytes.clone();
        let at = cut.windows(4).position(|field| field == entry).unwrap() + 8;
        cut[at..at + 4].copy_from_slice(&(bytes.len() as u32 - 7).to_le_bytes());
        let message = refusal(&cut, &options());
        assert!(message.contains("a.tif: cut short: the value of a tag lies past"), "{message}");
    }
}

/// A strip is decoded at once, even if it is a whole plane.
#[cfg(target_os = "linux")]
#[test]
fn a_plane_of_one_strip_takes_what_it_says() {
    let file = alone_with("tiff_stack::tests::a_plane_of_one_strip_takes_what_it_says", |path| {
        let field = Field { sizes: [1500, 1500, 1, 1, 1], voxel_type: VoxelType::U32 };
        let layout = Layout { chunk: Err(1500), ..Layout::default() };
        std::fs::write(path, written(field, "z", &layout)).unwrap();
    });
    if let Some(path) = file {
        assert_takes_what_it_says(|| opened(&path).unwrap(), 1500 * 1500 * 4);
    }
}

/// Files are reopened for reading: each must still be the one whose pages were checked.
#[test]
fn planes_that_change_after_they_were_opened_are_an_error() {
    let field = Field { sizes: [7, 5, 4, 1, 1], voxel_type: VoxelType::U16 };
    for (is_list, width) in [(true, 7), (true, 3), (false, 7), (false, 3)] {
        let (folder, paths) = planes(field);
        let stack = folder.path().join("stack");
        std::fs::write(&stack, written(field, "z", &Layout::default())).unwrap();
        let stack = [stack];
        let paths = if is_list { &paths[..] } else { &stack };
        let source = open(paths, &options()).unwrap();
        let changed = &paths[paths.len() - 1];
        let other = Field { sizes: [width, 5, if is_list { 1 } else { 4 }, 1, 1], ..field };
        let new = folder.path().join("new");
        std::fs::write(&new, written(other, "z", &Layout::default())).unwrap();
        std::fs::File::options().write(true).open(&new).unwrap().set_modified(std::time::UNIX_EPOCH).unwrap();
        std::fs::rename(new, changed).unwrap();
        let full = source.info().extent.full_box();
        let message = source.read_box(0, 0, full, &mut [0; 7 * 5 * 4 * 2]).unwrap_err().to_string();
        assert!(
            message.contains("changed while it was read") && message.contains(changed.to_str().unwrap()),
            "{message}"
        );
    }
}

#[test]
fn many_threads_read_at_once() {
    let field = Field { sizes: [33, 17, 20, 1, 1], voxel_type: VoxelType::U16 };
    let (_folder, path) = temp_file("a.tif", &written(field, "z", &Layout::default()));
    let source = opened(&path).unwrap();
    let whole = field.bytes("zyx", false);
    std::thread::scope(|scope| {
        for thread in 0..4u32 {
            let (source, whole) = (&source, &whole);
            scope.spawn(move || {
                for i in 0..60 {
                    let z = (i * 7 + thread * 5) % 20;
                    let plane = whole.len() / 20;
                    let mut out = vec![0; plane];
                    source.read_box(0, 0, VoxelBox::new([0, 0, z], [33, 17, z + 1]), &mut out).unwrap();
                    assert!(out == whole[z as usize * plane..][..plane]);
                }
            });
        }
    });
}

proptest! {
    #![proptest_config(crate::testing::cases(400))]

    /// Damage leads to an error or wrong voxels, never to a panic.
    #[test]
    fn damage_does_not_panic(
        damage in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6),
        tiled in any::<bool>(),
        big_tiff in any::<bool>(),
        lzw in any::<bool>(),
    ) {
        let field = Field { sizes: [9, 5, 2, 1, 1], voxel_type: VoxelType::U16 };
        let chunk = if tiled { Ok([16, 16]) } else { Err(2) };
        let lzw = lzw.then_some(2);
        let layout = Layout { chunk, big_tiff, lzw, description: HYPERSTACK.replace("30", "2"), ..Layout::default() };
        let mut bytes = written(field, "z", &layout);
        for (place, value) in damage {
            let place = place.index(bytes.len());
            bytes[place] = value;
        }
        let (_folder, path) = temp_file("a.tif", &bytes);
        let told = OpenOptions { axes: Some("zyx".parse().unwrap()), allow_lossy: true, ..options() };
        if let Ok(source) = open(&[path], &told) {
            let e = source.info().extent;
            let region = VoxelBox::new([0, 0, 0], [e.x.min(50), e.y.min(50), e.z.min(2)]);
            let mut out = vec![0; region.extent().volume() as usize * source.info().voxel_type.bytes()];
            let _ = source.read_box(0, 0, region, &mut out);
        }
    }
}
