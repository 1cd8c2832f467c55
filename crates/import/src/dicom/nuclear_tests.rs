//! Reconstructed volumes of nuclear medicine, whose frames have numbers in place of positions.

use super::tests::{Folder, Written, voxels};
use dicom_core::{DataElement, PrimitiveValue, Tag, VR};
use dicom_dictionary_std::{tags, uids};
use dicom_object::InMemDicomObject;
use glam::DVec3;

/// Frames of 4 x 3 numbers, counting up, of these numbers of slices.
fn spect(slices: &[u16], spacing: &str) -> Written {
    let mut file = Written::slice(0.0, 0);
    for tag in [tags::IMAGE_POSITION_PATIENT, tags::IMAGE_ORIENTATION_PATIENT] {
        file.0.remove_element(tag);
    }
    let mut detector = Written(InMemDicomObject::new_empty());
    detector.text(tags::IMAGE_POSITION_PATIENT, VR::DS, "1\\2\\30");
    detector.text(tags::IMAGE_ORIENTATION_PATIENT, VR::DS, "1\\0\\0\\0\\1\\0");
    file.sequence(tags::DETECTOR_INFORMATION_SEQUENCE, vec![detector.0]);
    file.text(tags::SOP_CLASS_UID, VR::UI, uids::NUCLEAR_MEDICINE_IMAGE_STORAGE);
    file.text(tags::IMAGE_TYPE, VR::CS, "ORIGINAL\\PRIMARY\\RECON TOMO\\EMISSION");
    file.text(tags::SPACING_BETWEEN_SLICES, VR::DS, spacing);
    file.text(tags::NUMBER_OF_FRAMES, VR::IS, &slices.len().to_string());
    numbers(&mut file, tags::SLICE_VECTOR, slices);
    file.pixels(&(0..12 * slices.len() as u16).collect::<Vec<_>>());
    file
}

fn numbers(file: &mut Written, tag: Tag, numbers: &[u16]) {
    file.0.put(DataElement::new(tag, VR::US, PrimitiveValue::U16(numbers.into())));
}

#[test]
fn slices_lie_behind_or_before_the_detectors_place() {
    let frames: Vec<f64> = (0..36).map(f64::from).collect();
    let turned = [&frames[24..], &frames[12..24], &frames[..12]].concat();
    let swapped = [&frames[12..24], &frames[..12], &frames[24..]].concat();
    for (slices, spacing, z, expected) in [
        ([1, 2, 3], "4.5", 30.0, &frames),
        ([1, 2, 3], "-4.5", 21.0, &turned),
        ([2, 1, 3], "4.5", 30.0, &swapped),
        ([3, 2, 1], "4.5", 30.0, &turned),
    ] {
        let (_folder, source) = Folder::opened([spect(&slices, spacing)]);
        let info = source.info();
        assert_eq!(info.geometry.spacing, DVec3::new(0.5, 0.75, 4.5));
        // The patient's left and back are NIfTI's right and front.
        assert_eq!(info.orientation.unwrap().first_centre(), DVec3::new(-1.0, -2.0, z), "{slices:?} {spacing}");
        assert_eq!(&voxels(&*source), expected, "{slices:?} {spacing}");
    }
}

#[test]
fn frames_that_are_no_slices_are_refused_with_the_reason() {
    let refused = |change: &dyn Fn(&mut Written), words: &str| {
        let mut file = spect(&[1, 2, 3], "4.5");
        change(&mut file);
        Folder::of([file]).refused(&[words]);
    };
    refused(
        &|file| _ = file.text(tags::IMAGE_TYPE, VR::CS, "ORIGINAL\\PRIMARY\\TOMO\\EMISSION"),
        "ImageType is 'TOMO'",
    );
    refused(&|file| numbers(file, tags::TIME_SLOT_VECTOR, &[1, 2, 2]), "differ in TimeSlotVector");
    refused(&|file| numbers(file, tags::SLICE_VECTOR, &[1, 2]), "of which 2 have a number in SliceVector");
    refused(&|file| numbers(file, tags::SLICE_VECTOR, &[0, 1, 2]), "none from 1 on");
    refused(&|file| _ = file.text(tags::SPACING_BETWEEN_SLICES, VR::DS, "0"), "SpacingBetweenSlices is missing or 0");
    // Two detectors have two places.
    refused(
        &|file| {
            let detector = || InMemDicomObject::new_empty();
            file.sequence(tags::DETECTOR_INFORMATION_SEQUENCE, vec![detector(), detector()]);
        },
        "ImagePositionPatient",
    );
}
