//! Time steps in all layouts: one file each, in lists, folders and patterns, or all in one file of three to five dimensions.

use crate::open::{open, order_steps};
use crate::options::{FileOrder, OpenOptions};
use crate::testing::{Field, assert_boxes, said};
use brickyard_volume::{Extent, VoxelType};
use std::path::{Path, PathBuf};

const FIELD: Field = Field { sizes: [7, 5, 4, 1, 3], voxel_type: VoxelType::U16 };

/// A `.npy` file of an array of u16.
fn npy(shape: &str, bytes: &[u8]) -> Vec<u8> {
    let header = format!("{{'descr': '<u2', 'fortran_order': False, 'shape': {shape}, }}");
    [b"\x93NUMPY\x01\x00", &(header.len() as u16).to_le_bytes()[..], header.as_bytes(), bytes].concat()
}

/// A NIfTI file of an array of u16, with these sizes and a spacing along x.
fn nifti(sizes: &[u16], spacing: f32, bytes: &[u8]) -> Vec<u8> {
    let mut header = vec![0; 352];
    header[..4].copy_from_slice(&348i32.to_le_bytes());
    header[40..42].copy_from_slice(&(sizes.len() as u16).to_le_bytes());
    sizes.iter().enumerate().for_each(|(i, size)| header[42 + 2 * i..][..2].copy_from_slice(&size.to_le_bytes()));
    header[70..74].copy_from_slice(&[0, 2, 16, 0]);
    [1.0, spacing, 1.0, 1.0]
        .iter()
        .enumerate()
        .for_each(|(i, p)| header[76 + 4 * i..][..4].copy_from_slice(&f32::to_le_bytes(*p)));
    header[344..348].copy_from_slice(b"n+1\0");
    [header, bytes.to_vec()].concat()
}

/// Writes the field's steps to a folder, a file each, in a format made by `file`.
fn steps_in(names: &[&str], file: impl Fn(&[u8]) -> Vec<u8>) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let bytes = FIELD.bytes("tczyx", false);
    for (name, step) in names.iter().zip(bytes.chunks(bytes.len() / 3)) {
        std::fs::write(folder.path().join(name), file(step)).unwrap();
    }
    folder
}

fn refusal(inputs: &[PathBuf], options: &OpenOptions) -> String {
    open(inputs, options).err().unwrap().to_string()
}

fn told() -> OpenOptions {
    OpenOptions { shape: Some(Extent::new(7, 5, 4)), voxel_type: Some(VoxelType::U16.into()), ..OpenOptions::default() }
}

#[test]
fn a_file_for_each_step_by_list_folder_and_pattern() {
    let none = OpenOptions::default();
    let raw = |step: &[u8]| step.to_vec();
    let of_npy = |step: &[u8]| npy("(4, 5, 7)", step);
    let of_nifti = |step: &[u8]| nifti(&[7, 5, 4], 1.0, step);
    let check = |folder: &Path, extension: &str, options: &OpenOptions| {
        let names = ["s_08", "s_09", "s_10"].map(|name| folder.join(format!("{name}.{extension}")));
        let patterns = ["s_*.E", "s_??.E", "*", "s_%02d.E"].map(|pattern| folder.join(pattern.replace('E', extension)));
        for inputs in [&names[..], &[folder.to_owned()]].into_iter().chain(patterns.iter().map(std::slice::from_ref)) {
            let source = open(inputs, options).unwrap_or_else(|error| panic!("{error}"));
            assert_boxes(&*source, FIELD);
            assert!(
                source.info().notes.iter().any(|note| note.contains("3 files in natural order, from s_08")),
                "{inputs:?}"
            );
        }
    };
    let names = |extension: &str| ["s_08", "s_09", "s_10"].map(|name| format!("{name}.{extension}"));
    for (extension, options, file) in
        [("raw", &told(), &raw as &dyn Fn(&[u8]) -> Vec<u8>), ("npy", &none, &of_npy), ("nii", &none, &of_nifti)]
    {
        let names = names(extension);
        let folder = steps_in(&names.each_ref().map(|name| &**name), file);
        check(folder.path(), extension, options);
    }
}

#[test]
fn all_steps_in_one_file_of_any_dimensions() {
    let (folder, none) = (tempfile::tempdir().unwrap(), OpenOptions::default());
    let check = |name: &str, bytes: Vec<u8>, options: &OpenOptions, field: Field| {
        let path = folder.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        assert_boxes(&*open(&[path], options).unwrap_or_else(|error| panic!("{name}: {error}")), field);
    };
    let axes = |axes: &str| OpenOptions { axes: Some(axes.parse().unwrap()), ..none.clone() };
    let of_five = Field { sizes: [7, 5, 4, 2, 3], ..FIELD };
    let flat = Field { sizes: [7, 5, 1, 1, 3], ..FIELD };
    check("4.npy", npy("(3, 4, 5, 7)", &FIELD.bytes("tzyx", false)), &axes("tzyx"), FIELD);
    check("5.npy", npy("(3, 2, 4, 5, 7)", &of_five.bytes("tczyx", false)), &axes("tczyx"), of_five);
    check("3.npy", npy("(3, 5, 7)", &flat.bytes("tyx", false)), &axes("tyx"), flat);
    check("4.nii", nifti(&[7, 5, 4, 3], 1.0, &FIELD.bytes("tzyx", false)), &none, FIELD);
    check("5.nii", nifti(&[7, 5, 4, 3, 2], 1.0, &of_five.bytes("ctzyx", false)), &none, of_five);
    check("3.nii", nifti(&[7, 5, 1, 3], 1.0, &flat.bytes("tyx", false)), &none, flat);
    let raw = |field: Field| {
        let [x, y, z, channels, times] = field.sizes;
        OpenOptions { shape: Some(Extent::new(x, y, z)), channels: Some(channels), times: Some(times), ..told() }
    };
    check("4.raw", FIELD.bytes("tzyx", false), &raw(FIELD), FIELD);
    check("5.raw", of_five.bytes("tczyx", false), &raw(of_five), of_five);
    check("3.raw", flat.bytes("tyx", false), &OpenOptions { axes: axes("tyx").axes, ..raw(flat) }, flat);
}

#[test]
fn a_missing_a_doubled_and_an_unlike_step_are_named() {
    let none = OpenOptions::default();
    let of_npy = |step: &[u8]| npy("(4, 5, 7)", step);
    let gap = steps_in(&["s_1.npy", "s_2.npy", "s_4.npy"], of_npy);
    for name in ["s_*.npy", "s_%d.npy"] {
        let message = refusal(&[gap.path().join(name)], &none);
        assert!(message.contains("without 3"), "{message}");
        let natural = OpenOptions { order: Some(FileOrder::Natural), ..none.clone() };
        assert_eq!(open(&[gap.path().join(name)], &natural).unwrap().info().times, 3);
    }
    assert!(refusal(&[gap.path().to_owned()], &none).contains("without 3"));
    let twice = steps_in(&["s_1.npy", "s_01.npy", "s_2.npy"], of_npy);
    let message = refusal(&[twice.path().join("s_*.npy")], &none);
    assert!(message.contains("s_01.npy and s_1.npy have the same number"), "{message}");
    let [one, two] = ["s_1.npy", "s_2.npy"].map(|name| twice.path().join(name));
    let message = refusal(&[one.clone(), two.clone(), one.clone()], &none);
    assert!(message.contains("s_1.npy: is named twice"), "{message}");
    let given = OpenOptions { order: Some(FileOrder::Given), ..none.clone() };
    assert_eq!(open(&[one.clone(), two, one], &given).unwrap().info().times, 3);
    let message = refusal(&[twice.path().join("t_%03d.npy")], &none);
    assert!(
        message.contains("t_%03d.npy: no file matches this pattern") && message.contains("s_01.npy, s_1.npy"),
        "{message}"
    );

    let of_nifti = |step: &[u8]| nifti(&[7, 5, 4], 1.0, step);
    let unlike = |file: Vec<u8>, words: [&str; 2]| {
        let folder = steps_in(&["s_1.nii", "s_2.nii", "s_3.nii"], of_nifti);
        std::fs::write(folder.path().join("s_2.nii"), file).unwrap();
        let message = refusal(&[folder.path().to_owned()], &none);
        assert!(message.contains("s_2.nii: is") && message.contains("s_1.nii is"), "{message}");
        assert!(words.iter().all(|word| message.contains(word)), "{message}");
    };
    let voxels = [0; 280];
    unlike(nifti(&[5, 7, 4], 1.0, &voxels), ["5,7,4", "7,5,4"]);
    unlike(nifti(&[7, 5, 4], 0.5, &voxels), ["spacing [0.5, 1, 1]", "spacing [1, 1, 1]"]);
    let mut signed = nifti(&[7, 5, 4], 1.0, &voxels);
    signed[70..72].copy_from_slice(&4i16.to_le_bytes());
    // Types may be unlike: all become one.
    let folder = steps_in(&["s_1.nii", "s_2.nii", "s_3.nii"], of_nifti);
    std::fs::write(folder.path().join("s_2.nii"), signed).unwrap();
    assert_eq!(open(&[folder.path().to_owned()], &none).unwrap().info().voxel_type, VoxelType::I32);
    let several = steps_in(&["s_1.nii", "s_2.npy"], of_npy);
    assert!(refusal(&[several.path().to_owned()], &none).contains("holds 1 .npy and 1 NIfTI files"));
}

#[cfg(unix)]
#[test]
fn a_file_is_one_whatever_it_is_called() {
    let folder = steps_in(&["s_0.npy", "t.npy"], |step| npy("(4, 5, 7)", step));
    let at = |name: &str| folder.path().join(name);
    std::os::unix::fs::symlink("s_0.npy", at("s_1.npy")).unwrap();
    std::fs::hard_link(at("s_0.npy"), at("s_2.npy")).unwrap();
    std::fs::create_dir(at("sub")).unwrap();
    let none = OpenOptions::default();
    let given = OpenOptions { order: Some(FileOrder::Given), ..none.clone() };
    for other in ["s_1.npy", "s_2.npy", "sub/../s_0.npy", "./s_0.npy", "s_0.npy"] {
        let files = [at("s_0.npy"), at(other)];
        let refusals = [refusal(&files, &none), order_steps(&files, &none).unwrap_err().to_string()];
        for message in refusals {
            assert!(message.contains("is named twice") && message.contains("`order` given"), "{other}: {message}");
        }
        assert_eq!(open(&files, &given).unwrap().info().times, 2, "it is meant");
        assert!(order_steps(&files, &given).is_ok());
    }
    // In a folder and by a pattern, too.
    for all in [at("s_*.npy"), folder.path().to_owned()] {
        let message = refusal(&[all], &none);
        assert!(message.contains("is named twice") && message.contains("name all files"), "{message}");
    }
    assert_eq!(open(&[at("s_0.npy"), at("t.npy")], &none).unwrap().info().times, 2);
}

#[test]
fn the_halves_of_an_image_are_no_two_steps() {
    let folder = steps_in(&["p.img", "q.img"], <[u8]>::to_vec);
    let mut header = nifti(&[7, 5, 4], 1.0, &[]);
    header.truncate(348);
    header[344..348].copy_from_slice(b"ni1\0");
    let at = |name: &str| folder.path().join(name);
    ["p.hdr", "q.hdr"].iter().for_each(|name| std::fs::write(at(name), &header).unwrap());
    let none = OpenOptions::default();
    let given = OpenOptions { order: Some(FileOrder::Given), ..none.clone() };
    for (files, options) in [(["p.hdr", "p.img"], &none), (["p.img", "p.hdr"], &none), (["p.hdr", "p.img"], &given)] {
        let files = files.map(at);
        let ways = [refusal(&files, options), order_steps(&files, options).unwrap_err().to_string()];
        for message in ways {
            assert!(message.contains("half of the same image") && message.contains("name one of the two"), "{message}");
        }
    }
    for files in [["p.hdr", "q.hdr"], ["p.img", "q.hdr"]] {
        assert_eq!(open(&files.map(at), &none).unwrap().info().times, 2);
        assert!(order_steps(&files.map(at), &none).is_ok());
    }
}

/// `order` applies to the steps, and, if natural, to the files in a folder.
#[test]
fn folders_that_are_steps_are_read_in_the_order_of_the_steps() {
    let folder = steps_in(&["s_1.npy", "s_2.npy", "s_4.npy"], |step| npy("(4, 5, 7)", step));
    let step = |order| OpenOptions { order, is_step: true, ..OpenOptions::default() };
    let of_folder = [folder.path().to_owned()];
    assert_boxes(&*open(&of_folder, &step(Some(FileOrder::Natural))).unwrap(), FIELD);
    for order in [None, Some(FileOrder::Given)] {
        assert!(refusal(&of_folder, &step(order)).contains("without 3"), "{order:?}");
    }
    let both = [folder.path().to_owned(), folder.path().join("s_2.npy")];
    let message = order_steps(&both, &OpenOptions::default()).unwrap_err().to_string();
    assert!(message.contains("s_2.npy: lies in ") && message.contains("name one of the two"), "{message}");
}

/// A remark on some of the files names them; one on all does not.
#[test]
fn remarks_say_which_files_they_are_about() {
    let said_of = |behind: [usize; 3]| {
        let bytes = FIELD.bytes("tczyx", false);
        let folder = tempfile::tempdir().unwrap();
        let paths: Vec<_> = (behind.iter().zip(bytes.chunks(bytes.len() / 3)).enumerate())
            .map(|(i, (&more, step))| {
                let path = folder.path().join(format!("s{i}.nii"));
                std::fs::write(&path, [nifti(&[7, 5, 4], 1.0, step), vec![1; more]].concat()).unwrap();
                path
            })
            .collect();
        let source = open(&paths, &OpenOptions::default()).unwrap();
        said(&source.info().notes).replace(&format!("{}/", folder.path().display()), "")
    };
    assert!(!said_of([0; 3]).contains("bytes"), "{}", said_of([0; 3]));
    assert!(said_of([0, 6, 0]).contains("warning: s1.nii: 6 bytes"), "{}", said_of([0, 6, 0]));
    assert!(said_of([0, 6, 6]).contains("warning: s1.nii and 1 more of 3 files: 6 bytes"), "{}", said_of([0, 6, 6]));
    assert!(said_of([6; 3]).contains("warning: 6 bytes"), "{}", said_of([6; 3]));
}
