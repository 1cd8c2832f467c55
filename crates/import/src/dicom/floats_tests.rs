//! Floating-point pixels, in one piece and in frames with places of their own.

use super::tests::{Folder, Written, enhanced, voxels};
use crate::error::ImportError;
use crate::open::open;
use crate::options::{NoData, OpenOptions};
use crate::source::Source;
use crate::testing::said;
use brickyard_volume::VoxelType;
use dicom_core::{DataElement, PrimitiveValue, VR};
use dicom_dictionary_std::{tags, uids};

/// A slice of floats of either size.
fn slice(numbers: &[f64; 12], is_double: bool) -> Written {
    let mut slice = Written::slice(2.0, 0);
    let singles: Vec<f32> = numbers.iter().map(|number| *number as f32).collect();
    let (tag, bits, vr, value) = match is_double {
        true => (tags::DOUBLE_FLOAT_PIXEL_DATA, 64, VR::OD, PrimitiveValue::F64(numbers[..].into())),
        false => (tags::FLOAT_PIXEL_DATA, 32, VR::OF, PrimitiveValue::F32(singles.into())),
    };
    for tag in [tags::PIXEL_DATA, tags::BITS_STORED, tags::HIGH_BIT, tags::PIXEL_REPRESENTATION] {
        slice.0.remove_element(tag);
    }
    slice.number(tags::BITS_ALLOCATED, bits);
    slice.0.put(DataElement::new(tag, vr, value));
    slice
}

fn opened(written: &Written, options: &OpenOptions) -> Result<Box<dyn Source>, ImportError> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a");
    written.save(&path, uids::EXPLICIT_VR_LITTLE_ENDIAN);
    let source = open(&[path], options);
    // The source reads the file, which goes with its folder.
    std::mem::forget(folder);
    source
}

const NUMBERS: [f64; 12] = [0.0, -1.5, 1e30, 0.25, -2.0, 3.0, 4.0, 5.0, 6.5, 7.0, f64::NAN, f64::INFINITY];

#[test]
fn floats_of_both_sizes_are_values() {
    for is_double in [false, true] {
        let folder = Folder::of([slice(&NUMBERS.map(|number| f64::from(number as f32)), is_double)]);
        let source = folder.open().unwrap();
        assert_eq!(source.info().voxel_type, VoxelType::F32);
        for (found, number) in voxels(&*source).iter().zip(NUMBERS) {
            assert!(*found == f64::from(number as f32) || found.is_nan() && number.is_nan(), "{found} {number}");
        }
    }
    let mut map = enhanced();
    map.0.remove_element(tags::PIXEL_DATA);
    map.number(tags::BITS_ALLOCATED, 32);
    let numbers: Vec<f32> = (0..24).map(|i| i as f32 / 4.0).collect();
    map.0.put(DataElement::new(tags::FLOAT_PIXEL_DATA, VR::OF, PrimitiveValue::F32(numbers.into())));
    // Its frames are scaled, which floats are not.
    let message = opened(&map, &OpenOptions::default()).err().unwrap().to_string();
    assert!(message.contains("floating-point pixels scaled once more"), "{message}");
}

#[test]
fn losses_of_64_bits_are_told_or_refused() {
    let mut numbers = NUMBERS;
    (numbers[0], numbers[2]) = (0.1, 1e300);
    let message = opened(&slice(&numbers, true), &OpenOptions::default()).err().unwrap().to_string();
    assert!(message.contains("`allow_lossy`"), "{message}");
    let source = opened(&slice(&numbers, true), &OpenOptions { allow_lossy: true, ..OpenOptions::default() }).unwrap();
    assert!(said(&source.info().notes).contains("1 infinite, 1 rounded"), "{}", said(&source.info().notes));
    let mut padded = slice(&numbers, true);
    for (tag, value) in [(tags::DOUBLE_FLOAT_PIXEL_PADDING_VALUE, 1e300), (tags::FLOAT_PIXEL_PADDING_VALUE, 3.0)] {
        padded.0.put(DataElement::new(tag, VR::FD, PrimitiveValue::from(value)));
    }
    padded.0.put(DataElement::new(tags::FLOAT_PIXEL_PADDING_VALUE, VR::FL, PrimitiveValue::from(3.0f32)));
    let source = opened(&padded, &OpenOptions { allow_lossy: true, ..OpenOptions::default() }).unwrap();
    let found = voxels(&*source);
    assert!(found[2].is_nan() && found[5] == 3.0 && found[0] == f64::from(0.1f32), "{found:?}");
    assert!(said(&source.info().notes).contains("1 rounded"), "{}", said(&source.info().notes));
}

#[test]
fn padding_becomes_nan_unless_it_is_meant() {
    let mut padded = slice(&NUMBERS, false);
    padded.0.put(DataElement::new(tags::FLOAT_PIXEL_PADDING_VALUE, VR::FL, PrimitiveValue::from(3.0f32)));
    padded.0.put(DataElement::new(tags::FLOAT_PIXEL_PADDING_RANGE_LIMIT, VR::FL, PrimitiveValue::from(5.0f32)));
    let source = opened(&padded, &OpenOptions::default()).unwrap();
    let marked: Vec<usize> = (0..10).filter(|i| voxels(&*source)[*i].is_nan()).collect();
    assert_eq!(marked, [5, 6, 7]);
    assert!(said(&source.info().notes).contains("Values from 3 to 5 are padding"), "{}", said(&source.info().notes));
    let kept = opened(&padded, &OpenOptions { nodata: NoData::None, ..OpenOptions::default() }).unwrap();
    assert_eq!(voxels(&*kept)[5..8], [3.0, 4.0, 5.0]);
    assert_ne!(kept.info().identity, source.info().identity);
}

#[test]
fn floats_of_another_size_are_refused() {
    let mut odd = slice(&NUMBERS, false);
    odd.number(tags::BITS_ALLOCATED, 64);
    let message = opened(&odd, &OpenOptions::default()).err().unwrap().to_string();
    assert!(message.contains("BitsAllocated is 64, but its pixels are floats of 32 bits"), "{message}");
}
