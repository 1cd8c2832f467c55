//! Series written by dicom-object, whole and broken in every refused way.

use super::jpeg_lossless_tests::Lossless;
use crate::error::ImportError;
use crate::open::{open, order_steps};
use crate::options::{FileOrder, NoData, OpenOptions};
use crate::source::{Access, Source};
use crate::testing::{alone_with, assert_takes_what_it_says, is_warned, memory_taken, said};
use brickyard_volume::{VoxelBox, VoxelType};
use dicom_core::value::{DataSetSequence, PixelFragmentSequence};
use dicom_core::{DataElement, PrimitiveValue, Tag, VR};
use dicom_dictionary_std::{tags, uids};
use dicom_object::{FileMetaTableBuilder, InMemDicomObject};
use glam::DVec3;
use std::io::Write;
use std::path::{Path, PathBuf};

const BIG_ENDIAN: &str = super::header::EXPLICIT_BIG_ENDIAN;

/// A file of a CT series, to be changed by each test.
pub(super) struct Written(pub(super) InMemDicomObject);

impl Written {
    /// A slice of 4 x 3 pixels at a height, with stored values counting up from a number.
    pub(super) fn slice(z_mm: f64, first: u16) -> Self {
        let mut written = Self(InMemDicomObject::new_empty());
        written.text(tags::SERIES_INSTANCE_UID, VR::UI, "1.2.3");
        written.text(tags::IMAGE_POSITION_PATIENT, VR::DS, &format!("-100\\-50\\{z_mm}"));
        written.text(tags::IMAGE_ORIENTATION_PATIENT, VR::DS, "1\\0\\0\\0\\1\\0");
        written.text(tags::PIXEL_SPACING, VR::DS, "0.75\\0.5");
        written.text(tags::SLICE_THICKNESS, VR::DS, "5");
        written.text(tags::PHOTOMETRIC_INTERPRETATION, VR::CS, "MONOCHROME2");
        let numbers = [
            (tags::SAMPLES_PER_PIXEL, 1),
            (tags::ROWS, 3),
            (tags::COLUMNS, 4),
            (tags::BITS_ALLOCATED, 16),
            (tags::BITS_STORED, 12),
            (tags::HIGH_BIT, 11),
            (tags::PIXEL_REPRESENTATION, 0),
        ];
        for (tag, number) in numbers {
            written.number(tag, number);
        }
        written.pixels(&(first..first + 12).collect::<Vec<_>>());
        written
    }

    pub(super) fn text(&mut self, tag: Tag, vr: VR, text: &str) -> &mut Self {
        self.0.put(DataElement::new(tag, vr, PrimitiveValue::from(text)));
        self
    }

    pub(super) fn number(&mut self, tag: Tag, number: u16) -> &mut Self {
        self.0.put(DataElement::new(tag, VR::US, PrimitiveValue::from(number)));
        self
    }

    pub(super) fn pixels(&mut self, pixels: &[u16]) -> &mut Self {
        self.0.put(DataElement::new(tags::PIXEL_DATA, VR::OW, PrimitiveValue::U16(pixels.into())));
        self
    }

    /// One fragment a frame, without a table of offsets.
    pub(super) fn fragments(&mut self, fragments: Vec<Vec<u8>>) -> &mut Self {
        let sequence = PixelFragmentSequence::new(Vec::<u32>::new(), fragments);
        self.0.put(DataElement::new(tags::PIXEL_DATA, VR::OB, sequence));
        self
    }

    pub(super) fn sequence(&mut self, tag: Tag, items: Vec<InMemDicomObject>) -> &mut Self {
        self.0.put(DataElement::new(tag, VR::SQ, DataSetSequence::from(items)));
        self
    }

    pub(super) fn save(&self, path: &Path, syntax: &str) {
        let meta = FileMetaTableBuilder::new()
            .transfer_syntax(syntax)
            .media_storage_sop_class_uid(uids::CT_IMAGE_STORAGE)
            .media_storage_sop_instance_uid("1.2.3.4");
        self.0.clone().with_meta(meta).unwrap().write_to_file(path).unwrap();
    }
}

impl Written {
    /// Like [`Written::save`], with the data set deflated.
    fn save_deflated(&self, path: &Path) {
        self.save(path, uids::EXPLICIT_VR_LITTLE_ENDIAN);
        let mut bytes = std::fs::read(path).unwrap();
        // The group's length counts from its own end.
        let length = u32::from_le_bytes(bytes[140..144].try_into().unwrap());
        let body = bytes.split_off(144 + length as usize);
        let name = uids::EXPLICIT_VR_LITTLE_ENDIAN.as_bytes();
        let at = bytes.windows(name.len()).position(|w| w == name).unwrap();
        bytes.splice(at - 2..at + 20, [&[22, 0], uids::DEFLATED_EXPLICIT_VR_LITTLE_ENDIAN.as_bytes()].concat());
        bytes[140..144].copy_from_slice(&(length + 2).to_le_bytes());
        let mut deflated = flate2::write::DeflateEncoder::new(bytes, flate2::Compression::best());
        deflated.write_all(&body).unwrap();
        std::fs::write(path, deflated.finish().unwrap()).unwrap();
    }
}

/// A folder of files, the input of `open`.
pub(super) struct Folder(pub(super) tempfile::TempDir);

impl Folder {
    /// Files whose names do not reveal their order.
    pub(super) fn of(slices: impl IntoIterator<Item = Written>) -> Self {
        let folder = Self(tempfile::tempdir().unwrap());
        for (i, slice) in slices.into_iter().enumerate() {
            slice.save(&folder.file(i), uids::EXPLICIT_VR_LITTLE_ENDIAN);
        }
        folder
    }

    pub(super) fn file(&self, i: usize) -> PathBuf {
        self.0.path().join(format!("IM{i}"))
    }

    /// With the folder, which the source still reads.
    pub(super) fn opened(slices: impl IntoIterator<Item = Written>) -> (Self, Box<dyn Source>) {
        let folder = Self::of(slices);
        let source = folder.open().unwrap();
        (folder, source)
    }

    pub(super) fn open(&self) -> Result<Box<dyn Source>, ImportError> {
        open(&[self.0.path().to_owned()], &OpenOptions::default())
    }

    #[track_caller]
    pub(super) fn refused(&self, words: &[&str]) {
        let message = self.open().err().expect("a refusal").to_string();
        for word in words {
            assert!(message.contains(word), "{word:?} is not in: {message}");
        }
    }
}

/// Slices from 20 mm up, 2.5 mm apart, shuffled; slice `k` from below holds values from `100 k`.
pub(super) fn shuffled() -> impl Iterator<Item = Written> {
    [3, 0, 4, 1, 2].into_iter().map(|k| Written::slice(20.0 + 2.5 * k as f64, 100 * k))
}

pub(super) fn voxels(source: &dyn Source) -> Vec<f64> {
    let info = source.info();
    let full = info.extent.full_box();
    let mut bytes = vec![0; full.extent().volume() as usize * info.voxel_type.bytes()];
    source.read_box(0, 0, full, &mut bytes).unwrap();
    (0..full.extent().volume() as usize).map(|i| info.voxel_type.read(&bytes, i)).collect()
}

fn counting(slices: u16) -> Vec<f64> {
    (0..slices).flat_map(|k| (100 * k..100 * k + 12).map(f64::from)).collect()
}

#[test]
fn slices_are_sorted_by_place_and_placed_in_a_world_of_right_front_and_head() {
    let (_folder, source) = Folder::opened(shuffled());
    let info = source.info();
    assert_eq!((info.extent.to_array(), info.voxel_type), ([4, 3, 5], VoxelType::U16));
    assert_eq!(voxels(&*source), counting(5));
    // PixelSpacing is from row to row first; the thickness of 5 mm is not the spacing.
    assert_eq!(info.geometry.spacing, DVec3::new(0.5, 0.75, 2.5));
    assert_eq!(info.geometry.unit.as_deref(), Some("millimeter"));
    let expected = [[-0.5, 0.0, 0.0, 100.0], [0.0, -0.75, 0.0, 50.0], [0.0, 0.0, 2.5, 20.0]];
    assert_eq!(info.orientation.unwrap().rows(), expected);
    assert!(info.calibrated);
}

#[test]
fn rows_to_the_right_and_columns_to_the_front_are_upright() {
    let slices = shuffled().map(|mut slice| {
        slice.text(tags::IMAGE_ORIENTATION_PATIENT, VR::DS, "-1\\0\\0\\0\\-1\\0");
        slice
    });
    let (_folder, source) = Folder::opened(slices);
    let info = source.info();
    assert!(info.orientation.unwrap().is_upright());
    assert_eq!(info.geometry.origin, DVec3::new(100.0, 50.0, 20.0));
    assert_eq!(voxels(&*source), counting(5));
}

#[test]
fn sagittal_slices_go_along_their_normal() {
    // Rows run to the back, columns to the feet: the normal is (0, 1, 0) x (0, 0, -1) = (-1, 0, 0), to the right.
    let sagittal = |x: f64, first| {
        let mut slice = Written::slice(0.0, first);
        slice.text(tags::IMAGE_POSITION_PATIENT, VR::DS, &format!("{x}\\7\\9"));
        slice.text(tags::IMAGE_ORIENTATION_PATIENT, VR::DS, "0\\1\\0\\0\\0\\-1");
        slice
    };
    let (_folder, source) = Folder::opened([sagittal(10.0, 0), sagittal(8.0, 200), sagittal(9.0, 100)]);
    assert_eq!(voxels(&*source), counting(3));
    let expected = [[0.0, 0.0, 1.0, -10.0], [-0.5, 0.0, 0.0, -7.0], [0.0, -0.75, 0.0, 9.0]];
    let found = source.info().orientation.unwrap().rows();
    for (f, e) in found.iter().flatten().zip(expected.iter().flatten()) {
        assert!((f - e).abs() < 1e-12, "{found:?}");
    }
}

/// Slices are opened again for reading, or stay mapped: each must still be the file whose header was read.
#[test]
fn a_slice_that_changes_after_it_was_opened_is_an_error() {
    for case in 0..8 {
        let [is_deflated, smaller, was_read] = [1, 2, 4].map(|bit| case & bit > 0);
        let folder = Folder::of(shuffled());
        let save = |written: &Written, path: &Path| match is_deflated {
            true => written.save_deflated(path),
            false => written.save(path, uids::EXPLICIT_VR_LITTLE_ENDIAN),
        };
        save(&Written::slice(22.5, 100), &folder.file(3));
        let source = folder.open().unwrap();
        let mut out = vec![0; 12 * 5 * 2];
        if was_read {
            source.read_box(0, 0, source.info().extent.full_box(), &mut out).unwrap();
        }
        let mut other = Written::slice(22.5, 900);
        if smaller {
            other.number(tags::ROWS, 1).pixels(&[1, 2, 3, 4]);
        }
        let new = folder.0.path().join("new");
        save(&other, &new);
        std::fs::File::options().write(true).open(&new).unwrap().set_modified(std::time::UNIX_EPOCH).unwrap();
        std::fs::rename(new, folder.file(3)).unwrap();
        let message = source.read_box(0, 0, source.info().extent.full_box(), &mut out).unwrap_err().to_string();
        assert!(message.contains("IM3: changed while it was read"), "{message}");
    }
}

/// Of each slice little more than its place is held; while a series is opened, values common to its slices are held once.
#[cfg(target_os = "linux")]
#[test]
fn a_series_of_many_slices_takes_what_it_says() {
    const SLICES: u64 = 4000;
    let folder = alone_with("dicom::tests::a_series_of_many_slices_takes_what_it_says", |path| {
        std::fs::create_dir(path).unwrap();
        for i in 0..SLICES {
            let mut slice = Written::slice(i as f64, 0);
            slice.text(tags::SERIES_DESCRIPTION, VR::LO, "a description that takes as much as others do");
            slice.save(&path.join(format!("{i}")), uids::EXPLICIT_VR_LITTLE_ENDIAN);
        }
    });
    let Some(folder) = folder else { return };
    let (taken, source) = memory_taken(|| open(&[folder], &OpenOptions::default()).unwrap());
    let said = source.held_bytes();
    // 5 kB a slice if each held its own values. The readers' fixed cost is less than the rest.
    assert!(said > 300 * SLICES && said <= taken && taken < 2500 * SLICES + (4 << 20), "took {taken}, said {said}");
}

/// Of a deflated file only its header and a frame are held, though it inflates to a thousand times its size.
#[cfg(target_os = "linux")]
#[test]
fn a_deflated_file_takes_what_it_says() {
    let written = alone_with("dicom::tests::a_deflated_file_takes_what_it_says", |path| {
        let mut large = Written::slice(0.0, 0);
        large.number(tags::ROWS, 2048).number(tags::COLUMNS, 2048).pixels(&vec![7; 2048 * 2048]).save_deflated(path);
        assert!(std::fs::metadata(path).unwrap().len() < 1 << 16);
    });
    if let Some(path) = written {
        assert_takes_what_it_says(|| open(&[path], &OpenOptions::default()).unwrap(), 2048 * 2048 * 2);
    }
}

#[test]
fn one_file_stands_for_its_series_and_a_list_for_itself() {
    let folder = Folder::of(shuffled());
    let mut other = Written::slice(21.0, 7);
    other.text(tags::SERIES_INSTANCE_UID, VR::UI, "1.2.9").text(tags::SERIES_DESCRIPTION, VR::LO, "scout");
    other.save(&folder.file(9), uids::EXPLICIT_VR_LITTLE_ENDIAN);
    let options = OpenOptions::default();
    assert_eq!(voxels(&*open(&[folder.file(2)], &options).unwrap()), counting(5));
    let source = open(&[folder.file(9)], &options).unwrap();
    assert_eq!((source.info().extent.z, source.info().geometry.spacing.z), (1, 5.0));
    // Slices 1 and 0 from below.
    assert_eq!(voxels(&*open(&[folder.file(3), folder.file(1)], &options).unwrap()), counting(2));
    folder.refused(&[
        "2 series",
        "1.2.3 of 5 files, such as IM",
        "1.2.9 \"scout\" of 1 file, such as IM9",
        "by `variable`",
    ]);
}

/// Each stands for all.
#[test]
fn slices_of_one_series_are_no_steps() {
    let [one, other] = [(); 2].map(|()| Folder::of(shuffled()));
    for order in [None, Some(FileOrder::Given), Some(FileOrder::Natural)] {
        let options = OpenOptions { order, ..OpenOptions::default() };
        let message = order_steps(&[one.file(0), one.file(1)], &options).unwrap_err().to_string();
        assert!(
            message.contains("IM1: is a slice of the same series as") && message.contains("its folder"),
            "{message}"
        );
        // From one folder each, they are two volumes.
        assert!(order_steps(&[one.file(0), other.file(1)], &options).is_ok());
        let step = OpenOptions { is_step: true, ..options };
        assert_eq!(voxels(&*open(&[one.0.path().to_owned()], &step).unwrap()), counting(5));
    }
    let mut scout = Written::slice(21.0, 7);
    scout.text(tags::SERIES_INSTANCE_UID, VR::UI, "1.2.9");
    scout.save(&one.file(9), uids::EXPLICIT_VR_LITTLE_ENDIAN);
    assert!(order_steps(&[one.file(0), one.file(9)], &OpenOptions::default()).is_ok());
    // Files of several frames stand alone.
    let frames = Folder::of([enhanced(), enhanced()]);
    assert!(order_steps(&[frames.file(0), frames.file(1)], &OpenOptions::default()).is_ok());
}

#[test]
fn every_uncompressed_syntax_gives_the_same_voxels() {
    for syntax in [uids::IMPLICIT_VR_LITTLE_ENDIAN, uids::EXPLICIT_VR_LITTLE_ENDIAN, BIG_ENDIAN] {
        let folder = tempfile::tempdir().unwrap();
        for (i, slice) in shuffled().enumerate() {
            slice.save(&folder.path().join(format!("{i}.dcm")), syntax);
        }
        let source = open(&[folder.path().to_owned()], &OpenOptions::default()).unwrap();
        assert_eq!(voxels(&*source), counting(5), "{syntax}");
    }
}

#[test]
fn values_have_the_unit_that_the_standard_gives_them() {
    let told = |texts: &[(Tag, &str)]| {
        let mut slice = Written::slice(0.0, 0);
        for (tag, text) in texts {
            slice.text(*tag, VR::LO, text);
        }
        slice
    };
    let unit = |texts: &[(Tag, &str)]| {
        let (_folder, source) = Folder::opened([told(texts)]);
        source.info().channel_looks[0].unit.clone()
    };
    let [ct, pet] = ["CT", "PT"].map(|modality| (tags::MODALITY, modality));
    let scale = [(tags::RESCALE_SLOPE, "1"), (tags::RESCALE_INTERCEPT, "-1024")];
    let original = (tags::IMAGE_TYPE, "ORIGINAL\\PRIMARY\\AXIAL");
    let of_type = |kind| unit(&[ct, original, scale[0], scale[1], (tags::RESCALE_TYPE, kind)]);
    assert_eq!(of_type("HU").as_deref(), Some("HU"));
    assert_eq!(of_type("MGML").as_deref(), Some("mg/mL"));
    assert_eq!(of_type("US"), None);
    assert_eq!(unit(&[ct, original, scale[0], scale[1]]).as_deref(), Some("HU"));
    assert_eq!(unit(&[ct, original]), None);
    for other in ["ORIGINAL\\PRIMARY\\LOCALIZER", "DERIVED\\SECONDARY\\AXIAL"] {
        assert_eq!(unit(&[ct, (tags::IMAGE_TYPE, other), scale[0], scale[1]]), None, "{other}");
    }
    assert_eq!(unit(&[original, scale[0], scale[1]]), None);
    assert_eq!(unit(&[pet, (tags::UNITS, "BQML"), (tags::RESCALE_TYPE, "US")]).as_deref(), Some("Bq/mL"));
    let mut second = told(&[ct, (tags::RESCALE_TYPE, "OD")]);
    second.text(tags::IMAGE_POSITION_PATIENT, VR::DS, "-100\\-50\\1");
    let (_folder, source) = Folder::opened([told(&[ct, (tags::RESCALE_TYPE, "HU")]), second]);
    assert_eq!(source.info().channel_looks[0].unit, None);
    assert!(is_warned(&said(&source.info().notes), "different units"));
}

#[test]
fn bits_signs_and_rescaling() {
    let values = |change: &dyn Fn(&mut Written) -> &mut Written| {
        let mut slice = Written::slice(0.0, 0);
        slice.pixels(&[0, 1, 2047, 2048, 4095, 0x8fff, 0xf000, 7, 7, 7, 7, 7]);
        change(&mut slice);
        let (_folder, source) = Folder::opened([slice]);
        (source.info().voxel_type, voxels(&*source)[..7].to_vec(), said(&source.info().notes))
    };
    // Bits past the stored ones (old overlays) are ignored.
    let (voxel_type, found, _) = values(&|s| s);
    assert_eq!((voxel_type, found), (VoxelType::U16, vec![0.0, 1.0, 2047.0, 2048.0, 4095.0, 4095.0, 0.0]));
    let (voxel_type, found, _) = values(&|s| s.number(tags::PIXEL_REPRESENTATION, 1));
    assert_eq!((voxel_type, found), (VoxelType::I16, vec![0.0, 1.0, 2047.0, -2048.0, -1.0, -1.0, 0.0]));
    fn hounsfield(s: &mut Written) -> &mut Written {
        s.text(tags::RESCALE_SLOPE, VR::DS, "1").text(tags::RESCALE_INTERCEPT, VR::DS, "-1024")
    }
    let (voxel_type, found, notes) = values(&hounsfield);
    assert_eq!((voxel_type, &found[..4]), (VoxelType::I16, &[-1024.0, -1023.0, 1023.0, 1024.0][..]));
    assert!(notes.contains("shifted by -1024"), "{notes}");
    let (voxel_type, found, _) = values(&|s| hounsfield(s).text(tags::RESCALE_SLOPE, VR::DS, "0.25"));
    assert_eq!((voxel_type, &found[..4]), (VoxelType::F32, &[-1024.0, -1023.75, -512.25, -512.0][..]));
    // All 16 bits are stored: the values decide whether a 16-bit number holds them all.
    fn wide(s: &mut Written) -> &mut Written {
        hounsfield(s).number(tags::BITS_STORED, 16).number(tags::HIGH_BIT, 15)
    }
    let (voxel_type, found, _) = values(&wide);
    assert_eq!((voxel_type, found[6]), (VoxelType::I32, 61440.0 - 1024.0));
    let (voxel_type, found, _) = values(&|s| wide(s).pixels(&[0, 4095, 9, 9, 9, 9, 33791, 9, 9, 9, 9, 9]));
    assert_eq!((voxel_type, found[0], found[6]), (VoxelType::I16, -1024.0, 32767.0));
    let (_, found, _) = values(&|s| s.number(tags::BITS_STORED, 12).number(tags::HIGH_BIT, 15));
    assert_eq!(found[3..], [128.0, 255.0, 2303.0, 3840.0]);
    let (_, found, notes) = values(&|s| s.text(tags::PHOTOMETRIC_INTERPRETATION, VR::CS, "MONOCHROME1"));
    assert_eq!(found[4], 4095.0);
    assert!(notes.contains("MONOCHROME1"), "{notes}");
}

#[test]
fn padding_is_nan_in_floats_and_one_value_in_integers() {
    // Padding is given by its value and the other end of its range, which may be the lower one.
    let padded = |slope: &str, value, limit| {
        let mut slice = Written::slice(0.0, 0);
        slice.number(tags::PIXEL_PADDING_VALUE, value).number(tags::PIXEL_PADDING_RANGE_LIMIT, limit);
        slice.text(tags::RESCALE_SLOPE, VR::DS, slope);
        let (_folder, source) = Folder::opened([slice]);
        assert!(source.info().notes.iter().any(|n| n.contains("3 to 5")), "{:?}", source.info().notes);
        (source.info().nodata, voxels(&*source)[2..7].to_vec())
    };
    for (value, limit) in [(3, 5), (5, 3)] {
        assert_eq!(padded("1", value, limit), (Some(3.0), vec![2.0, 3.0, 3.0, 3.0, 6.0]));
        assert_eq!(padded("-2", value, limit), (Some(-6.0), vec![-4.0, -6.0, -6.0, -6.0, -12.0]));
        let (nodata, found) = padded("0.5", value, limit);
        // Distinguishes steps with padding as values from this one.
        assert_eq!(nodata, Some(1.5));
        assert!(found[1..4].iter().all(|v| v.is_nan()) && [found[0], found[4]] == [1.0, 3.0], "{found:?}");
    }
}

/// Padding outside the stored range is reported, unless the caller overrides it.
#[test]
fn padding_that_no_pixel_can_have_is_said() {
    let mut slice = Written::slice(0.0, 0);
    slice.number(tags::PIXEL_PADDING_VALUE, 63536);
    let (folder, source) = Folder::opened([slice]);
    let is_said = |source: &dyn Source| {
        source.info().notes.iter().any(|note| note.contains("63536") && note.contains("0 to 4095"))
    };
    assert!(source.info().nodata.is_none() && is_said(&*source), "{:?}", source.info().notes);
    let options = OpenOptions { nodata: NoData::None, ..OpenOptions::default() };
    assert!(!is_said(&*open(&[folder.0.path().to_owned()], &options).unwrap()));
}

/// Padding as values makes other voxels: an earlier pack is not resumed with them.
#[test]
fn padding_that_is_kept_is_another_input() {
    let mut slice = Written::slice(0.0, 0);
    slice.number(tags::PIXEL_PADDING_VALUE, 3).text(tags::RESCALE_SLOPE, VR::DS, "0.5");
    let (folder, source) = Folder::opened([slice]);
    let identity = |nodata| {
        let options = OpenOptions { nodata, ..OpenOptions::default() };
        open(&[folder.0.path().to_owned()], &options).unwrap().info().identity.clone()
    };
    assert_eq!(identity(NoData::OfFile), source.info().identity);
    assert!([NoData::None, NoData::Value(1.5)].map(identity).iter().all(|other| *other != source.info().identity));
}

#[test]
fn numbers_of_32_bits_are_not_rounded_without_a_word() {
    let slice = |z: f64, signed: u16, number: u32| {
        let mut slice = Written::slice(z, 0);
        let bits = [(tags::BITS_ALLOCATED, 32), (tags::BITS_STORED, 32), (tags::HIGH_BIT, 31)];
        bits.into_iter().chain([(tags::PIXEL_REPRESENTATION, signed)]).for_each(|(tag, n)| {
            slice.number(tag, n);
        });
        let numbers = PrimitiveValue::from([number; 12].iter().flat_map(|n| n.to_le_bytes()).collect::<Vec<u8>>());
        slice.0.put(DataElement::new(tags::PIXEL_DATA, VR::OW, numbers));
        slice
    };
    let (folder, source) = Folder::opened([slice(0.0, 0, 4_000_000_001)]);
    assert_eq!(source.info().voxel_type, VoxelType::U32);
    drop((folder, source));
    let mut padded = slice(1.0, 0, 16_777_217);
    padded.0.put(DataElement::new(tags::PIXEL_PADDING_VALUE, VR::UL, PrimitiveValue::from(7u32)));
    for other in [slice(1.0, 1, 5), padded] {
        let folder = Folder::of([slice(0.0, 0, 16_777_217), other]);
        let message = folder.open().err().unwrap().to_string();
        assert!(message.contains("32-bit numbers") && message.contains("`allow_lossy`"), "{message}");
        let options = OpenOptions { allow_lossy: true, ..OpenOptions::default() };
        let source = open(&[folder.0.path().to_owned()], &options).unwrap();
        assert!(source.info().notes.iter().any(|note| note.contains("rounded to the 24 bits")));
        assert!(is_warned(&said(&source.info().notes), "rounded to the 24 bits"));
    }
    // Numbers scaled by a fraction are not whole anyway, which is reported.
    let mut scaled = slice(0.0, 0, 16_777_217);
    scaled.text(tags::RESCALE_SLOPE, VR::DS, "0.5");
    let (_folder, source) = Folder::opened([scaled]);
    assert!(source.info().notes.iter().any(|note| note.contains("rounded to the 24 bits")));
}

/// A text of megabytes counts as missing: thousands of headers stay small.
#[test]
fn long_values_of_headers_are_left_out() {
    let mut slice = Written::slice(0.0, 0);
    slice.text(tags::SERIES_DESCRIPTION, VR::UT, &"a".repeat(1 << 20));
    assert_eq!(Folder::opened([slice]).1.info().channel_looks[0].name, None);
}

#[test]
fn padding_that_one_integer_cannot_stand_for_is_nan() {
    // Of values 0 to 11 and 10 to 21, another is padding in each slice.
    let slice = |z: f64, first, padding| {
        let mut slice = Written::slice(z, first);
        slice.number(tags::PIXEL_PADDING_VALUE, padding);
        slice
    };
    let (folder, source) = Folder::opened([slice(0.0, 0, 11), slice(1.0, 10, 12)]);
    let found = voxels(&*source);
    // Padding is reported by its first value.
    assert_eq!((source.info().voxel_type, source.info().nodata), (VoxelType::F32, Some(11.0)));
    assert!(source.info().notes.iter().any(|note| note.contains("11 to 11 (other values in some slices)")));
    let is_padding = |i: usize| [11, 14].contains(&i);
    assert!((0..24).all(|i| found[i].is_nan() == is_padding(i)) && found[13] == 11.0, "{found:?}");
    // The user's value replaces it.
    for (nodata, expected) in [(NoData::None, None), (NoData::Value(20.0), Some(20.0))] {
        let options = OpenOptions { nodata, ..OpenOptions::default() };
        let source = open(&[folder.0.path().to_owned()], &options).unwrap();
        assert_eq!((source.info().voxel_type, source.info().nodata), (VoxelType::U16, expected));
        assert_eq!(voxels(&*source)[14], 12.0);
    }
    // The type holds the value of a range of padding, where some occurs.
    let mut looked_at = slice(0.0, 0, 0);
    looked_at.number(tags::PIXEL_PADDING_RANGE_LIMIT, 200).text(tags::RESCALE_INTERCEPT, VR::DS, "-1024");
    looked_at.number(tags::BITS_STORED, 16).number(tags::HIGH_BIT, 15);
    for (pixel, nodata, first) in [(100, Some(-1024.0), -1024.0), (1024, None, 0.0)] {
        looked_at.pixels(&[pixel, 1024, 1025, 1026, 1027, 1028, 1029, 1030, 1031, 1032, 1033, 65535]);
        let (_folder, source) = Folder::opened([Written(looked_at.0.clone())]);
        assert_eq!((source.info().nodata, voxels(&*source)[0]), (nodata, first), "{:?}", source.info());
    }
    // A value outside these bits is no padding.
    let mut outside = slice(0.0, 0, 60_000);
    outside.number(tags::BITS_STORED, 12).number(tags::HIGH_BIT, 11);
    assert_eq!(Folder::opened([outside]).1.info().nodata, None);
}

#[test]
fn slopes_are_each_slices_own() {
    let slices = [(0.0, "2"), (1.0, "0.5")].map(|(z, slope)| {
        let mut slice = Written::slice(z, 10);
        slice.text(tags::RESCALE_SLOPE, VR::DS, slope).text(tags::RESCALE_INTERCEPT, VR::DS, "1");
        slice
    });
    let (_folder, source) = Folder::opened(slices);
    let found = voxels(&*source);
    assert_eq!((found[0], found[12]), (21.0, 6.0));
    assert!(source.info().notes[0].contains("each slice's own"), "{:?}", source.info().notes);
}

#[test]
fn boxes_are_parts_of_the_whole() {
    let (_folder, source) = Folder::opened(shuffled());
    let region = VoxelBox::new([1, 1, 3], [3, 3, 5]);
    let mut bytes = vec![0; 2 * 2 * 2 * 2];
    source.read_box(0, 0, region, &mut bytes).unwrap();
    let found: Vec<f64> = (0..8).map(|i| VoxelType::U16.read(&bytes, i)).collect();
    assert_eq!(found, [305.0, 306.0, 309.0, 310.0, 405.0, 406.0, 409.0, 410.0]);
}

/// More files than are mapped at a time, read twice, forwards and backwards.
#[test]
fn files_are_mapped_again() {
    let slices: Vec<u16> = (0..600).collect();
    let first = |z: u16| z % 40 * 100;
    let (_folder, source) = Folder::opened(slices.iter().map(|&z| Written::slice(f64::from(z), first(z))));
    assert_eq!(source.access(), Access::Box);
    for &z in slices.iter().chain(slices.iter().rev()) {
        let region = VoxelBox::new([2, 1, u32::from(z)], [3, 2, u32::from(z) + 1]);
        source.announce(0, 0, VoxelBox::new([0, 0, u32::from(z)], [4, 2, u32::from(z) + 1]));
        let mut voxel = [0; 2];
        source.read_box(0, 0, region, &mut voxel).unwrap();
        assert_eq!(u16::from_le_bytes(voxel), first(z) + 6);
    }
}

#[test]
fn stacks_that_are_not_a_volume_are_refused_with_numbers() {
    let at = |z: f64| Written::slice(z, 0);
    let moved = |position: &str| {
        let mut slice = at(0.0);
        slice.text(tags::IMAGE_POSITION_PATIENT, VR::DS, position);
        slice
    };
    Folder::of([0.0, 2.0, 8.0, 10.0, 4.0].map(at)).refused(&[
        "expected 2.0000 mm",
        "found 4.0000 mm",
        "IM4",
        "IM2",
        "(-100, -50, 4)",
        "1 slice is missing",
        "1 of 4 steps",
        "add the missing files, or pass `gaps` blank",
    ]);
    Folder::of([0.0, 2.0, 4.3, 6.2].map(at)).refused(&["not evenly spaced", "2.3000", "`spacing`"]);
    Folder::of([0.0, 2.0, 2.0, 4.0].map(at)).refused(&[
        "IM2: has the position of",
        "IM1",
        "4 slices at 3 positions",
        "one time step",
    ]);
    Folder::of([at(0.0), at(0.0)]).refused(&["2 slices at 1 positions"]);
    // A shift by 1 mm for each mm: 45 degrees.
    Folder::of([moved("0\\0\\0"), moved("0\\1\\1"), moved("0\\3\\2")]).refused(&["IM1", "beside the line", "dcm2niix"]);
    Folder::of([moved("0\\0\\0"), moved("0\\9\\1")]).refused(&["sideways by 83.66 degrees", "side by side"]);
    Folder::of([moved("0\\0\\0"), moved("9\\0\\0")]).refused(&["IM1: lies beside", "9.000 mm away"]);
    let mut turned = at(4.0);
    turned.text(tags::IMAGE_ORIENTATION_PATIENT, VR::DS, "0\\1\\0\\0\\0\\-1");
    Folder::of([turned, at(0.0), at(2.0)])
        .refused(&["IM0: looks along (0, 1, 0) (0, 0, -1)", "2 look along (1, 0, 0)"]);
    let mut coarse = at(4.0);
    coarse.text(tags::PIXEL_SPACING, VR::DS, "1\\1");
    Folder::of([at(0.0), at(2.0), coarse]).refused(&["IM2: has pixels of 1 x 1 mm", "2 have pixels of 0.5 x 0.75 mm"]);
    let mut small = at(4.0);
    small.number(tags::ROWS, 2);
    Folder::of([at(0.0), small, at(2.0)]).refused(&["IM1: is 4 x 2 pixels", "2 are 4 x 3", "IM0"]);
    let mut skew = at(0.0);
    skew.text(tags::IMAGE_ORIENTATION_PATIENT, VR::DS, "1\\0\\0\\0.1\\1\\0");
    Folder::of([skew]).refused(&["not two perpendicular directions"]);
}

/// Slices at these positions along z, as written.
pub(super) fn at_texts(positions: &[&str]) -> Folder {
    Folder::of(positions.iter().map(|z| {
        let mut slice = Written::slice(0.0, 0);
        slice.text(tags::IMAGE_POSITION_PATIENT, VR::DS, &format!("-100.0\\-50.0\\{z}"));
        slice
    }))
}

#[test]
fn rounded_positions_are_even_as_far_as_their_digits_explain() {
    // Multiples of 7.04 mm, to one decimal; a trailing zero may be missing.
    let source = at_texts(&["0", "7.0", "14.1", "21.1", "28.2"]).open().unwrap();
    assert!((source.info().geometry.spacing.z - 7.05).abs() < 1e-9);
    let text = at_texts(&["0", "1.4", "2.9", "4.3", "5.7"]);
    let source = text.open().unwrap();
    let notes = said(&source.info().notes);
    assert!(notes.contains("1.4000 to 1.5000 mm apart") && notes.contains("1.4250 mm is taken"), "{notes}");
    // Not explained by the written digits, nor without any.
    at_texts(&["0.00", "1.40", "2.90", "4.30", "5.70"])
        .refused(&["not evenly spaced", "pass `spacing` 0.5,0.75,1.425 "]);
    at_texts(&["0", "10", "21", "31"]).refused(&["not evenly spaced", "pass `spacing` 0.5,0.75,10.3333 "]);
    // Rounding never explains a missing slice, nor a tenth of a step.
    let folder = at_texts(&["0", "0.1", "0.3", "0.4"]);
    folder.refused(&["1 slice is missing", "add the missing files, or pass `gaps` blank"]);
    at_texts(&["0", "0.4", "0.9", "1.3"]).refused(&["not evenly spaced"]);
    let message = at_texts(&["0.00", "1.40", "2.90"]).open().err().unwrap().to_string();
    assert!(!message.contains("missing"), "{message}");
}

#[test]
fn a_single_slice_names_the_element_of_its_depth() {
    let notes = |change: &dyn Fn(&mut Written) -> &mut Written| {
        let mut slice = Written::slice(0.0, 0);
        change(&mut slice);
        let (_folder, source) = Folder::opened([slice]);
        (source.info().geometry.spacing.z, said(&source.info().notes))
    };
    let (z, note) = notes(&|s| s);
    assert!(z == 5.0 && note.contains("its SliceThickness of 5 mm"), "{note}");
    let (z, note) = notes(&|s| s.text(tags::SPACING_BETWEEN_SLICES, VR::DS, "4"));
    assert!(z == 4.0 && note.contains("its SpacingBetweenSlices of 4 mm"), "{note}");
    // An empty one does not hide the other.
    let (z, note) = notes(&|s| s.text(tags::SPACING_BETWEEN_SLICES, VR::DS, "0"));
    assert!(z == 5.0 && note.contains("its SliceThickness of 5 mm"), "{note}");
    let (z, note) = notes(&|s| s.text(tags::SLICE_THICKNESS, VR::DS, ""));
    assert!(z == 1.0 && note.contains("1 mm is taken"), "{note}");
}

#[test]
fn told_spacings_settle_gaps_and_missing_pixel_sizes() {
    let folder = Folder::of([0.0, 2.0, 8.0, 10.0].map(|z| {
        let mut slice = Written::slice(z, 10 * z as u16);
        slice.text(tags::PIXEL_SPACING, VR::DS, "");
        slice
    }));
    folder.refused(&["PixelSpacing (0028,0030)", "found none", "`spacing`"]);
    // Commas for points.
    let commas = Folder::of([0.0, 5.0].map(|z| {
        let mut slice = Written::slice(z, 0);
        slice.text(tags::PIXEL_SPACING, VR::DS, "0,143\\0,143");
        slice
    }));
    commas.refused(&["PixelSpacing (0028,0030)", "found '0,143\\0,143'", "`spacing`"]);
    let spacing = DVec3::new(0.5, 0.5, 2.0);
    let told = OpenOptions { spacing: Some(spacing), ..OpenOptions::default() };
    let source = open(&[folder.0.path().to_owned()], &told).unwrap();
    assert_eq!(source.info().geometry.spacing, spacing);
    let found = voxels(&*source);
    assert_eq!([0, 12, 24, 36].map(|i| found[i]), [0.0, 20.0, 80.0, 100.0]);
    let notes = said(&source.info().notes);
    assert!(notes.contains("2.0000 to 6.0000 mm apart by their positions, and taken as 2 mm apart"), "{notes}");
    assert!(is_warned(&notes, "taken as 2 mm apart"), "{notes}");
    // The third and the fourth, 2 and 3 steps up, are 8 and 10 mm up.
    assert!(notes.contains("4.0000 mm from its position") && notes.contains("`gaps` blank"), "{notes}");
    assert!(is_warned(&notes, "4.0000 mm from its position"), "{notes}");
    // Even positions cause no note, whatever the spacing.
    let even = open_with(&Folder::of(shuffled()), &told);
    assert!(!said(&even.unwrap().info().notes).contains("apart"));
}

pub(super) fn open_with(folder: &Folder, options: &OpenOptions) -> Result<Box<dyn Source>, ImportError> {
    open(&[folder.0.path().to_owned()], options)
}

#[test]
fn missing_and_wrong_elements_are_named() {
    let without = |tag: Tag| {
        let mut slice = Written::slice(0.0, 0);
        slice.0.remove_element(tag);
        Folder::of([slice])
    };
    without(tags::IMAGE_POSITION_PATIENT).refused(&["IM0", "ImagePositionPatient (0020,0032)", "found none"]);
    without(tags::IMAGE_ORIENTATION_PATIENT).refused(&["ImageOrientationPatient (0020,0037)", "found none"]);
    without(tags::COLUMNS).refused(&["Columns (0028,0011)", "missing"]);
    without(tags::PIXEL_DATA).refused(&["IM0", "pixel data", "a header alone"]);
    let changed = |change: &dyn Fn(&mut Written) -> &mut Written| {
        let mut slice = Written::slice(0.0, 0);
        change(&mut slice);
        Folder::of([slice])
    };
    changed(&|s| s.text(tags::IMAGE_POSITION_PATIENT, VR::DS, "1\\2")).refused(&["found [1.0, 2.0]"]);
    changed(&|s| s.number(tags::SAMPLES_PER_PIXEL, 3).text(tags::PHOTOMETRIC_INTERPRETATION, VR::CS, "RGB"))
        .refused(&["colour image (RGB, 3 samples", "not supported", "export it as a gray image"]);
    changed(&|s| s.number(tags::BITS_ALLOCATED, 1)).refused(&["1 bits a pixel"]);
    changed(&|s| s.number(tags::BITS_STORED, 17)).refused(&["BitsStored 17"]);
    changed(&|s| s.text(tags::RESCALE_SLOPE, VR::DS, "0")).refused(&["RescaleSlope is 0"]);
    changed(&|s| s.text(tags::RESCALE_SLOPE, VR::DS, "NaN")).refused(&["RescaleSlope is 'NaN'"]);
    changed(&|s| s.text(tags::RESCALE_SLOPE, VR::DS, "2").text(tags::RESCALE_INTERCEPT, VR::DS, "1,5"))
        .refused(&["RescaleIntercept is '1,5'", "finite number"]);
    changed(&|s| s.number(tags::ROWS, 30)).refused(&["cut short", "240 bytes", "found 24 (216 missing)"]);
    changed(&|s| s.text(tags::NUMBER_OF_FRAMES, VR::IS, "2").number(tags::ROWS, 1))
        .refused(&["2 frames without a place for each", "PerFrameFunctionalGroupsSequence"]);
    for count in ["1A", "2\\2", "0", "-1", "1.5"] {
        changed(&|s| s.text(tags::NUMBER_OF_FRAMES, VR::IS, count))
            .refused(&[count, "expected a whole number from 1 on"]);
    }
    changed(&|s| s.sequence(tags::MODALITY_LUT_SEQUENCE, vec![])).refused(&["ModalityLUTSequence"]);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a");
    Written::slice(0.0, 0).fragments(vec![vec![0; 64]]).save(&path, uids::JPEGLS_LOSSLESS);
    let message = open(&[path], &OpenOptions::default()).err().unwrap().to_string();
    assert!(message.contains("JPEG-LS Lossless") && message.contains("not supported"), "{message}");
}

#[test]
fn files_without_an_image_are_left_out_of_folders() {
    let mut report = Written(InMemDicomObject::new_empty());
    report.text(tags::SERIES_INSTANCE_UID, VR::UI, "1.2.77");
    let folder = Folder::of(shuffled().chain([report]));
    let source = folder.open().unwrap();
    assert_eq!(source.info().extent.z, 5);
    assert!(source.info().notes[0].contains("1 DICOM file without an image"), "{:?}", source.info().notes);
    let message = open(&[folder.file(5)], &OpenOptions::default()).err().unwrap().to_string();
    assert!(message.contains("without an image"), "{message}");
}

/// Run-length encoding of 16-bit pixels in runs of one kind: `literal` or repeats of a value.
fn rle(pixels: &[u16], literal: bool) -> Vec<u8> {
    let planes = [8, 0].map(|shift| {
        let bytes: Vec<u8> = pixels.iter().map(|p| (p >> shift) as u8).collect();
        let mut out = Vec::new();
        for run in bytes.chunk_by(|a, b| literal || a == b) {
            match literal {
                true => out.push(run.len() as u8 - 1),
                false => out.push((1 - run.len() as i32) as u8),
            }
            out.extend(if literal { run } else { &run[..1] });
        }
        // A head of -128 has no effect.
        out.push(0x80);
        out
    });
    let mut header = [0u32; 16];
    header[..3].copy_from_slice(&[2, 64, 64 + planes[0].len() as u32]);
    let header = header.iter().flat_map(|w| w.to_le_bytes());
    header.chain(planes.iter().flatten().copied()).collect()
}

#[test]
fn run_lengths_are_decoded_and_short_ones_refused() {
    let pixels: Vec<u16> = vec![7, 7, 7, 7, 260, 260, 1, 1, 1, 1, 1, 4000];
    let packed = |fragment: Vec<u8>| {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        Written::slice(0.0, 0).fragments(vec![fragment]).save(&path, uids::RLE_LOSSLESS);
        let source = open(&[path], &OpenOptions::default()).unwrap();
        let mut out = vec![0; 24];
        source.read_box(0, 0, source.info().extent.full_box(), &mut out).map(|()| voxels(&*source))
    };
    let expected: Vec<f64> = pixels.iter().map(|p| f64::from(*p)).collect();
    for literal in [true, false] {
        assert_eq!(packed(rle(&pixels, literal)).unwrap(), expected);
    }
    let message = packed(rle(&pixels[..9], true)).unwrap_err().to_string();
    assert!(message.contains("frame 1") && message.contains("expected 12 pixels, found 9"), "{message}");
    assert!(packed(vec![0; 10]).is_err());
    let mut wild = rle(&pixels, true);
    wild[4..8].copy_from_slice(&u32::MAX.to_le_bytes());
    assert!(packed(wild).unwrap_err().to_string().contains("past its end"));
}

/// Lossless JPEG of 12-bit pixels.
fn lossless_jpeg(pixels: &[u16], columns: u16) -> Vec<u8> {
    Lossless { bits: 12, columns, shift: 0, rows_to_restart: 0 }.packed(pixels)
}

#[test]
fn packed_icons_in_a_sequence_are_passed_over() {
    let mut slice = Written::slice(0.0, 7);
    let mut icon = Written(InMemDicomObject::new_empty());
    icon.number(tags::ROWS, 64).number(tags::BITS_ALLOCATED, 8).fragments(vec![vec![0xff; 10], vec![]]);
    slice.sequence(tags::ICON_IMAGE_SEQUENCE, vec![icon.0]);
    let (_folder, source) = Folder::opened([slice]);
    assert_eq!(voxels(&*source), (7..19).map(f64::from).collect::<Vec<_>>());
}

#[test]
fn what_is_left_out_of_pixels_is_said() {
    let mut slice = Written::slice(0.0, 7);
    slice.pixels(&(7..31).collect::<Vec<_>>());
    slice.sequence(tags::REAL_WORLD_VALUE_MAPPING_SEQUENCE, vec![InMemDicomObject::new_empty()]);
    let (_folder, source) = Folder::opened([slice]);
    assert_eq!(voxels(&*source), (7..19).map(f64::from).collect::<Vec<_>>());
    let notes = said(&source.info().notes);
    assert!(is_warned(&notes, "24 bytes after the pixels of IM0 are left out"), "{notes}");
    assert!(is_warned(&notes, "real-world values"), "{notes}");
}

#[test]
fn headers_in_another_syntax_than_is_named_are_read() {
    let (explicit, implicit) = (uids::EXPLICIT_VR_LITTLE_ENDIAN, uids::IMPLICIT_VR_LITTLE_ENDIAN);
    for (named, written) in [(explicit, implicit), (implicit, explicit)] {
        let folder = tempfile::tempdir().unwrap();
        let [named, written] = [(named, "named"), (written, "written")].map(|(syntax, name)| {
            let path = folder.path().join(name);
            Written::slice(0.0, 7).save(&path, syntax);
            let bytes = std::fs::read(&path).unwrap();
            std::fs::remove_file(path).unwrap();
            // The data set begins with the slice's thickness, (0018,0050).
            let start = bytes.windows(4).position(|w| w == [0x18, 0, 0x50, 0]).unwrap();
            (bytes[..start].to_vec(), bytes[start..].to_vec())
        });
        let path = folder.path().join("a.dcm");
        std::fs::write(&path, [named.0, written.1].concat()).unwrap();
        let source = open(&[path], &OpenOptions::default()).unwrap();
        assert_eq!(voxels(&*source), (7..19).map(f64::from).collect::<Vec<_>>());
    }
}

#[test]
fn sequences_of_unknown_representation_are_passed_over() {
    check_unknown(false);
    check_unknown(true);
}

/// Checks that a sequence of unknown representation without a length is passed over, alone or nested in another.
#[track_caller]
fn check_unknown(is_nested: bool) {
    let private = Tag(0x0009, 0x1010);
    let mut slice = Written::slice(0.0, 7);
    let mut within = Written(InMemDicomObject::new_empty());
    let unknown = DataElement::new(private, VR::UN, PrimitiveValue::from(vec![b'?'; 4]));
    if is_nested {
        within.0.put(unknown);
        within.number(tags::ROWS, 99);
        slice.sequence(tags::REFERENCED_IMAGE_SEQUENCE, vec![within.0]);
    } else {
        slice.0.put(unknown);
    }
    let folder = Folder::of([slice]);
    let bytes = std::fs::read(folder.file(0)).unwrap();
    let at = bytes.windows(6).position(|w| w == b"\x09\0\x10\x10UN").unwrap();
    let mut content = Vec::new();
    let mut put = |tag: Tag, length: u32| {
        content.extend([tag.0, tag.1].map(u16::to_le_bytes).concat());
        content.extend(length.to_le_bytes());
    };
    // An item of defined length, then one with a value and a sequence with an empty item.
    let (item, item_end, end) = (Tag(0xfffe, 0xe000), Tag(0xfffe, 0xe00d), Tag(0xfffe, 0xe0dd));
    let undefined = u32::MAX;
    let heads = [
        (item, 0),
        (item, undefined),
        (tags::ROWS, 0),
        (private, undefined),
        (item, 0),
        (end, 0),
        (item_end, 0),
        (end, 0),
    ];
    heads.into_iter().for_each(|(tag, length)| put(tag, length));
    // The length is in the last four of the header's 12 bytes, the value in the next four.
    let changed = [&bytes[..at + 8], &undefined.to_le_bytes(), &content, &bytes[at + 16..]].concat();
    std::fs::write(folder.file(0), &changed).unwrap();
    assert_eq!(voxels(&*folder.open().unwrap()), (7..19).map(f64::from).collect::<Vec<_>>());
    // Cut within the sequence.
    std::fs::write(folder.file(0), &changed[..at + 20]).unwrap();
    folder.refused(&["without an end"]);
}

#[test]
fn lossless_jpeg_is_decoded_exactly_and_damage_refused() {
    let pixels: Vec<u16> = vec![0, 4095, 17, 18, 2048, 2047, 2046, 300, 301, 299, 4000, 0];
    let packed = |fragments: Vec<Vec<u8>>| {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        Written::slice(0.0, 0).fragments(fragments).save(&path, uids::JPEG_LOSSLESS_SV1);
        let source = open(&[path], &OpenOptions::default())?;
        let mut out = vec![0; 24];
        source.read_box(0, 0, source.info().extent.full_box(), &mut out).map(|()| voxels(&*source))
    };
    let expected: Vec<f64> = pixels.iter().map(|p| f64::from(*p)).collect();
    let whole = lossless_jpeg(&pixels, 4);
    assert_eq!(packed(vec![whole.clone()]).unwrap(), expected);
    // One frame may be in several fragments.
    assert_eq!(packed(vec![whole[..60].to_vec(), whole[60..].to_vec()]).unwrap(), expected);
    let message = packed(vec![lossless_jpeg(&pixels, 6)]).unwrap_err().to_string();
    assert!(message.contains("expected 4 x 3") && message.contains("found 6 x 2"), "{message}");
    assert!(packed(vec![whole[..70].to_vec()]).is_err());
    assert!(packed(vec![b"no picture".to_vec()]).is_err());
}

#[test]
fn frames_in_several_fragments_without_a_table_are_decoded() {
    let frames = [[0, 4095, 17, 18, 2048, 2047, 2046, 300, 301, 299, 4000, 0], [5; 12]];
    let [upper, lower] = frames.map(|pixels: [u16; 12]| lossless_jpeg(&pixels, 4));
    let opened = |fragments: Vec<Vec<u8>>| {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        enhanced().fragments(fragments).save(&path, uids::JPEG_LOSSLESS_SV1);
        open(&[path], &OpenOptions::default()).map(|source| voxels(&*source)).map_err(|error| error.to_string())
    };
    let [low, high] =
        [(frames[1], 5), (frames[0], -5)].map(|(pixels, shift)| pixels.map(|p| f64::from(2 * i32::from(p) + shift)));
    let parts = vec![upper[..60].to_vec(), upper[60..80].to_vec(), upper[80..].to_vec(), lower.clone()];
    assert_eq!(opened(parts).unwrap(), [low, high].concat());
    let joined = vec![[&upper[..], &lower[..40]].concat(), lower[40..60].to_vec(), lower[60..].to_vec()];
    assert!(opened(joined).unwrap_err().contains("fragments cannot be assigned to frames"));
}

/// An enhanced file: two frames in one, the upper one first, with all else shared.
pub(super) fn enhanced() -> Written {
    let item = |put: &[(Tag, VR, &str)]| {
        let mut written = Written(InMemDicomObject::new_empty());
        for (tag, vr, text) in put {
            written.text(*tag, *vr, text);
        }
        written.0
    };
    let group = |parts: Vec<(Tag, InMemDicomObject)>| {
        let mut written = Written(InMemDicomObject::new_empty());
        for (tag, part) in parts {
            written.sequence(tag, vec![part]);
        }
        written.0
    };
    let place = |position: &str, intercept: &str| {
        group(vec![
            (tags::PLANE_POSITION_SEQUENCE, item(&[(tags::IMAGE_POSITION_PATIENT, VR::DS, position)])),
            (
                tags::PIXEL_VALUE_TRANSFORMATION_SEQUENCE,
                item(&[(tags::RESCALE_SLOPE, VR::DS, "2"), (tags::RESCALE_INTERCEPT, VR::DS, intercept)]),
            ),
        ])
    };
    let mut file = Written::slice(0.0, 0);
    for tag in [tags::IMAGE_POSITION_PATIENT, tags::IMAGE_ORIENTATION_PATIENT, tags::PIXEL_SPACING] {
        file.0.remove_element(tag);
    }
    let orientation = item(&[(tags::IMAGE_ORIENTATION_PATIENT, VR::DS, "1\\0\\0\\0\\1\\0")]);
    let measures = item(&[(tags::PIXEL_SPACING, VR::DS, "0.75\\0.5")]);
    let shared =
        group(vec![(tags::PLANE_ORIENTATION_SEQUENCE, orientation), (tags::PIXEL_MEASURES_SEQUENCE, measures)]);
    file.text(tags::NUMBER_OF_FRAMES, VR::IS, "2");
    file.sequence(tags::SHARED_FUNCTIONAL_GROUPS_SEQUENCE, vec![shared]);
    let frames = vec![place("1\\2\\9", "-5"), place("1\\2\\6", "5")];
    file.sequence(tags::PER_FRAME_FUNCTIONAL_GROUPS_SEQUENCE, frames);
    file.pixels(&(0..24).collect::<Vec<_>>());
    file
}

fn slice_of_another_series() -> Written {
    let mut slice = Written::slice(0.0, 0);
    slice.text(tags::SERIES_INSTANCE_UID, VR::UI, "1.2.9");
    slice
}

#[test]
fn several_deflated_frames_and_unknown_syntaxes_name_a_way_on() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("enhanced.dcm");
    let refusal = || open(std::slice::from_ref(&path), &OpenOptions::default()).err().unwrap().to_string();
    enhanced().save_deflated(&path);
    assert!(refusal().contains("a deflated file of several frames") && refusal().contains("dcmconv"), "{}", refusal());
    enhanced().save(&path, uids::EXPLICIT_VR_LITTLE_ENDIAN);
    let mut bytes = std::fs::read(&path).unwrap();
    let uid = uids::EXPLICIT_VR_LITTLE_ENDIAN.as_bytes();
    let at = bytes.windows(uid.len()).position(|window| window == uid).expect("the syntax");
    bytes[at + uid.len() - 1] = b'9';
    std::fs::write(&path, bytes).unwrap();
    assert!(refusal().contains("unknown (1.2.840.10008.1.2.9)"), "{}", refusal());
}

#[test]
fn enhanced_files_place_and_rescale_every_frame() {
    for syntax in [uids::EXPLICIT_VR_LITTLE_ENDIAN, uids::IMPLICIT_VR_LITTLE_ENDIAN] {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("enhanced.dcm");
        enhanced().save(&path, syntax);
        let source = open(&[path], &OpenOptions::default()).unwrap();
        assert_eq!(source.info().extent.to_array(), [4, 3, 2]);
        assert_eq!(source.info().geometry.spacing, DVec3::new(0.5, 0.75, 3.0));
        let found = voxels(&*source);
        assert_eq!([found[0], found[11], found[12], found[23]], [29.0, 51.0, -5.0, 17.0], "{syntax}");
    }
    let several = Folder::of([enhanced(), enhanced(), slice_of_another_series()]);
    let source = open(&[several.file(0)], &OpenOptions::default()).unwrap();
    let notes = said(&source.info().notes);
    assert!(source.info().extent.z == 2 && notes.contains("1 file more of its series"), "{notes}");
    assert!(is_warned(&notes, "1 file more of its series"), "{notes}");
    let mut unplaced = enhanced();
    unplaced.text(tags::NUMBER_OF_FRAMES, VR::IS, "1");
    Folder::of([unplaced]).refused(&["declares 1 frame, but gives positions for 2"]);
}

#[test]
fn cut_files_are_refused_wherever_they_are_cut() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a");
    for (syntax, written) in [
        (uids::EXPLICIT_VR_LITTLE_ENDIAN, enhanced()),
        (uids::RLE_LOSSLESS, {
            let mut slice = Written::slice(0.0, 0);
            slice.fragments(vec![rle(&[5; 12], false)]);
            slice
        }),
    ] {
        written.save(&path, syntax);
        let whole = std::fs::read(&path).unwrap();
        for length in (132..whole.len()).step_by(3) {
            std::fs::write(&path, &whole[..length]).unwrap();
            let read = open(std::slice::from_ref(&path), &OpenOptions::default()).map(|source| {
                let bytes = source.info().extent.volume() as usize * source.info().voxel_type.bytes();
                source.read_box(0, 0, source.info().extent.full_box(), &mut vec![0; bytes])
            });
            assert!(!matches!(read, Ok(Ok(()))), "{length} of {} bytes are enough", whole.len());
        }
    }
}

proptest::proptest! {
    #![proptest_config(crate::testing::cases(400))]

    /// Damage leads to an error or wrong voxels, never to a panic or excessive memory.
    #[test]
    fn damage_does_not_panic(
        damage in proptest::collection::vec((proptest::prelude::any::<proptest::sample::Index>(), proptest::prelude::any::<u8>()), 1..8),
        kind in 0..4usize,
    ) {
        let (syntax, written) = match kind {
            0 => (uids::EXPLICIT_VR_LITTLE_ENDIAN, enhanced()),
            1 => (uids::IMPLICIT_VR_LITTLE_ENDIAN, enhanced()),
            2 => {
                let mut slice = Written::slice(0.0, 0);
                slice.fragments(vec![rle(&[5; 12], false)]);
                (uids::RLE_LOSSLESS, slice)
            }
            _ => {
                let mut slice = Written::slice(0.0, 0);
                slice.fragments(vec![lossless_jpeg(&[9; 12], 4)]);
                (uids::JPEG_LOSSLESS_SV1, slice)
            }
        };
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        written.save(&path, syntax);
        let mut bytes = std::fs::read(&path).unwrap();
        for (place, value) in damage {
            let place = 132 + place.index(bytes.len() - 132);
            bytes[place] = value;
        }
        std::fs::write(&path, &bytes).unwrap();
        if let Ok(source) = open(&[path], &OpenOptions::default()) {
            let bytes = source.info().extent.volume() as usize * source.info().voxel_type.bytes();
            let _ = source.read_box(0, 0, source.info().extent.full_box(), &mut vec![0; bytes]);
        }
    }
}

/// Files as passed on by networks: without a preamble, and without the group naming the syntax.
#[test]
fn files_without_a_preamble_are_read() {
    let whole = |i: u16| (100 * i..100 * i + 12).map(f64::from);
    let expected: Vec<f64> = (0..3).flat_map(whole).collect();
    for syntax in [uids::EXPLICIT_VR_LITTLE_ENDIAN, uids::IMPLICIT_VR_LITTLE_ENDIAN] {
        for (first, charset) in [
            (tags::SPECIFIC_CHARACTER_SET, "ISO_IR 100"),
            (tags::SPECIFIC_CHARACTER_SET, ""),
            (tags::IMAGE_TYPE, "ISO_IR 100"),
            (tags::SOP_CLASS_UID, ""),
        ] {
            for has_group in [true, false] {
                let folder = Folder::of([]);
                for i in 0..3 {
                    let mut slice = Written::slice(5.0 * f64::from(i), 100 * i as u16);
                    let text = if first == tags::SOP_CLASS_UID { uids::CT_IMAGE_STORAGE } else { charset };
                    slice.text(first, if first == tags::SOP_CLASS_UID { VR::UI } else { VR::CS }, text);
                    let path = folder.file(i as usize);
                    slice.save(&path, syntax);
                    let bytes = std::fs::read(&path).unwrap();
                    let length = u32::from_le_bytes(bytes[140..144].try_into().unwrap()) as usize;
                    std::fs::write(&path, &bytes[if has_group { 132 } else { 144 + length }..]).unwrap();
                }
                let source = folder.open().unwrap();
                let mut bytes = vec![0; 2 * 4 * 3 * 3];
                source.read_box(0, 0, source.info().extent.full_box(), &mut bytes).unwrap();
                let found: Vec<f64> =
                    bytes.chunks_exact(2).map(|pair| f64::from(i16::from_le_bytes([pair[0], pair[1]]))).collect();
                assert_eq!(found, expected, "{syntax}, {first}, {has_group}");
            }
        }
    }
    // A slice lost beside others.
    let folder = Folder::of((0..3).map(|i| Written::slice(5.0 * f64::from(i), 0)));
    for bytes in [&b""[..], &[0; 200]] {
        std::fs::write(folder.0.path().join("IM3.dcm"), bytes).unwrap();
        folder.refused(&["IM3.dcm: not a DICOM file, unlike its name"]);
    }
    // Packed pixels do not reveal their packing.
    let folder = Folder::of([]);
    let path = folder.file(0);
    let mut slice = Written::slice(0.0, 0);
    slice.text(tags::SPECIFIC_CHARACTER_SET, VR::CS, "ISO_IR 100").fragments(vec![vec![0; 40]]);
    slice.save(&path, uids::EXPLICIT_VR_LITTLE_ENDIAN);
    let bytes = std::fs::read(&path).unwrap();
    let length = u32::from_le_bytes(bytes[140..144].try_into().unwrap()) as usize;
    std::fs::write(&path, &bytes[144 + length..]).unwrap();
    folder.refused(&["its pixels are encapsulated; write it again"]);
}
