//! Independent programs read our files, and we read theirs: zarr-python, tensorstore, nibabel, tifffile, Pillow,
//! pydicom, SimpleITK, numpy.
//!
//! Scripts in `tests/python` do the work, one process for many cases, since Python takes seconds to start.

use brickyard_tests::Sandbox;

#[test]
fn stores_are_read_by_zarr_python_and_tensorstore_bit_for_bit() {
    Sandbox::default().python("read_stores.py");
}

#[test]
fn channels_are_shown_in_their_own_colours_windows_and_names() {
    Sandbox::default().python("channels.py");
}

#[test]
fn labels_in_an_image_are_found_by_zarr_python() {
    Sandbox::default().python("image_labels.py");
}

#[test]
fn stores_of_ome_zarr_0_6_are_valid_and_read_by_zarr_python() {
    Sandbox::default().python("ngff_stores.py");
}

#[test]
fn stores_that_zarr_python_wrote_into_are_indexed_as_packed_ones() {
    Sandbox::default().python("written_stores.py");
}

#[test]
fn slices_of_scans_in_any_orientation_are_those_that_simpleitk_resamples() {
    Sandbox::default().python("orientation.py");
}

#[test]
fn files_of_nibabel_tifffile_pillow_pydicom_and_numpy_are_packed_bit_for_bit() {
    Sandbox::default().python("import_files.py");
}

#[test]
fn tiff_files_are_what_they_say_of_themselves() {
    Sandbox::default().python("tiff_descriptions.py");
}

#[test]
fn exports_are_what_nibabel_simpleitk_tifffile_and_pillow_read() {
    Sandbox::default().python("export_files.py");
}

#[test]
fn zarr_of_zarr_python_is_drawn_and_exported_where_it_lies() {
    Sandbox::default().python("foreign_zarr.py");
}
