//! Elements of unknown representation (UN), and damaged files beside a series.

use super::tests::{Folder, Written, enhanced, shuffled, voxels};
use crate::open::open;
use crate::options::OpenOptions;
use crate::testing::{is_warned, said};
use brickyard_volume::VoxelType;
use dicom_core::{DataElement, PrimitiveValue, Tag, VR};
use dicom_dictionary_std::{tags, uids};
use glam::DVec3;

/// Replaces an element with one of unknown representation, with the same bytes.
fn forget(written: &mut Written, tag: Tag) {
    let known = written.0.take_element(tag).unwrap();
    let bytes = match known.value().primitive().unwrap() {
        PrimitiveValue::U16(numbers) => numbers.iter().flat_map(|number| number.to_le_bytes()).collect(),
        text => {
            let mut bytes = text.to_str().into_owned().into_bytes();
            bytes.resize(bytes.len().next_multiple_of(2), b' ');
            bytes
        }
    };
    written.0.put(DataElement::new(tag, VR::UN, PrimitiveValue::from(bytes)));
}

#[test]
fn elements_of_unknown_representation_mean_what_the_standard_says() {
    let slice = |z_mm, first| {
        let mut slice = Written::slice(z_mm, first);
        slice.text(tags::RESCALE_SLOPE, VR::DS, "2").text(tags::RESCALE_INTERCEPT, VR::DS, "-1024");
        slice.number(tags::PIXEL_PADDING_VALUE, 105);
        slice
    };
    let (_folder, known) = Folder::opened([slice(0.0, 0), slice(2.5, 100)]);
    let expected = voxels(&*known);
    assert_eq!((known.info().voxel_type, expected[1], expected[23]), (VoxelType::I16, -1022.0, -802.0));
    // One by one: a number read from a text's first byte would be no error.
    let tags: Vec<Tag> = slice(0.0, 0).0.iter().map(|element| element.header().tag).collect();
    for tag in tags.into_iter().filter(|tag| *tag != tags::PIXEL_DATA) {
        let unknown = [slice(0.0, 0), slice(2.5, 100)].map(|mut slice| {
            forget(&mut slice, tag);
            slice
        });
        let (_folder, source) = Folder::opened(unknown);
        assert_eq!(voxels(&*source), expected, "{tag}");
        assert_eq!(source.info().geometry.spacing, DVec3::new(0.5, 0.75, 2.5), "{tag}");
        assert_eq!((source.info().orientation, source.info().nodata), (known.info().orientation, Some(-814.0)));
    }
}

/// Replaces a sequence with one of unknown representation: an item without elements, with and without
/// its length.
fn forget_items(folder: &Folder, tag: Tag) {
    let bytes = std::fs::read(folder.file(0)).unwrap();
    let head = [tag.0.to_le_bytes(), tag.1.to_le_bytes()].concat();
    let at = bytes.windows(6).position(|w| w == [&head, &b"UN"[..]].concat()).unwrap();
    let item = [0xfe, 0xff, 0x00, 0xe0, 0, 0, 0, 0];
    let end = [0xfe, 0xff, 0xdd, 0xe0, 0, 0, 0, 0];
    for (length, content) in [(8u32, item.to_vec()), (u32::MAX, [item, end].concat())] {
        let changed = [&bytes[..at + 8], &length.to_le_bytes(), &content, &bytes[at + 16..]].concat();
        std::fs::write(folder.file(0), changed).unwrap();
        folder.refused(&[
            if tag == tags::MODALITY_LUT_SEQUENCE { "ModalityLUTSequence" } else { "(UN)" },
            "is not supported",
        ]);
    }
}

#[test]
fn sequences_of_unknown_representation_that_a_value_needs_are_refused() {
    let unknown = |tag| DataElement::new(tag, VR::UN, PrimitiveValue::from(vec![b'?'; 4]));
    let mut slice = Written::slice(0.0, 0);
    slice.0.put(unknown(tags::MODALITY_LUT_SEQUENCE));
    forget_items(&Folder::of([slice]), tags::MODALITY_LUT_SEQUENCE);
    for tag in [tags::SHARED_FUNCTIONAL_GROUPS_SEQUENCE, tags::PER_FRAME_FUNCTIONAL_GROUPS_SEQUENCE] {
        let mut file = enhanced();
        file.0.put(unknown(tag));
        forget_items(&Folder::of([file]), tag);
    }
    // If only one of a frame's own is unknown, its values would stay as stored.
    let mut file = enhanced();
    file.0.update_value(tags::PER_FRAME_FUNCTIONAL_GROUPS_SEQUENCE, |frames| {
        for frame in frames.items_mut().unwrap() {
            frame.put(unknown(tags::PIXEL_VALUE_TRANSFORMATION_SEQUENCE));
        }
    });
    Folder::of([file]).refused(&["(UN)", "(0028,9145)", "dcmconv +uc"]);
}

#[test]
fn damaged_files_beside_one_file_matter_only_where_they_may_be_of_its_series() {
    let folder = Folder::of(shuffled());
    let damaged = |series: &str| {
        let mut other = Written::slice(32.5, 500);
        other.text(tags::SERIES_INSTANCE_UID, VR::UI, series);
        other.save(&folder.file(9), uids::EXPLICIT_VR_LITTLE_ENDIAN);
        let bytes = std::fs::read(folder.file(9)).unwrap();
        // Within the value of (0028,0010), behind the series' UID.
        let rows = bytes.windows(6).position(|w| w == b"\x28\0\x10\0US").unwrap();
        std::fs::write(folder.file(9), &bytes[..rows + 9]).unwrap();
        open(&[folder.file(2)], &OpenOptions::default())
    };
    let source = damaged("1.5.3").unwrap();
    assert_eq!(source.info().extent.z, 5);
    let notes = said(&source.info().notes);
    assert!(notes.contains("1 DICOM file beside it") && notes.contains("IM9: cut short"), "{notes}");
    assert!(is_warned(&notes, "1 DICOM file beside it"), "{notes}");
    let message = damaged("1.2.3").err().unwrap().to_string();
    assert!(message.contains("IM9: cut short"), "{message}");
    // A folder is taken as it is.
    assert!(damaged("1.5.3").is_ok());
    folder.refused(&["IM9: cut short"]);
}
