//! Missing slices left blank.

use super::tests::{Folder, Written, at_texts, open_with, shuffled, voxels};
use crate::options::{Gaps, HeldAs, NoData, OpenOptions};
use crate::testing::{is_warned, said};
use brickyard_volume::VoxelType;
use dicom_core::VR;
use dicom_dictionary_std::tags;
use glam::DVec3;

#[test]
fn the_places_of_missing_slices_are_left_and_hold_no_data() {
    let blank = OpenOptions { gaps: Gaps::Blank, ..OpenOptions::default() };
    // Several gaps, one of two slices, in shuffled files.
    let slices = |change: &dyn Fn(&mut Written) -> &mut Written| {
        Folder::of([3u16, 0, 6, 1, 8].map(|k| {
            let mut slice = Written::slice(20.0 + 2.5 * f64::from(k), 100 * k);
            change(&mut slice);
            slice
        }))
    };
    let check = |folder: &Folder, voxel_type: VoxelType, value: &dyn Fn(f64) -> f64, nothing: f64| {
        let source = open_with(folder, &blank).unwrap();
        let info = source.info();
        assert_eq!((info.extent.to_array(), info.voxel_type), ([4, 3, 9], voxel_type));
        assert!((info.geometry.spacing - DVec3::new(0.5, 0.75, 2.5)).length() < 1e-12);
        assert_eq!(info.orientation.unwrap().rows()[2][3], 20.0);
        assert_eq!(info.nodata, (!nothing.is_nan()).then_some(nothing));
        for (i, found) in voxels(&*source).into_iter().enumerate() {
            let (z, pixel) = (i / 12, i % 12);
            let is_there = [0, 1, 3, 6, 8].contains(&z);
            let expected = if is_there { value((100 * z + pixel) as f64) } else { nothing };
            assert!(found == expected || found.is_nan() && expected.is_nan(), "z {z}: {found}, expected {expected}");
        }
        let notes = said(&info.notes);
        assert!(notes.contains("4 slices of 9 are missing"), "{notes}");
        assert!(is_warned(&notes, "4 slices of 9 are missing"), "{notes}");
    };
    // 12 bits, and an unused value; shifted; all 16 bits, few of them used; padding has its own; fractions have NaN.
    check(&slices(&|s| s), VoxelType::I16, &|n| n, -1.0);
    let shifted = slices(&|s| s.text(tags::RESCALE_SLOPE, VR::DS, "1").text(tags::RESCALE_INTERCEPT, VR::DS, "-1024"));
    check(&shifted, VoxelType::I16, &|n| n - 1024.0, -1025.0);
    let wide = slices(&|s| s.number(tags::BITS_STORED, 16).number(tags::HIGH_BIT, 15));
    check(&wide, VoxelType::I16, &|n| n, -1.0);
    let padded = slices(&|s| s.number(tags::PIXEL_PADDING_VALUE, 4095));
    check(&padded, VoxelType::U16, &|n| n, 4095.0);
    let scaled = slices(&|s| s.text(tags::RESCALE_SLOPE, VR::DS, "0.5").text(tags::RESCALE_INTERCEPT, VR::DS, "0"));
    check(&scaled, VoxelType::F32, &|n| 0.5 * n, f64::NAN);
    // A series without gaps is unchanged.
    let whole = open_with(&Folder::of(shuffled()), &blank);
    assert!(whole.is_ok_and(|source| source.info().nodata.is_none() && source.info().voxel_type == VoxelType::U16));
    // Rounded positions: steps of 7.04 mm to one decimal, the third and fourth missing.
    let source = open_with(&at_texts(&["0", "7.0", "14.1", "35.2", "42.2"]), &blank).unwrap();
    assert_eq!(source.info().extent.z, 7);
    // Distances that are no gap; more missing than present; two slices in one place; a no-data value that missing slices would not have.
    let refused = |folder: Folder, options: &OpenOptions, words: &[&str]| {
        let message = open_with(&folder, options).err().unwrap().to_string();
        words.iter().for_each(|word| assert!(message.contains(word), "{word}: {message}"));
    };
    let at = |z: f64| Written::slice(z, 0);
    refused(Folder::of([0.0, 2.0, 4.0, 9.0].map(at)), &blank, &["not evenly spaced", "found 5.0000"]);
    refused(Folder::of([0.0, 2.0, 4.0, 2e9].map(at)), &blank, &["missing between them", "an evenly spaced part"]);
    refused(Folder::of([0.0, 2.0, 2.0, 6.0].map(at)), &blank, &["has the position of"]);
    refused(slices(&|s| s), &OpenOptions { nodata: NoData::None, ..blank.clone() }, &["`nodata` with `gaps`"]);
}

/// Later steps, whose blanks and types depend on their data, use the encoding of the first, unless a voxel has its blank.
#[test]
fn later_steps_are_held_as_those_before() {
    let folder = |least: u16| {
        Folder::of([3u16, 0, 1, 6].map(|k| {
            let mut slice = Written::slice(20.0 + 2.5 * f64::from(k), least + 100 * k);
            slice.number(tags::BITS_STORED, 16).number(tags::HIGH_BIT, 15);
            slice.text(tags::RESCALE_SLOPE, VR::DS, "1").text(tags::RESCALE_INTERCEPT, VR::DS, "-1024");
            slice
        }))
    };
    let held_as = |least, nodata| {
        let held_as = Some(HeldAs { voxel_type: VoxelType::I16, nodata, turned: [false; 3] });
        let options = OpenOptions { gaps: Gaps::Blank, held_as, ..OpenOptions::default() };
        let source = open_with(&folder(least), &options).unwrap();
        (source.info().voxel_type, source.info().nodata)
    };
    assert_eq!(held_as(14, None), (VoxelType::I16, Some(-1011.0)), "its own");
    assert_eq!(held_as(14, Some(-1025.0)), (VoxelType::I16, Some(-1025.0)));
    // This value occurs here.
    assert_eq!(held_as(14, Some(-1010.0)), (VoxelType::I16, Some(-1011.0)));
}

/// Each step of a store has a title of its own: only the first one's is the channel's name.
#[test]
fn later_steps_have_titles_and_no_names() {
    let mut slice = Written::slice(0.0, 0);
    slice.text(tags::SERIES_DESCRIPTION, VR::LO, "arterial");
    let folder = Folder::of([slice]);
    let held_as = Some(HeldAs { voxel_type: VoxelType::U16, nodata: None, turned: [false; 3] });
    for (held_as, name) in [(None, Some("arterial")), (held_as, None)] {
        let source = open_with(&folder, &OpenOptions { held_as, ..OpenOptions::default() }).unwrap();
        assert_eq!(source.info().channel_looks[0].name.as_deref(), name);
    }
}
