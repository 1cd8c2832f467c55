//! Pages that are smaller copies or masks, among planes.

use super::{Layout, opened, options, refusal, values, written};
use crate::open::open;
use crate::options::OpenOptions;
use crate::testing::{Field, said, temp_file};
use brickyard_volume::VoxelType;

const WIDTH: u16 = 256;
const HEIGHT: u16 = 257;
const PHOTOMETRIC: u16 = 262;
const NEW_SUBFILE_TYPE: u16 = 254;

/// Puts a number in a page's directory.
fn put(bytes: &mut [u8], page: usize, tag: u16, number: u8) {
    let is_entry = |w: &[u8]| w[..2] == tag.to_le_bytes() && w[3..] == [0, 1, 0, 0, 0] && [3, 4].contains(&w[2]);
    let at = (0..bytes.len() - 8).filter(|at| is_entry(&bytes[*at..at + 8])).nth(page).unwrap();
    bytes[at + 8] = number;
}

/// Pages of 7 x 5 pixels, some marked with NewSubfileType.
fn marked(pages: u32, kinds: &[(usize, u8)]) -> Vec<u8> {
    let field = Field { sizes: [7, 5, pages, 1, 1], voxel_type: VoxelType::U8 };
    let layout = Layout { tags: vec![(NEW_SUBFILE_TYPE, 0)], ..Layout::default() };
    let mut bytes = written(field, "z", &layout);
    kinds.iter().for_each(|(page, kind)| put(&mut bytes, *page, NEW_SUBFILE_TYPE, *kind));
    bytes
}

fn all_pages() -> OpenOptions {
    OpenOptions { axes: Some("zyx".parse().unwrap()), ..options() }
}

#[test]
fn smaller_copies_and_masks_are_no_planes() {
    let (_folder, plain) = temp_file("a.tif", &marked(5, &[]));
    let all = values(&*opened(&plain).unwrap());
    let plane = |z: usize| &all[35 * z..35 * (z + 1)];
    // A smaller one, a mask, and a copy of the same size; pages of kind 2 are pages.
    let mut bytes = marked(5, &[(0, 2), (1, 1), (2, 2), (3, 4)]);
    put(&mut bytes, 1, WIDTH, 3);
    put(&mut bytes, 3, PHOTOMETRIC, 4);
    let (_folder, path) = temp_file("a.tif", &bytes);
    let source = opened(&path).unwrap();
    assert_eq!(source.info().extent.to_array(), [7, 5, 3]);
    assert_eq!(values(&*source), [plane(0), plane(2), plane(4)].concat());
    let notes = said(&source.info().notes);
    assert!(notes.contains("2 pages are smaller copies or masks of others") && notes.contains("`axes` zyx"), "{notes}");
    // An unmarked thumbnail.
    let field = Field { sizes: [7, 5, 3, 1, 1], voxel_type: VoxelType::U8 };
    let mut silent = written(field, "z", &Layout { chunk: Err(5), ..Layout::default() });
    put(&mut silent, 2, WIDTH, 4);
    put(&mut silent, 2, HEIGHT, 3);
    let (_folder, path) = temp_file("a.tif", &silent);
    let source = opened(&path).unwrap();
    assert_eq!(values(&*source), [plane(0), plane(1)].concat());
    let notes = said(&source.info().notes);
    // Pages of several sizes are no stack, whatever the axes.
    assert!(notes.contains("1 page is a smaller copy") && !notes.contains("`axes`"), "{notes}");
    // More of one size than of the first's may be the stack.
    put(&mut silent, 1, WIDTH, 4);
    put(&mut silent, 1, HEIGHT, 3);
    let message = refusal(&silent, &options());
    assert!(message.contains("has 2 pages of 4x3, from page 2 on, beside 1 page of another size"), "{message}");
    let message = refusal(&bytes, &all_pages());
    assert!(message.contains("page 2 is 3x5 u8, but page 1 is 7x5 u8; tiffcp"), "{message}");

    let (_folder, path) = temp_file("a.tif", &marked(5, &[(3, 1), (4, 5)]));
    assert_eq!(values(&*opened(&path).unwrap()), [plane(0), plane(1), plane(2)].concat());
    assert_eq!(values(&*open(&[path], &all_pages()).unwrap()), all);
    // If the first page is one, its original is unknown.
    let (_folder, path) = temp_file("a.tif", &marked(5, &[(0, 1), (1, 1)]));
    assert_eq!(values(&*opened(&path).unwrap()), all);
}

#[test]
fn files_of_a_page_and_its_copies_are_planes() {
    let (folder, _) = temp_file("s1.tif", &marked(2, &[(1, 1)]));
    std::fs::write(folder.path().join("s2.tif"), marked(1, &[])).unwrap();
    let source = opened(folder.path()).unwrap();
    assert_eq!((source.info().extent.to_array(), source.info().times), ([7, 5, 2], 1));
    assert!(said(&source.info().notes).contains("left out, in 1 file."), "{:?}", source.info().notes);
    // The user's axes cover all pages.
    let message = open(&[folder.path().to_owned()], &all_pages()).err().unwrap().to_string();
    assert!(message.contains("several planes"), "{message}");
}

/// Copies may be unmarked.
#[test]
fn files_of_a_page_and_a_silent_thumbnail_are_planes() {
    let of = |pages: u16, thumbnails: std::ops::Range<usize>| {
        let field = Field { sizes: [7, 5, u32::from(pages), 1, 1], voxel_type: VoxelType::U8 };
        let mut bytes = written(field, "z", &Layout { chunk: Err(5), ..Layout::default() });
        for page in thumbnails {
            put(&mut bytes, page, WIDTH, 3);
            put(&mut bytes, page, HEIGHT, 2);
        }
        bytes
    };
    let (folder, _) = temp_file("s1.tif", &of(2, 1..2));
    std::fs::write(folder.path().join("s2.tif"), of(1, 0..0)).unwrap();
    let source = opened(folder.path()).unwrap();
    assert_eq!((source.info().extent.to_array(), source.info().times), ([7, 5, 2], 1));
    // Two of one size may be planes.
    std::fs::write(folder.path().join("s1.tif"), of(3, 1..3)).unwrap();
    let message = opened(folder.path()).err().unwrap().to_string();
    assert!(message.contains("several planes"), "{message}");
}
