//! Segmentations, whole and broken in every refused way.

use super::tests::{Written, voxels};
use crate::error::ImportError;
use crate::open::open;
use crate::options::{Gaps, OpenOptions};
use crate::source::Source;
use crate::testing::said;
use brickyard_volume::{VoxelBox, VoxelType};
use dicom_core::{DataElement, PrimitiveValue, Tag, VR};
use dicom_dictionary_std::{tags, uids};
use dicom_object::InMemDicomObject;
use proptest::prelude::*;
use std::path::PathBuf;

/// A frame: its height, its segment, and its pixels.
type Frame = (f64, u16, [u8; 15]);

fn item(fill: impl FnOnce(&mut Written)) -> InMemDicomObject {
    let mut written = Written(InMemDicomObject::new_empty());
    fill(&mut written);
    written.0
}

fn put_bytes(written: &mut Written, bytes: Vec<u8>) {
    written.0.put(DataElement::new(tags::PIXEL_DATA, VR::OB, PrimitiveValue::U8(bytes.into())));
}

/// A file of 5 x 3 pixels a frame, so frames of bits begin within bytes, with slices 2 mm apart and segments 1 to 3.
fn segmentation(form: &str, frames: &[Frame]) -> Written {
    let mut file = Written(InMemDicomObject::new_empty());
    let is_bits = form == "BINARY";
    let class = if form == "LABELMAP" { uids::LABEL_MAP_SEGMENTATION_STORAGE } else { uids::SEGMENTATION_STORAGE };
    file.text(tags::SOP_CLASS_UID, VR::UI, class).text(tags::SERIES_INSTANCE_UID, VR::UI, "1.2.5");
    file.text(
        tags::PHOTOMETRIC_INTERPRETATION,
        VR::CS,
        if form == "LABELMAP" { "PALETTE COLOR" } else { "MONOCHROME2" },
    );
    file.text(tags::SEGMENTATION_TYPE, VR::CS, form).number(tags::MAXIMUM_FRACTIONAL_VALUE, 200);
    let bits = if is_bits { 1 } else { 8 };
    for (tag, number) in [
        (tags::SAMPLES_PER_PIXEL, 1),
        (tags::ROWS, 3),
        (tags::COLUMNS, 5),
        (tags::BITS_ALLOCATED, bits),
        (tags::BITS_STORED, bits),
        (tags::HIGH_BIT, bits - 1),
        (tags::PIXEL_REPRESENTATION, 0),
    ] {
        file.number(tag, number);
    }
    let segment = |number: u16, name: &str| {
        item(|segment| _ = segment.number(tags::SEGMENT_NUMBER, number).text(tags::SEGMENT_LABEL, VR::LO, name))
    };
    file.sequence(tags::SEGMENT_SEQUENCE, vec![segment(1, "liver"), segment(2, "spleen"), segment(300, "tumour")]);
    let shared = item(|shared| {
        let orientation = item(|part| _ = part.text(tags::IMAGE_ORIENTATION_PATIENT, VR::DS, "1\\0\\0\\0\\1\\0"));
        let measures = item(|part| {
            part.text(tags::PIXEL_SPACING, VR::DS, "0.75\\0.5").text(tags::SPACING_BETWEEN_SLICES, VR::DS, "2");
        });
        shared.sequence(tags::PLANE_ORIENTATION_SEQUENCE, vec![orientation]);
        shared.sequence(tags::PIXEL_MEASURES_SEQUENCE, vec![measures]);
    });
    file.sequence(tags::SHARED_FUNCTIONAL_GROUPS_SEQUENCE, vec![shared]);
    let group = |(z, segment, _): &Frame| {
        item(|group| {
            let position = item(|part| _ = part.text(tags::IMAGE_POSITION_PATIENT, VR::DS, &format!("1\\2\\{z}")));
            group.sequence(tags::PLANE_POSITION_SEQUENCE, vec![position]);
            let of = item(|part| _ = part.number(tags::REFERENCED_SEGMENT_NUMBER, *segment));
            group.sequence(tags::SEGMENT_IDENTIFICATION_SEQUENCE, vec![of]);
        })
    };
    file.sequence(tags::PER_FRAME_FUNCTIONAL_GROUPS_SEQUENCE, frames.iter().map(group).collect());
    file.text(tags::NUMBER_OF_FRAMES, VR::IS, &frames.len().to_string());
    let pixels: Vec<u8> = frames.iter().flat_map(|(_, _, pixels)| *pixels).collect();
    let packed = |bits: &[u8]| bits.iter().enumerate().fold(0, |byte, (i, bit)| byte | (bit << i));
    put_bytes(&mut file, if is_bits { pixels.chunks(8).map(packed).collect() } else { pixels });
    file
}

fn bits(set: &[usize]) -> [u8; 15] {
    std::array::from_fn(|i| u8::from(set.contains(&i)))
}

/// Planes at 10, 12 and 18 mm; none at 14 and 16.
fn binary() -> Written {
    let frames =
        [(18.0, 1, bits(&[0, 14])), (10.0, 2, bits(&[1, 2, 9])), (12.0, 1, bits(&[5])), (10.0, 300, bits(&[0, 8]))];
    segmentation("BINARY", &frames)
}

fn saved(file: &Written) -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("seg.dcm");
    file.save(&path, uids::EXPLICIT_VR_LITTLE_ENDIAN);
    (folder, path)
}

fn opened(file: &Written, options: &OpenOptions) -> Result<(tempfile::TempDir, Box<dyn Source>), ImportError> {
    let (folder, path) = saved(file);
    open(&[path], options).map(|source| (folder, source))
}

#[track_caller]
fn refused(file: &Written, options: &OpenOptions, words: &[&str]) {
    let message = opened(file, options).err().expect("a refusal").to_string();
    assert!(words.iter().all(|word| message.contains(word)), "{message}");
}

fn named(segment: &str) -> OpenOptions {
    OpenOptions { variable: Some(segment.into()), ..OpenOptions::default() }
}

#[test]
fn bits_become_labels_where_their_frames_lie() {
    let expected = |label: u16, at: &[(usize, u16)]| {
        let mut voxels = vec![0.0; 75];
        at.iter().filter(|(_, of)| label == 0 || *of == label).for_each(|(i, of)| voxels[*i] = f64::from(*of));
        voxels
    };
    let all = [(0, 300), (1, 2), (2, 2), (8, 300), (9, 2), (20, 1), (60, 1), (74, 1)];
    let labels = OpenOptions { are_labels: Some(true), ..OpenOptions::default() };
    for options in [&OpenOptions::default(), &labels] {
        let (_folder, source) = opened(&binary(), options).unwrap();
        let info = source.info();
        assert_eq!((info.extent.to_array(), info.voxel_type), ([5, 3, 5], VoxelType::U16));
        assert_eq!(info.orientation.unwrap().rows()[2], [0.0, 0.0, 2.0, 10.0]);
        assert_eq!(voxels(&*source), expected(0, &all));
        let notes = said(&info.notes);
        assert!(notes.contains("1 \"liver\", 2 \"spleen\", 300 \"tumour\"") && notes.contains("2 slices"), "{notes}");
        let mut part = vec![7; 2 * 2 * 2 * 2];
        source.read_box(0, 0, VoxelBox::new([0, 0, 0], [2, 2, 2]), &mut part).unwrap();
        let part: Vec<f64> = (0..8).map(|i| VoxelType::U16.read(&part, i)).collect();
        assert_eq!(part, [300.0, 2.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0]);
    }
    for (name, label) in [("2", 2), ("spleen", 2), ("tumour", 300)] {
        let (_folder, source) = opened(&binary(), &named(name)).unwrap();
        assert_eq!(voxels(&*source), expected(label, &all), "{name}");
    }
    refused(&binary(), &named("4"), &["`variable` '4'", "0 segments", "1 \"liver\""]);
}

#[test]
fn segmentations_but_fractions_say_that_they_are_labels() {
    let ramp: [u8; 15] = std::array::from_fn(|i| 10 * i as u8);
    for (form, are_labels) in [("BINARY", true), ("LABELMAP", true), ("FRACTIONAL", false)] {
        let file = segmentation(form, &[(0.0, 1, ramp)]);
        let (_folder, source) = opened(&file, &OpenOptions::default()).unwrap();
        assert_eq!(source.info().kind.are_labels(), are_labels, "{form}");
        assert_eq!(said(&source.info().notes).contains("never averaged"), are_labels, "{form}");
        if form == "BINARY" {
            let (_folder, one) = opened(&file, &named("1")).unwrap();
            assert!(one.info().kind.are_labels());
        }
        // A folder with one file, as a series of it.
        let (folder, _path) = saved(&file);
        let source = open(&[folder.path().to_owned()], &OpenOptions::default()).unwrap();
        assert_eq!(source.info().kind.are_labels(), are_labels, "{form}");
    }
}

#[test]
fn overlapping_segments_are_read_one_by_one() {
    let file = segmentation("BINARY", &[(0.0, 1, bits(&[3, 4])), (0.0, 2, bits(&[4]))]);
    refused(&file, &OpenOptions::default(), &["segment 2 \"spleen\" overlaps", "1 \"liver\"", "`variable`"]);
    let (_folder, source) = opened(&file, &named("liver")).unwrap();
    assert_eq!(voxels(&*source)[..5], [0.0, 0.0, 0.0, 1.0, 1.0]);
}

#[test]
fn fractions_are_channels_and_label_maps_are_labels() {
    let ramp: [u8; 15] = std::array::from_fn(|i| 10 * i as u8);
    let frames = [(0.0, 1, ramp), (4.0, 300, ramp)];
    let (_folder, source) = opened(&segmentation("FRACTIONAL", &frames), &OpenOptions::default()).unwrap();
    let info = source.info();
    assert_eq!((info.channels, info.voxel_type, info.extent.z), (3, VoxelType::F32, 3));
    assert_eq!(info.channel_looks[2].name.as_deref(), Some("tumour"));
    let read = |channel, z| {
        let mut bytes = vec![0; 15 * 4];
        source.read_box(0, channel, VoxelBox::new([0, 0, z], [5, 3, z + 1]), &mut bytes).unwrap();
        VoxelType::F32.read(&bytes, 14)
    };
    let seven = f64::from(0.7f32);
    assert_eq!([read(0, 0), read(1, 0), read(2, 0), read(0, 2), read(2, 2)], [seven, 0.0, 0.0, 0.0, seven]);
    let labels = OpenOptions { are_labels: Some(true), ..OpenOptions::default() };
    refused(&segmentation("FRACTIONAL", &frames), &labels, &["fractions of segments"]);
    let (_folder, source) = opened(&segmentation("LABELMAP", &frames), &labels).unwrap();
    assert_eq!((source.info().voxel_type, source.info().extent.z), (VoxelType::U8, 3));
    let found = voxels(&*source);
    assert_eq!((found[14], found[15], found[44]), (140.0, 0.0, 140.0));
}

#[test]
fn broken_segmentations_are_refused() {
    let plain = OpenOptions::default();
    let changed = |change: &dyn Fn(&mut Written)| {
        let mut file = binary();
        change(&mut file);
        file
    };
    let text = |tag: Tag, vr, text: &str| changed(&|file| _ = file.text(tag, vr, text));
    refused(&text(tags::SEGMENTATION_TYPE, VR::CS, "OTHER"), &plain, &["SegmentationType is 'OTHER'"]);
    refused(&text(tags::NUMBER_OF_FRAMES, VR::IS, "5"), &plain, &["declares 5 frames, but gives positions for 4"]);
    refused(&changed(&|file| _ = file.number(tags::BITS_ALLOCATED, 8)), &plain, &["BitsAllocated 8"]);
    refused(&changed(&|file| put_bytes(file, vec![0; 6])), &plain, &["4 frames of 5 x 3 bits are 8 bytes, found 6"]);
    let none = changed(&|file| _ = file.sequence(tags::SEGMENT_SEQUENCE, vec![]));
    refused(&none, &plain, &["frame 1", "segment 1", "SegmentSequence does not list"]);
    let twice = [(0.0, 1, bits(&[3])), (0.0, 1, bits(&[4]))];
    refused(&segmentation("BINARY", &twice), &plain, &["frame 2", "the same segment at the same position"]);
    let between = [(0.0, 1, bits(&[3])), (3.0, 1, bits(&[4]))];
    refused(&segmentation("BINARY", &between), &plain, &["expected 2.0000 mm", "found 3.0000 mm"]);
    let far = [(0.0, 1, bits(&[3])), (2e8, 1, bits(&[4]))];
    refused(&segmentation("BINARY", &far), &plain, &["within 65536"]);
    let blank = OpenOptions { gaps: Gaps::Blank, ..OpenOptions::default() };
    refused(&binary(), &blank, &["`gaps`", "label 0"]);
}

proptest! {
    #[test]
    fn damaged_segmentations_never_panic(changes in prop::collection::vec((132usize..1800, any::<u8>()), 1..4)) {
        let (_folder, path) = saved(&binary());
        let mut bytes = std::fs::read(&path).unwrap();
        for (at, value) in changes {
            let at = at % bytes.len();
            bytes[at] = value;
        }
        std::fs::write(&path, bytes).unwrap();
        if let Ok(source) = open(&[path], &OpenOptions::default()) {
            let info = source.info();
            let top = info.extent.z.min(4);
            let region = VoxelBox::new([0, 0, 0], [info.extent.x.min(64), info.extent.y.min(64), top]);
            let mut out = vec![0; region.extent().volume() as usize * info.voxel_type.bytes()];
            let _ = source.read_box(0, 0, region, &mut out);
        }
    }
}
