//! Dose grids, whose frames have distances in place of positions.

use super::tests::{Folder, Written, voxels};
use crate::error::ImportError;
use crate::open::open;
use crate::options::OpenOptions;
use crate::source::Source;
use dicom_core::VR;
use dicom_dictionary_std::{tags, uids};

/// A grid of two frames of 4 x 3 numbers, counting up.
fn grid(offsets: &str) -> Written {
    let mut grid = Written::slice(7.0, 0);
    grid.text(tags::MODALITY, VR::CS, "RTDOSE").text(tags::DOSE_UNITS, VR::CS, "GY");
    grid.text(tags::DOSE_GRID_SCALING, VR::DS, "0.5").text(tags::NUMBER_OF_FRAMES, VR::IS, "2");
    grid.text(tags::GRID_FRAME_OFFSET_VECTOR, VR::DS, offsets);
    grid.pixels(&(0..24).collect::<Vec<_>>());
    grid
}

fn opened(grid: &Written) -> Result<Box<dyn Source>, ImportError> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a");
    grid.save(&path, uids::EXPLICIT_VR_LITTLE_ENDIAN);
    open(&[path], &OpenOptions::default())
}

#[test]
fn frames_lie_along_the_normal_and_values_are_scaled() {
    let up: Vec<f64> = (0..24).map(|i| f64::from(i) / 2.0).collect();
    let down = [&up[12..], &up[..12]].concat();
    for (offsets, z, expected) in [("0\\3", 7.0, &up), ("0\\-3", 4.0, &down), ("7\\10", 7.0, &up), ("7\\4", 4.0, &down)]
    {
        let folder = Folder::of([grid(offsets)]);
        let source = folder.open().unwrap();
        let info = source.info();
        assert_eq!((info.extent.z, info.geometry.spacing.z), (2, 3.0), "{offsets}");
        assert_eq!(info.orientation.unwrap().first_centre().z, z, "{offsets}");
        assert_eq!(info.channel_looks[0].unit.as_deref(), Some("Gy"));
        assert_eq!(&voxels(&*source), expected, "{offsets}");
    }
}

#[test]
fn a_single_plane_is_scaled_too() {
    let mut plane = Written::slice(7.0, 4);
    plane.text(tags::MODALITY, VR::CS, "RTDOSE").text(tags::DOSE_GRID_SCALING, VR::DS, "0.25");
    let (_folder, source) = Folder::opened([plane]);
    assert_eq!(voxels(&*source), (4..16).map(|i| f64::from(i) / 4.0).collect::<Vec<_>>());
}

#[test]
fn places_and_scales_that_are_not_known_are_refused() {
    let refusal = |change: &dyn Fn(&mut Written)| {
        let mut grid = grid("0\\3");
        change(&mut grid);
        opened(&grid).err().unwrap().to_string()
    };
    let message = refusal(&|grid| {
        grid.0.remove_element(tags::DOSE_GRID_SCALING);
    });
    assert!(message.contains("DoseGridScaling is missing"), "{message}");
    let message = refusal(&|grid| {
        grid.text(tags::GRID_FRAME_OFFSET_VECTOR, VR::DS, "5\\8");
    });
    assert!(message.contains("begins with 5, expected 0, or 7"), "{message}");
    // Heights are no distances along another normal.
    let message = refusal(&|grid| {
        grid.text(tags::GRID_FRAME_OFFSET_VECTOR, VR::DS, "7\\10");
        grid.text(tags::IMAGE_ORIENTATION_PATIENT, VR::DS, "0\\1\\0\\0\\0\\-1");
    });
    assert!(message.contains("begins with 7, expected 0"), "{message}");
    for offsets in ["0", "0\\3\\6"] {
        let message = refusal(&|grid| {
            grid.text(tags::GRID_FRAME_OFFSET_VECTOR, VR::DS, offsets);
        });
        assert!(message.contains("2 frames without a place"), "{message}");
    }
}
