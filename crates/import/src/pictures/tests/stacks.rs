use super::jpeg::{Blocks, GRAY};
use super::png::{chunk, gray, planes};
use super::*;
use crate::options::FileOrder;
use crate::testing::{Field, assert_boxes, is_warned, said};
use brickyard_volume::VoxelType;

const FIELD: Field = Field { sizes: [7, 5, 12, 1, 1], voxel_type: VoxelType::U8 };

/// A folder of a field's planes.
fn folder_of(field: Field, name: impl Fn(usize) -> String) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    for (i, (_, file)) in planes(field, if field.sizes[3] == 3 { 2 } else { 0 }, false).into_iter().enumerate() {
        std::fs::write(folder.path().join(name(i)), file).unwrap();
    }
    folder
}

fn message(inputs: &[PathBuf]) -> String {
    open(inputs, &OpenOptions::default()).err().unwrap().to_string()
}

#[test]
fn folders_lists_and_patterns_are_volumes() {
    let folder = folder_of(FIELD, |i| format!("s_{i}.png"));
    for other in ["Thumbs.db", ".DS_Store", "._s_1.png", "notes.txt"] {
        std::fs::write(folder.path().join(other), "x").unwrap();
    }
    let at = |name: &str| folder.path().join(name);
    let mut sorted: Vec<PathBuf> = (0..12).map(|i| at(&format!("s_{i}.png"))).collect();
    sorted.sort();
    for inputs in [vec![folder.path().to_owned()], vec![at("s_%d.png")], vec![at("*.png")], sorted] {
        let source = open(&inputs, &OpenOptions::default()).unwrap();
        assert_boxes(&*source, FIELD);
        assert!(said(&source.info().notes).contains("12 files in natural order"));
    }
    // As with TIFF planes: gaps are refused, until the caller says otherwise.
    std::fs::remove_file(at("s_4.png")).unwrap();
    for input in [folder.path().to_owned(), at("s_*.png")] {
        assert!(message(std::slice::from_ref(&input)).contains("without 4: s_5.png follows s_3.png"));
        let natural = OpenOptions { order: Some(FileOrder::Natural), ..OpenOptions::default() };
        assert_eq!(open(&[input], &natural).unwrap().info().extent.z, 11);
    }
}

#[test]
fn names_of_two_counters_are_axes_if_told() {
    let field = Field { sizes: [7, 5, 4, 3, 1], ..FIELD };
    // Three channels of four slices, a gray picture each.
    let folder = tempfile::tempdir().unwrap();
    let bytes = field.bytes("czyx", false);
    for (i, plane) in bytes.chunks(35).enumerate() {
        let numbers: Vec<u16> = plane.iter().map(|&b| b.into()).collect();
        let name = format!("s_c{}_z{}.png", i / 4, i % 4);
        std::fs::write(folder.path().join(name), gray(7, 5, &numbers, &[])).unwrap();
    }
    let inputs = [folder.path().to_owned()];
    assert!(
        message(&inputs).contains("`order` natural `axes` czyx `channels` 3 to read them so"),
        "{}",
        message(&inputs)
    );
    let told = OpenOptions {
        order: Some(FileOrder::Natural),
        axes: Some("czyx".parse().unwrap()),
        channels: Some(3),
        ..OpenOptions::default()
    };
    assert_boxes(&*open(&inputs, &told).unwrap(), field);
    let useless = OpenOptions { channels: Some(3), ..OpenOptions::default() };
    let message = open(&inputs, &useless).err().unwrap().to_string();
    assert!(message.contains("`channels` is for raw files, and of TIFF and pictures with `axes`"), "{message}");
}

#[test]
fn colours_of_several_steps() {
    let field = Field { sizes: [7, 5, 2, 3, 3], ..FIELD };
    let all = Field { sizes: [7, 5, 6, 3, 1], ..FIELD };
    let folder = tempfile::tempdir().unwrap();
    let bytes = field.bytes("tzyxc", false);
    assert_eq!(bytes.len(), all.bytes("zyxc", false).len());
    for (i, plane) in bytes.chunks(105).enumerate() {
        let numbers: Vec<u16> = plane.iter().map(|&b| b.into()).collect();
        let picture = super::png::Picture {
            width: 7,
            height: 5,
            bits: 8,
            colour: 2,
            is_interlaced: false,
            chunks: Vec::new(),
            numbers: &numbers,
        };
        std::fs::write(folder.path().join(format!("t{}_z{}.png", i / 2, i % 2)), picture.file()).unwrap();
    }
    let told = OpenOptions {
        order: Some(FileOrder::Natural),
        axes: Some("tzyx".parse().unwrap()),
        times: Some(3),
        ..OpenOptions::default()
    };
    assert_boxes(&*open(&[folder.path().to_owned()], &told).unwrap(), field);
}

#[test]
fn odd_pictures_are_named() {
    let plain = || gray(2, 1, &[1, 2], &[]);
    let deep = planes(Field { sizes: [2, 1, 1, 1, 1], voxel_type: VoxelType::U16 }, 0, false).remove(0).1;
    let coloured = planes(Field { sizes: [2, 1, 1, 3, 1], voxel_type: VoxelType::U8 }, 2, false).remove(0).1;
    let dense = gray(2, 1, &[1, 2], &chunk(b"pHYs", &[0, 0, 7, 0, 0, 0, 7, 0, 1]));
    for (odd, words) in [
        (gray(1, 2, &[1, 2], &[]), "s3.png: is 1x2 pixels of 8-bit gray, but"),
        (deep, "s3.png: is 2x1 pixels of 16-bit gray, but"),
        (coloured, "s3.png: is 2x1 pixels of 8-bit red, green, blue, but"),
        (dense, "has pixels of 0.00055"),
    ] {
        let files = [("s1.png", plain()), ("s2.png", plain()), ("s3.png", odd)];
        let message = opened_as(&files, &OpenOptions::default()).err().unwrap();
        assert!(message.contains(words), "{message}");
    }
    let files = [("s1.png", plain()), ("s2.png", Blocks { size: [2, 1], ..GRAY }.file())];
    let message = opened_as(&files, &OpenOptions::default()).err().unwrap();
    assert!(message.contains("s2.png: is of another format than ") && message.contains("s1.png"), "{message}");
}

#[test]
fn folders_of_two_kinds_name_both() {
    let folder = folder_of(FIELD, |i| format!("s_{i}.png"));
    std::fs::write(folder.path().join("a.jpg"), GRAY.file()).unwrap();
    let inputs = [folder.path().to_owned()];
    assert!(message(&inputs).contains("holds 12 PNG and 1 JPEG files: choose one of them"), "{}", message(&inputs));
    std::fs::rename(folder.path().join("a.jpg"), folder.path().join("a.tif")).unwrap();
    assert!(message(&inputs).contains("holds 1 TIFF and 12 PNG files"), "{}", message(&inputs));
}

/// Content counts, not the name.
#[test]
fn pictures_are_known_by_their_first_bytes() {
    for name in ["a.png", "a", "a.raw", "a.jpg", "a.001"] {
        assert_eq!(first_channel(&*opened(name, gray(2, 1, &[1, 2], &[])).1), [1, 2], "{name}");
    }
    for (bytes, what) in [
        (&b"GIF89a..........."[..], "a GIF picture"),
        (b"RIFF\x10\0\0\0WEBPVP8 ......", "a WebP picture"),
        (b"\0\0\0\x0cjP  \r\n\x87\n.....", "a JPEG 2000 picture"),
        (b"\0\0\0\x0cJXL \r\n\x87\n.....", "a JPEG XL picture"),
        (b"\xff\x0a..............", "a JPEG XL picture"),
    ] {
        for name in ["a.png", "a.jpg", "a.gif"] {
            let message = refusal(name, bytes);
            assert!(message.contains(&format!("{what} is not supported; convert the pictures")), "{message}");
        }
    }
}

#[test]
fn remarks_say_which_pictures_they_are_about() {
    let plain = || gray(2, 1, &[1, 2], &[]);
    let clear = || gray(2, 1, &[1, 2], &chunk(b"tRNS", &[0, 1]));
    let (_folder, source) =
        opened_as(&[("s1.png", plain()), ("s2.png", clear()), ("s3.png", clear())], &OpenOptions::default()).unwrap();
    let said = said(&source.info().notes);
    assert!(is_warned(&said, "s2.png and 1 more of 3 files: Transparency"), "{said}");
}

/// A picture may not change between its header's check and its reading.
#[test]
fn changed_pictures_are_refused() {
    let (folder, source) = opened("a.png", gray(2, 1, &[1, 2], &[]));
    std::fs::write(folder.path().join("a.png"), gray(2, 1, &[1, 2], &chunk(b"tEXt", b"a\0b"))).unwrap();
    let message = channel_of(&*source, 0).unwrap_err().to_string();
    assert!(message.contains("changed while it was read"), "{message}");
}

/// More pictures than a process may open files.
#[test]
fn files_are_closed_again() {
    let count = 3000;
    let field = Field { sizes: [2, 2, count, 1, 1], ..FIELD };
    let folder = folder_of(field, |i| format!("s_{i:04}.png"));
    let source = open(&[folder.path().to_owned()], &OpenOptions::default()).unwrap();
    assert!(source.held_bytes() > u64::from(count) * 20);
    assert_eq!(first_channel(&*source), field.bytes("zyx", false));
}
