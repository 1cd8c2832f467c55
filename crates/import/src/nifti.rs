//! NIfTI-1 and NIfTI-2, both byte orders: `.nii`, `.nii.gz` and `.hdr`/`.img` pairs; and ANALYZE 7.5, the pairs before them.
//!
//! The array is read through [`RawSource`], a compressed one after unpacking (see `body`). In a series this happens when its step is read, and the
//! unpacked file goes when other steps are opened.

mod analyze;
#[cfg(test)]
mod analyze_tests;
mod fields;
mod header;
mod placement;

use crate::body::{self, Body};
use crate::direct::is_plain;
use crate::element::{Decode, Element, Scale};
use crate::error::{ImportError, Result};
use crate::labels::SaidKind;
use crate::looks;
use crate::losses::Losses;
use crate::note::Note;
use crate::options::OpenOptions;
use crate::raw::{RawSource, identity};
use crate::series::StepFile;
use crate::source::{Access, SourceInfo};
use crate::stamp::Stamp;
use crate::step_time::StepTime;
use brickyard_volume::VoxelType;
use header::Header;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

/// Bytes of an empty gzip file: head, an empty block, checksum and length.
const LEAST_GZIP_BYTES: u64 = 20;

/// `NIFTI_INTENT_LABEL` of the standard: a voxel is an index into a list of labels.
const INTENT_LABEL: i32 = 1002;

/// Opens a NIfTI file, or a pair of `.hdr` and `.img` by either name.
pub(crate) fn open(path: &Path, options: &OpenOptions) -> Result<RawSource> {
    let found = Found::read(path)?;
    let body = Body::open(&found.body_path)?;
    let options = &options.heeding(found.kind());
    let source = body.source(found.header.array.clone(), found.info()?, options)?;
    found.check_unchanged()?;
    Ok(source)
}

/// Examines a NIfTI file or pair without keeping it open. A compressed one is inflated if its last bytes do not confirm its header's size, or
/// all its values have to be checked.
pub(crate) fn check(path: &Path, options: &OpenOptions) -> Result<StepFile> {
    let found = Found::read(path)?;
    let options = &options.heeding(found.kind());
    let expected = found.bytes()?;
    let decode = found.header.array.decode;
    let is_plain = is_plain(decode, options) && Losses::may_occur(path, decode, None, options).is_none();
    let is_seen = found.is_compressed && is_plain;
    if is_seen && inflated_bytes(&found.body_path)? == Some(expected as u32) {
        let mut info = found.info()?;
        info.notes.push(body::unpacked_note(expected));
        found.check_unchanged()?;
        let (access, step_time) = (Access::Box, StepTime::default());
        return Ok(StepFile { info, access, reader_bytes: 0, held_bytes: 0, scratch_bytes: expected, step_time });
    }
    Ok(StepFile::of(&open(path, options)?))
}

struct Found {
    header: Header,
    header_path: PathBuf,
    body_path: PathBuf,
    /// States of the header's and the body's file when the header was read.
    stamps: [Stamp; 2],
    is_compressed: bool,
}

impl Found {
    fn read(path: &Path) -> Result<Self> {
        let (header_path, pair_body) = pair_of(path);
        let stamp = Stamp::of(&header_path)?;
        let header = Header::read(&mut Body::open(&header_path)?.reader()?, &header_path)?;
        if header.analyze.is_some() && header_path == pair_body {
            let problem = "a 348-byte header without the NIfTI magic; an ANALYZE 7.5 header is a file .hdr, with its voxels in .img";
            return Err(ImportError::invalid(path, problem));
        }
        let body_path = if header.single_file { header_path.clone() } else { pair_body };
        let stamps = [stamp, Stamp::of(&body_path)?];
        let is_compressed = Body::open(&body_path)?.is_coded();
        Ok(Self { header, header_path, body_path, stamps, is_compressed })
    }

    /// The kind of voxels by the header's intent: labels are whole numbers.
    fn kind(&self) -> SaidKind {
        let Header { array, analyze, fields, .. } = &self.header;
        let is_whole = array.decode.scale.is_none() && !array.decode.voxel_type().is_float();
        let is_number = analyze.is_none() && fields.colors().is_none();
        match is_number && fields.intent_code == INTENT_LABEL && is_whole {
            true => SaidKind::Labels("the header's intent (NIFTI_INTENT_LABEL)"),
            false => SaidKind::Unsaid,
        }
    }

    /// Bytes up to the last voxel, inflated.
    fn bytes(&self) -> Result<u64> {
        self.header.array.end_bytes().map_err(|problem| ImportError::invalid(&self.header_path, problem))
    }

    /// Describes the volume.
    fn info(&self) -> Result<SourceInfo> {
        let mut notes = Vec::new();
        let Decode { element, scale, .. } = self.header.array.decode;
        if let Some(Scale { slope, intercept, to, .. }) = scale {
            let is_long = matches!(element, Element::Voxel(VoxelType::I32 | VoxelType::U32));
            let scaled = format!(
                "Values are scaled by {slope} and shifted by {intercept}, as the header says, and held as {to}"
            );
            notes.push(match is_long {
                true => Note::warning(format!("{scaled}, rounded to 24 bits.")),
                false => Note::new(format!("{scaled}.")),
            });
        }
        let identity = identity("nifti", &[&self.header_path, &self.body_path])?;
        let mut info = SourceInfo { identity, kind: self.kind(), ..self.header.array.info() };
        if self.header.fields.colors().is_some() {
            info.channel_looks = looks::colors(info.voxel_type, info.channels);
            if ![0.0, 1.0].contains(&self.header.fields.slope) && !self.header.fields.slope.is_nan() {
                notes.push(Note::warning("Colours are not scaled, by the standard: scl_slope is passed over."));
            }
        }
        if self.header.fields.is_complex() {
            info.channel_looks = looks::named(&looks::COMPLEX);
        }
        placement::place(&self.header.fields, &mut info, &mut notes);
        if let Some(analyze) = &self.header.analyze {
            analyze.place(&self.header.fields, &self.header_path, &mut info, &mut notes);
        }
        placement::set_time(&self.header.fields, &mut info, &mut notes);
        info.notes = notes;
        Ok(info)
    }

    /// Checks that neither file has changed since: they are opened one after the other, and unpacking takes its time.
    fn check_unchanged(&self) -> Result<()> {
        self.stamps[0].check(&self.header_path)?;
        self.stamps[1].check(&self.body_path)
    }
}

/// Inflated size stored in a gzip file's last member, modulo 2^32. `None` if the file is too short.
fn inflated_bytes(path: &Path) -> Result<Option<u32>> {
    let mut file = File::open(path).map_err(ImportError::io(path))?;
    if file.metadata().map_err(ImportError::io(path))?.len() < LEAST_GZIP_BYTES {
        return Ok(None);
    }
    let mut end = [0; 4];
    file.seek(SeekFrom::End(-4)).and_then(|_| file.read_exact(&mut end)).map_err(ImportError::io(path))?;
    Ok(Some(u32::from_le_bytes(end)))
}

/// Returns the header's and the body's path of a pair, given either; any other path twice.
pub(crate) fn pair_of(path: &Path) -> (PathBuf, PathBuf) {
    let name = path.to_string_lossy();
    let lower = name.to_ascii_lowercase();
    let Some(base) = [".hdr", ".img", ".hdr.gz", ".img.gz"].iter().find_map(|e| {
        let end = lower.strip_suffix(e)?.len();
        name.get(..end)
    }) else {
        return (path.to_owned(), path.to_owned());
    };
    // Either half may be compressed, and upper-case names come from old systems.
    let find = |extension: &str| {
        let names = [extension.to_owned(), format!("{extension}.gz"), extension.to_ascii_uppercase()];
        let mut candidates = names.iter().map(|e| PathBuf::from(format!("{base}{e}")));
        candidates.find(|p| p.exists()).unwrap_or_else(|| PathBuf::from(format!("{base}{extension}")))
    };
    (find(".hdr"), find(".img"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::source::Source;
    use crate::testing::{Field, assert_boxes, is_warned, said, temp_file};
    use brickyard_volume::VoxelType;
    use glam::DVec3;
    use std::io::Write;

    /// A header of either version with the fields varied by the tests.
    struct Written {
        two: bool,
        big: bool,
        single: bool,
        dim: Vec<i64>,
        datatype: i16,
        bitpix: i16,
        pixdim: [f32; 4],
        time: [f32; 2],
        slope: f32,
        intercept: f32,
        units: u8,
        codes: [i32; 2],
        quaternion: [f32; 6],
        srow: [f32; 12],
        vox_offset: Option<i64>,
    }

    impl Written {
        fn new(dim: &[i64], datatype: i16, bitpix: i16) -> Self {
            Self {
                two: false,
                big: false,
                single: true,
                dim: dim.to_vec(),
                datatype,
                bitpix,
                pixdim: [1.0, 0.5, 0.75, 2.0],
                time: [0.0; 2],
                slope: 0.0,
                intercept: 0.0,
                units: 2,
                codes: [0, 0],
                quaternion: [0.0; 6],
                srow: [0.0; 12],
                vox_offset: None,
            }
        }

        fn header(&self) -> Vec<u8> {
            let size = if self.two { 540 } else { 348 };
            let mut bytes = vec![0u8; size + if self.single { 4 } else { 0 }];
            let mut put = |at: usize, mut field: Vec<u8>| {
                if self.big {
                    field.reverse();
                }
                bytes[at..at + field.len()].copy_from_slice(&field);
            };
            put(0, (size as i32).to_le_bytes().to_vec());
            let offset = self.vox_offset.unwrap_or(if self.single { size as i64 + 4 } else { 0 });
            let mut dim = [1i64; 8];
            dim[0] = self.dim.len() as i64;
            dim[1..=self.dim.len()].copy_from_slice(&self.dim);
            let quaternion = self.quaternion;
            if self.two {
                put(12, self.datatype.to_le_bytes().to_vec());
                put(14, self.bitpix.to_le_bytes().to_vec());
                dim.iter().enumerate().for_each(|(i, d)| put(16 + 8 * i, d.to_le_bytes().to_vec()));
                let mut put64 = |at: usize, v: f32| put(at, (v as f64).to_le_bytes().to_vec());
                self.pixdim.iter().enumerate().for_each(|(i, &p)| put64(104 + 8 * i, p));
                put64(136, self.time[0]);
                put64(216, self.time[1]);
                put64(176, self.slope);
                put64(184, self.intercept);
                quaternion.iter().enumerate().for_each(|(i, &q)| put64(352 + 8 * i, q));
                self.srow.iter().enumerate().for_each(|(i, &v)| put64(400 + 8 * i, v));
                put(168, offset.to_le_bytes().to_vec());
                put(344, self.codes[0].to_le_bytes().to_vec());
                put(348, self.codes[1].to_le_bytes().to_vec());
                put(500, (self.units as i32).to_le_bytes().to_vec());
                bytes[4..12].copy_from_slice(if self.single { b"n+2\0\r\n\x1a\n" } else { b"ni2\0\r\n\x1a\n" });
            } else {
                dim.iter().enumerate().for_each(|(i, &d)| put(40 + 2 * i, (d as i16).to_le_bytes().to_vec()));
                put(70, self.datatype.to_le_bytes().to_vec());
                put(72, self.bitpix.to_le_bytes().to_vec());
                let mut put32 = |at: usize, v: f32| put(at, v.to_le_bytes().to_vec());
                self.pixdim.iter().enumerate().for_each(|(i, &p)| put32(76 + 4 * i, p));
                put32(92, self.time[0]);
                put32(136, self.time[1]);
                put32(108, offset as f32);
                put32(112, self.slope);
                put32(116, self.intercept);
                quaternion.iter().enumerate().for_each(|(i, &q)| put32(256 + 4 * i, q));
                self.srow.iter().enumerate().for_each(|(i, &v)| put32(280 + 4 * i, v));
                put(252, (self.codes[0] as i16).to_le_bytes().to_vec());
                put(254, (self.codes[1] as i16).to_le_bytes().to_vec());
                bytes[123] = self.units;
                bytes[344..348].copy_from_slice(if self.single { b"n+1\0" } else { b"ni1\0" });
            }
            bytes
        }
    }

    fn options() -> OpenOptions {
        OpenOptions::default()
    }

    fn gzip(bytes: &[u8]) -> Vec<u8> {
        let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
        encoder.write_all(bytes).unwrap();
        encoder.finish().unwrap()
    }

    #[test]
    fn both_versions_orders_and_compressions_give_the_bytes_written() {
        for (two, big, gz, single) in (0..16).map(|i| (i & 1 > 0, i & 2 > 0, i & 4 > 0, i & 8 > 0)) {
            let field = Field { sizes: [13, 7, 5, 2, 3], voxel_type: VoxelType::I16 };
            let header = Written { two, big, single, ..Written::new(&[13, 7, 5, 3, 2], 4, 16) }.header();
            // NIfTI's fifth dimension is slower than time.
            let body = field.bytes("ctzyx", big);
            let pack = |bytes: &[u8]| if gz { gzip(bytes) } else { bytes.to_vec() };
            let end = if gz { ".gz" } else { "" };
            let (_folder, path) = if single {
                temp_file(&format!("a.nii{end}"), &pack(&[header, body].concat()))
            } else {
                let (folder, path) = temp_file("ä b.hdr", &header);
                std::fs::write(path.with_file_name(format!("ä b.img{end}")), pack(&body)).unwrap();
                (folder, path)
            };
            let source = open(&path, &options()).unwrap();
            assert_boxes(&source, field);
            assert_eq!(source.info().geometry.spacing, DVec3::new(0.5, 0.75, 2.0));
            assert_eq!(source.info().geometry.unit.as_deref(), Some("millimeter"));
            assert_eq!(source.info().notes.iter().any(|n| n.contains("scratch")), gz);
        }
    }

    #[test]
    fn every_datatype_is_read_and_wide_ones_only_on_request() {
        let codes = [(2, VoxelType::U8), (4, VoxelType::I16), (8, VoxelType::I32), (16, VoxelType::F32)];
        let more = [(256, VoxelType::I8), (512, VoxelType::U16), (768, VoxelType::U32)];
        for (code, voxel_type) in codes.into_iter().chain(more) {
            let field = Field { sizes: [3, 4, 5, 1, 1], voxel_type };
            let header = Written::new(&[3, 4, 5], code, voxel_type.bytes() as i16 * 8).header();
            let (_folder, path) = temp_file("a.nii", &[header, field.bytes("zyx", false)].concat());
            assert_boxes(&open(&path, &options()).unwrap(), field);
        }
        let header = Written::new(&[2, 1, 1], 64, 64).header();
        let values: Vec<u8> = [0.1f64, 1e300].iter().flat_map(|v| v.to_le_bytes()).collect();
        let (_folder, path) = temp_file("a.nii", &[header, values].concat());
        assert!(open(&path, &options()).err().unwrap().to_string().contains("`allow_lossy`"));
        let source = open(&path, &OpenOptions { allow_lossy: true, ..options() }).unwrap();
        let mut out = [0; 8];
        source.read_box(0, 0, source.info().extent.full_box(), &mut out).unwrap();
        assert_eq!(out, [0.1f32.to_le_bytes(), f32::INFINITY.to_le_bytes()].concat()[..]);
        assert!(source.info().notes[0].contains("1 infinite, 1 rounded"), "{:?}", source.info().notes);
        assert!(is_warned(&said(&source.info().notes), "1 infinite, 1 rounded"));
    }

    #[test]
    fn colours_are_channels() {
        for (code, bits, parts) in [(128, 24, 3), (2304, 32, 4)] {
            let field = Field { sizes: [5, 4, 3, parts, 2], voxel_type: VoxelType::U8 };
            for (two, slope) in [(false, 0.0), (true, 2.0), (false, f32::NAN)] {
                let header = Written { two, slope, ..Written::new(&[5, 4, 3, 2], code, bits) }.header();
                let (_folder, path) = temp_file("a.nii", &[header, field.bytes("tzyxc", false)].concat());
                let source = open(&path, &options()).unwrap();
                assert_boxes(&source, field);
                let looks = &source.info().channel_looks;
                let names: Vec<&str> = looks.iter().filter_map(|look| look.name.as_deref()).collect();
                assert_eq!(names, ["red", "green", "blue", "opacity"][..parts as usize]);
                assert_eq!((looks[1].color, looks[1].window), (Some([0, 255, 0]), Some([0.0, 255.0])));
                assert_eq!(is_warned(&said(&source.info().notes), "Colours are not scaled"), slope == 2.0);
                assert_eq!(Found::read(&path).unwrap().kind(), SaidKind::Unsaid);
            }
        }
    }

    #[test]
    fn complex_numbers_are_two_channels() {
        let field = Field { sizes: [5, 4, 3, 2, 2], voxel_type: VoxelType::F32 };
        let header = Written { two: true, ..Written::new(&[5, 4, 3, 2], 32, 64) }.header();
        let (_folder, path) = temp_file("a.nii", &[header, field.bytes("tzyxc", false)].concat());
        let source = open(&path, &options()).unwrap();
        assert_boxes(&source, field);
        let names = source.info().channel_looks.iter().filter_map(|look| look.name.as_deref());
        assert_eq!(names.collect::<Vec<_>>(), ["real", "imaginary"]);
        // Both parts are scaled.
        let header = Written { slope: 0.5, ..Written::new(&[2, 1, 1], 1792, 128) }.header();
        let values = [1.0f64, 2.0, 3.0, 4.0].map(f64::to_le_bytes).concat();
        let (_folder, path) = temp_file("a.nii", &[header, values].concat());
        let source = open(&path, &options()).unwrap();
        for (channel, expected) in [(0, [0.5f32, 1.5]), (1, [1.0, 2.0])] {
            let mut out = [0; 8];
            source.read_box(0, channel, source.info().extent.full_box(), &mut out).unwrap();
            assert_eq!(out, expected.map(f32::to_le_bytes).concat()[..], "channel {channel}");
        }
    }

    #[test]
    fn slope_and_intercept_make_floats_unless_they_change_nothing() {
        for (slope, intercept, expected) in [
            (2.0, -1.0, Some([1.0f32, 509.0])),
            (1.0, -1024.0, Some([-1023.0, -769.0])),
            (-1.0, 0.0, Some([-1.0, -255.0])),
            (1.0, 0.0, None),
            (0.0, 5.0, None),
            (0.0, f32::NAN, None),
            (f32::NAN, 0.0, None),
            (f32::NAN, f32::NAN, None),
        ] {
            let header = Written { slope, intercept, ..Written::new(&[2, 1, 1], 2, 8) }.header();
            let (_folder, path) = temp_file("a.nii", &[&header[..], &[1, 255]].concat());
            let source = open(&path, &options()).unwrap();
            let full = source.info().extent.full_box();
            let mut out = vec![0; 2 * source.info().voxel_type.bytes()];
            source.read_box(0, 0, full, &mut out).unwrap();
            match expected {
                Some(values) => assert_eq!(out, bytemuck::cast_slice::<f32, u8>(&values)),
                None => assert_eq!(out, [1, 255]),
            }
        }
    }

    #[test]
    fn a_slope_without_an_intercept_is_refused() {
        for (slope, intercept) in [(2.0, f32::NAN), (1.0, f32::INFINITY), (f32::NEG_INFINITY, 0.0)] {
            for two in [false, true] {
                let header = Written { two, slope, intercept, ..Written::new(&[2, 1, 1], 2, 8) }.header();
                let (_folder, path) = temp_file("a.nii", &[&header[..], &[1, 255]].concat());
                let message = open(&path, &options()).err().unwrap().to_string();
                let numbers = [format!("scl_slope is {slope}"), format!("scl_inter {intercept}")];
                assert!(numbers.iter().all(|n| message.contains(n)), "{message}");
            }
        }
    }

    #[test]
    fn upright_matrices_give_an_origin_and_others_an_orientation() {
        let write = |w: Written| temp_file("a.nii", &[w.header(), vec![7]].concat());
        let plain = || Written::new(&[1, 1, 1], 2, 8);
        let srow = [0.5, 0.0, 0.0, -90.0, 0.0, 0.75, 0.0, 10.5, 0.0, 0.0, 2.0, 3.25];
        let (_folder, path) = write(Written { codes: [0, 1], srow, ..plain() });
        let info = open(&path, &options()).unwrap().info().clone();
        assert_eq!(
            (info.geometry.origin, info.orientation.unwrap().rows(), info.calibrated),
            (
                DVec3::new(-90.0, 10.5, 3.25),
                srow.as_chunks().0.try_into().map(|r: [[f32; 4]; 3]| r.map(|r| r.map(f64::from))).unwrap(),
                true
            )
        );
        assert!(info.orientation.unwrap().placement(&info.geometry).unwrap().is_identity());
        assert_eq!(info.notes, []);

        // A quarter turn about z by quaternion: x goes to y, y to -x.
        let h = std::f32::consts::FRAC_1_SQRT_2;
        let (_folder, path) = write(Written { codes: [1, 0], quaternion: [0.0, 0.0, h, 1.0, 2.0, 3.0], ..plain() });
        let info = open(&path, &options()).unwrap().info().clone();
        let expected = [[0.0, -0.75, 0.0, 1.0], [0.5, 0.0, 0.0, 2.0], [0.0, 0.0, 2.0, 3.0]];
        for (row, e) in info.orientation.unwrap().rows().iter().flatten().zip(expected.iter().flatten()) {
            // The quaternion is f32: relative error 6e-8 twice over.
            assert!((row - e).abs() < 1e-6, "{row} {e}");
        }
        assert_eq!(info.geometry.origin, DVec3::ZERO);
        assert_eq!(info.orientation.unwrap().code(), "ALS");
        assert_eq!(info.notes, []);

        // A quaternion longer than a rotation's is scaled to one: half a turn about z.
        let (_folder, path) = write(Written { codes: [1, 0], quaternion: [0.0, 0.0, 2.0, 1.0, 2.0, 3.0], ..plain() });
        let info = open(&path, &options()).unwrap().info().clone();
        let expected = [[-0.5, 0.0, 0.0, 1.0], [0.0, -0.75, 0.0, 2.0], [0.0, 0.0, 2.0, 3.0]];
        assert_eq!(info.orientation.unwrap().rows(), expected);

        // An unusable matrix is left out, with a note.
        for unusable in [[0.0; 12], [f32::NAN; 12]] {
            let (_folder, path) = write(Written { codes: [0, 1], srow: unusable, ..plain() });
            let info = open(&path, &options()).unwrap().info().clone();
            assert_eq!(info.orientation, None);
            assert!(info.notes.len() == 1 && info.notes[0].contains("shown along its own axes"), "{:?}", info.notes);
            assert!(is_warned(&said(&info.notes), "shown along its own axes"));
        }

        let (_folder, path) = write(Written { pixdim: [1.0, 0.0, 1.0, 1.0], ..plain() });
        assert!(!open(&path, &options()).unwrap().info().calibrated);
    }

    #[test]
    fn the_fourth_axis_has_the_headers_times() {
        let axis = |start, step, unit: &str| {
            let unit = (!unit.is_empty()).then(|| unit.to_owned());
            Some(brickyard_volume::TimeAxis { start, step, unit, ..Default::default() })
        };
        for (time, units, times, expected, notes) in [
            ([2.2, 0.5], 8, 3, axis(0.5, 2.2, "second"), 0),
            ([2200.0, 0.0], 16, 3, axis(0.0, 2200.0, "millisecond"), 0),
            ([1.0, 0.0], 24, 3, axis(0.0, 1.0, "microsecond"), 0),
            ([3.0, 0.0], 0, 3, axis(0.0, 3.0, ""), 0),
            // Defaults of writers; a frequency; an invalid step; one step.
            ([1.0, 0.0], 0, 3, None, 0),
            ([0.0, 0.0], 0, 3, None, 0),
            ([100.0, 0.0], 32, 3, None, 1),
            ([-2.0, 0.0], 8, 3, None, 1),
            ([2.0, 0.0], 8, 1, None, 0),
        ] {
            for two in [false, true] {
                let written = Written { two, time, units: 2 | units, ..Written::new(&[1, 1, 1, times], 2, 8) };
                let (_folder, path) = temp_file("a.nii", &[written.header(), vec![7; 3]].concat());
                let info = open(&path, &options()).unwrap().info().clone();
                let found = info.time.map(|axis| brickyard_volume::TimeAxis { step: axis.step as f32 as f64, ..axis });
                let expected =
                    expected.clone().map(|axis| brickyard_volume::TimeAxis { step: axis.step as f32 as f64, ..axis });
                assert_eq!(found, expected, "{time:?} {units}");
                let trailing = usize::from(times == 1);
                assert_eq!(info.notes.len(), notes + trailing, "{:?}", info.notes);
            }
        }
    }

    #[test]
    fn steps_of_a_series_lie_in_one_place() {
        let stretched = |shift: f32, size: f32| {
            let srow = [size, 0.0, 0.0, shift, 0.0, 0.75, 0.0, 10.5, 0.0, 0.0, 2.0, 3.25];
            let pixdim = [1.0, size, 0.75, 2.0];
            [Written { codes: [0, 1], srow, pixdim, ..Written::new(&[1, 1, 1], 2, 8) }.header(), vec![7]].concat()
        };
        let step = |shift: f32| stretched(shift, 0.5);
        let (folder, first) = temp_file("a1.nii", &step(1.0));
        let second = folder.path().join("a2.nii");
        std::fs::write(&second, step(1.001)).unwrap();
        let paths = [first, second];
        assert_eq!(crate::open(&paths, &options()).unwrap().info().times, 2);
        std::fs::write(&paths[1], step(1.1)).unwrap();
        let message = crate::open(&paths, &options()).err().unwrap().to_string();
        assert!(message.contains("a2.nii: lies differently in the patient than"), "{message}");
        // Unless the user gives a position or spacing for all.
        let told = OpenOptions { origin: Some(DVec3::new(1.0, 10.5, 3.25)), ..options() };
        assert_eq!(crate::open(&paths, &told).unwrap().info().geometry.origin, told.origin.unwrap());
        std::fs::write(&paths[1], stretched(1.0, 0.6)).unwrap();
        let message = crate::open(&paths, &options()).err().unwrap().to_string();
        assert!(message.contains("write the steps alike"), "{message}");
        let told = OpenOptions { spacing: Some(DVec3::new(0.5, 0.75, 2.0)), ..options() };
        assert_eq!(crate::open(&paths, &told).unwrap().info().geometry.spacing, told.spacing.unwrap());
    }

    #[test]
    fn cut_and_damaged_files_are_refused_with_numbers() {
        let refusal = |name: &str, bytes: &[u8]| {
            let (_folder, path) = temp_file(name, bytes);
            open(&path, &options()).err().unwrap().to_string()
        };
        let whole = [Written::new(&[10, 10, 10], 2, 8).header(), vec![3; 1000]].concat();
        let message = refusal("a.nii", &whole[..1000]);
        assert!(
            message.contains("1352") && message.contains("found 1000") && message.contains("352 missing"),
            "{message}"
        );
        let message = refusal("a.nii.gz", &gzip(&whole[..1000]));
        assert!(message.contains("1352") && message.contains("found 1000"), "{message}");
        // A stream cut short inside the voxels; noise, so that the cut removes many of them.
        let noise: Vec<u8> = (0..1000u32).map(|i| (i.wrapping_mul(2654435761) >> 13) as u8).collect();
        let mut packed = gzip(&[&whole[..352], &noise].concat());
        let message = refusal("a.nii.gz", &packed[..packed.len() - 200]);
        assert!(message.contains("cut short or damaged") && message.contains("1352"), "{message}");
        // The checksum at the end of the stream is checked too.
        let last = packed.len() - 6;
        packed[last] ^= 1;
        assert!(refusal("a.nii.gz", &packed).contains("cut short or damaged"));
        assert!(refusal("a.nii", &whole[..100]).contains("348 bytes"));
        assert!(refusal("a.nii", b"").contains("not a NIfTI"));
        // Surplus bytes only cause a note.
        let (_folder, path) = temp_file("a.nii", &[&whole[..], &[0; 9]].concat());
        assert_eq!(
            said(&open(&path, &options()).unwrap().info().notes),
            "warning: 9 bytes after the voxels are ignored. "
        );
    }

    #[test]
    fn absurd_headers_are_refused() {
        let refusal = |w: Written| {
            let (_folder, path) = temp_file("a.nii", &w.header());
            open(&path, &options()).err().unwrap().to_string()
        };
        let plain = |dim: &[i64]| Written::new(dim, 2, 8);
        assert!(refusal(plain(&[10, 0, 3])).contains("1 or more"));
        assert!(refusal(plain(&[10, -4, 3])).contains("1 or more"));
        assert!(refusal(Written { two: true, ..plain(&[1 << 31, 1 << 31, 1 << 31]) }).contains("2^63"));
        assert!(refusal(Written { two: true, ..plain(&[1 << 40, 1, 1]) }).contains("1 or more"));
        assert!(refusal(plain(&[2, 2, 2, 2, 2, 2])).contains("sixth"));
        assert!(refusal(Written::new(&[2, 2, 2], 128, 8)).contains("3 x u8 has 24 bits, but bitpix says 8"));
        assert!(refusal(Written::new(&[2, 2, 2, 1, 3], 128, 24)).contains("colours along a fifth dimension (3)"));
        assert!(
            refusal(Written::new(&[2, 2, 2, 1, 3], 32, 64)).contains("complex numbers along a fifth dimension (3)")
        );
        assert!(refusal(Written::new(&[2, 2, 2], 2048, 256)).contains("complex numbers of 128-bit floats"));
        let shifted = Written { slope: 2.0, intercept: 1.0, ..Written::new(&[2, 2, 2], 1792, 128) };
        assert!(refusal(shifted).contains("complex numbers with a shift (scl_inter 1)"));
        assert!(refusal(Written::new(&[2, 2, 2], 4, 8)).contains("bitpix says 8"));
        assert!(refusal(Written { vox_offset: Some(-5), ..plain(&[2, 2, 2]) }).contains("from byte -5 on"));
        for name in ["a.nii", "a.nii.gz"] {
            let mut bytes = [plain(&[2, 2, 2]).header(), vec![0; 8]].concat();
            bytes[344..348].fill(0);
            let (_folder, path) = temp_file(name, &bytes);
            assert!(open(&path, &options()).err().unwrap().to_string().contains("ANALYZE"));
        }
    }
}
