//! Mosaics, with the scanner's own header whole, missing and damaged.

use super::tests::{Folder, Written, voxels};
use crate::open::open;
use crate::options::OpenOptions;
use crate::testing::{some_damage, spoil, try_to_read};
use brickyard_volume::{VoxelBox, VoxelType};
use dicom_core::{DataElement, PrimitiveValue, Tag, VR};
use dicom_dictionary_std::{tags, uids};
use glam::DVec3;
use proptest::prelude::*;

/// Siemens' own header, with these elements among others.
fn csa(elements: &[(&str, &[&str])]) -> Vec<u8> {
    let others: [(&str, &[&str]); 2] = [("EchoLinePosition", &["32", "", ""]), ("Comment", &["odd"])];
    let all: Vec<_> = others[..1].iter().chain(elements).chain(&others[1..]).collect();
    let mut bytes = b"SV10\x04\x03\x02\x01".to_vec();
    let number = |bytes: &mut Vec<u8>, n: usize| bytes.extend((n as u32).to_le_bytes());
    number(&mut bytes, all.len());
    number(&mut bytes, 77);
    for (name, values) in all {
        let mut padded = name.as_bytes().to_vec();
        padded.resize(64, 0);
        bytes.extend(padded);
        number(&mut bytes, values.iter().filter(|value| !value.is_empty()).count());
        bytes.extend(b"DS\0\0");
        [0, values.len() + 1, 77].into_iter().for_each(|n| number(&mut bytes, n));
        for value in values.iter().chain(&[""]) {
            let mut text = value.as_bytes().to_vec();
            text.extend(if value.is_empty() { &b""[..] } else { b"   \0" });
            [text.len(), text.len(), 77, 77].into_iter().for_each(|n| number(&mut bytes, n));
            bytes.extend(&text);
            bytes.resize(bytes.len().next_multiple_of(4), 0);
        }
    }
    bytes
}

/// A mosaic of seven slices of 4 x 3 pixels in 3 x 3 places. Pixel `i` of slice `k` is `100 k + i`.
fn mosaic(header: Option<Vec<u8>>) -> Written {
    let mut written = Written::slice(0.0, 0);
    let pixels: Vec<u16> = (0..9 * 12)
        .map(|i| {
            let [x, y] = [i % 12, i / 12];
            let slice = y / 3 * 3 + x / 4;
            if slice < 7 { 100 * slice + y % 3 * 4 + x % 4 } else { 0 }
        })
        .collect();
    written.number(tags::ROWS, 9).number(tags::COLUMNS, 12).pixels(&pixels);
    written.text(tags::IMAGE_TYPE, VR::CS, "ORIGINAL\\PRIMARY\\M\\ND\\MOSAIC");
    written.text(tags::SPACING_BETWEEN_SLICES, VR::DS, "2.5");
    written.text(Tag(0x0019, 0x0010), VR::LO, "SIEMENS MR HEADER").number(Tag(0x0019, 0x100a), 7);
    if let Some(header) = header {
        written.text(Tag(0x0029, 0x0011), VR::LO, "SIEMENS CSA HEADER");
        written.0.put(DataElement::new(Tag(0x0029, 0x1110), VR::OB, PrimitiveValue::U8(header.into())));
    }
    written
}

#[test]
fn a_mosaic_is_taken_apart_into_its_slices() {
    let with_normal = |z: &str| csa(&[("NumberOfImagesInMosaic", &["7"]), ("SliceNormalVector", &["0.0", "0.0", z])]);
    let expected: Vec<f64> = (0..7).flat_map(|k| (0..12).map(move |i| f64::from(100 * k + i))).collect();
    for syntax in [uids::EXPLICIT_VR_LITTLE_ENDIAN, uids::IMPLICIT_VR_LITTLE_ENDIAN] {
        let folder = Folder(tempfile::tempdir().unwrap());
        mosaic(Some(with_normal("1.00000000"))).save(&folder.file(0), syntax);
        // Alone, even beside others of its series: those are other steps.
        mosaic(Some(with_normal("1.00000000"))).save(&folder.file(1), syntax);
        let source = open(&[folder.file(0)], &OpenOptions::default()).unwrap();
        let info = source.info();
        assert_eq!(info.extent.to_array(), [4, 3, 7]);
        assert_eq!(info.geometry.spacing, DVec3::new(0.5, 0.75, 2.5));
        assert_eq!(voxels(&*source), expected);
        // nibabel: the named place, -100, -50, is for a slice of 12 x 9 pixels: half of 8 x 6 pixels further in is 2 and 2.25 mm.
        let rows = [[-0.5, 0.0, 0.0, 98.0], [0.0, -0.75, 0.0, 47.75], [0.0, 0.0, 2.5, 0.0]];
        assert_eq!(info.orientation.unwrap().rows(), rows);
        assert!(info.notes.iter().any(|note| note.contains("7 slices side by side")), "{:?}", info.notes);
        folder.refused(&["has the position of", "14 slices at 7 positions", "one time step"]);
    }
    // Slices against the normal of rows and columns: the last one is lowest.
    let (_folder, source) = Folder::opened([mosaic(Some(with_normal("-1.0")))]);
    let down: Vec<f64> = expected.chunks(12).rev().flatten().copied().collect();
    assert_eq!(voxels(&*source), down);
    assert_eq!(source.info().orientation.unwrap().rows()[2], [0.0, 0.0, 2.5, -15.0]);
    // A box of two slices across a row of places.
    let (_folder, source) = Folder::opened([mosaic(Some(with_normal("1.0")))]);
    let mut out = vec![0; 2 * 2 * 2];
    source.read_box(0, 0, VoxelBox::new([1, 2, 2], [3, 3, 4]), &mut out).unwrap();
    let found: Vec<f64> = (0..4).map(|i| VoxelType::U16.read(&out, i)).collect();
    assert_eq!(found, [209.0, 210.0, 309.0, 310.0]);
}

#[test]
fn a_mosaic_whose_header_is_not_enough_is_refused_by_name() {
    let normal: (&str, &[&str]) = ("SliceNormalVector", &["0", "0", "1"]);
    for (header, word) in [
        (None, "without the scanner's own header (CSA) is not"),
        (Some(csa(&[("NumberOfImagesInMosaic", &["7"])])), "without a direction of slices"),
        (Some(csa(&[normal])), "without a number of slices"),
        (Some(csa(&[("NumberOfImagesInMosaic", &["0"]), normal])), "without a number of slices"),
        (Some(b"SV10".to_vec()), "without a number of slices"),
        (Some(csa(&[("NumberOfImagesInMosaic", &["7"]), normal])[..250].to_vec()), "without a number of slices"),
    ] {
        Folder::of([mosaic(header)]).refused(&["a mosaic", word, "dcm2niix"]);
    }
    let refused = |count: &str, vector: &[&str], words: &[&str]| {
        let header = csa(&[("NumberOfImagesInMosaic", &[count]), ("SliceNormalVector", vector)]);
        Folder::of([mosaic(Some(header))]).refused(words);
    };
    refused("8", &["0", "0", "1"], &["8 slices by one element, and of 7 by another"]);
    refused("7", &["0", "1", "0"], &["not perpendicular"]);
    refused("7", &["0", "0", "0"], &["not perpendicular"]);
    let mut odd = mosaic(Some(csa(&[("NumberOfImagesInMosaic", &["7"]), normal])));
    odd.number(tags::COLUMNS, 11).number(tags::ROWS, 9);
    Folder::of([odd]).refused(&["3 x 3 tiles", "11 x 9 pixels do not divide"]);
    let mut thin = mosaic(Some(csa(&[("NumberOfImagesInMosaic", &["7"]), normal])));
    thin.0.remove_element(tags::SPACING_BETWEEN_SLICES);
    Folder::of([thin]).refused(&["SpacingBetweenSlices", "`spacing`"]);
}

proptest! {
    #![proptest_config(crate::testing::cases(200))]

    /// Damage of the scanner's own header leads to an error or other slices, never to a panic.
    #[test]
    fn damaged_mosaics_do_not_panic(damage in some_damage(), own in some_damage()) {
        let mut header = csa(&[("NumberOfImagesInMosaic", &["7"]), ("SliceNormalVector", &["0.0", "0.0", "1.0"])]);
        spoil(&mut header, &own);
        let folder = Folder::of([mosaic(Some(header))]);
        try_to_read(&[folder.file(0)]);
        let mut bytes = std::fs::read(folder.file(0)).unwrap();
        spoil(&mut bytes[132..], &damage);
        std::fs::write(folder.file(0), bytes).unwrap();
        try_to_read(&[folder.file(0)]);
    }
}
