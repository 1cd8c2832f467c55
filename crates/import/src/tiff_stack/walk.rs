//! Single walk of a TIFF file's directories: lists the pages, checks that they agree, and finds copies.

use super::arrange::arrange;
use super::description::Description;
use super::page::{OpenTiff, PageFormat};
use super::page_tags::PageTags;
use super::thumbnails::Thumbnails;
use super::{Parts, TiffFile, TiffStack};
use crate::error::{ImportError, Result};
use crate::note::Note;
use crate::options::OpenOptions;
use crate::source::Source;
use brickyard_volume::counted;
use std::path::Path;
use std::sync::Mutex;

/// Opens the pages of one file by their description. `tiff` stands at the first.
pub(super) fn open_pages(
    tiff: OpenTiff,
    format: PageFormat,
    description: &Description,
    options: &OpenOptions,
) -> Result<Box<dyn Source>> {
    let Walked { file, tiff, reader_bytes, odd, left_out, thumbnails } = Walked::of(tiff, &format, Some(options))?;
    if let Some(problem) = thumbnails.problem(file.pages - left_out.len() as u32) {
        return Err(ImportError::invalid(&file.path, problem));
    }
    if let Some(odd) = odd {
        return Err(odd);
    }
    let declared = description.declared.as_ref();
    let planes = file.pages - left_out.len() as u32;
    let (map, note) = arrange(&file.path, planes, 1, options, declared, &format)?;
    let copies = (!left_out.is_empty()).then(|| {
        let are = match left_out.len() {
            1 => "is a smaller copy or a mask of another",
            _ => "are smaller copies or masks of others",
        };
        let pages = counted(left_out.len() as u64, "page");
        // Pages of several sizes are no stack.
        let all = if thumbnails.is_empty() { "; `axes` zyx takes all pages" } else { "" };
        format!("{pages} {are} (by NewSubfileType, or half as large), and left out{all}.")
    });
    let map = map.without(&left_out);
    let parts = Parts { files: vec![file], format, map, reader_bytes, idle: Mutex::new(vec![(0, tiff)]) };
    let mut stack = TiffStack::new(parts, description, options)?;
    stack.info.notes.extend(note);
    stack.info.notes.extend(copies.map(Note::new));
    Ok(Box::new(stack))
}

pub(super) fn refuse_problem(path: &Path, description: &Description) -> Result<()> {
    description.problem.as_ref().map_or(Ok(()), |problem| Err(ImportError::invalid(path, problem)))
}

pub(super) fn odd_page(path: &Path, number: u32, format: &PageFormat, expected: &PageFormat) -> ImportError {
    let problem =
        format!("page {number} is {format}, but page 1 is {expected}; tiffcp IN,N OUT writes single pages, from 0");
    ImportError::invalid(path, problem)
}

/// A file with all directories examined.
pub(super) struct Walked {
    pub(super) file: TiffFile,
    pub(super) tiff: OpenTiff,
    pub(super) reader_bytes: u64,
    /// The refusal of the first page that differs from the others, or lacks its data.
    pub(super) odd: Option<ImportError>,
    /// Pages left out, counted from 0, ascending.
    pub(super) left_out: Vec<u32>,
    /// Small unmarked pages among those left out.
    pub(super) thumbnails: Thumbnails,
}

impl Walked {
    /// Walks the directories of a file from its first page on, expecting `format`. With `options`, the tags of pages about pixels are checked, unless
    /// the options replace them, and smaller copies and masks of other pages are left out, unless the user's axes cover all pages or the first page
    /// is one: then all are of that kind, or it is meant itself. A page at most half as large as the first is a copy.
    pub(super) fn of(mut tiff: OpenTiff, format: &PageFormat, options: Option<&OpenOptions>) -> Result<Self> {
        let path = tiff.path.clone();
        let first = options.map(|options| PageTags::of(&mut tiff, format, options)).transpose()?;
        let leaves_out = options.is_some_and(|options| options.axes.is_none()) && !tiff.is_copy_or_mask()?;
        let (mut pages, mut reader_bytes, mut odd) = (1u32, 0, None);
        let (mut left_out, mut thumbnails) = (Vec::new(), Thumbnails::default());
        loop {
            let is_copy = leaves_out && tiff.is_copy_or_mask()?;
            let small = if leaves_out && !is_copy { tiff.small_size(format)? } else { None };
            if let Some(size) = small {
                thumbnails.add(size, pages);
            }
            if is_copy || small.is_some() {
                left_out.push(pages - 1);
            } else {
                let checked = tiff.format().and_then(|other| {
                    if other != *format {
                        return Err(odd_page(&path, pages, &other, format));
                    }
                    tiff.check_data(pages)?;
                    if let (Some(first), Some(options)) = (&first, options) {
                        PageTags::of(&mut tiff, format, options)?.check(&path, pages, first)?;
                    }
                    tiff.reader_bytes(format)
                });
                match checked {
                    Ok(bytes) => reader_bytes = reader_bytes.max(bytes),
                    Err(error) => odd = odd.or(Some(error)),
                }
            }
            if !tiff.has_more_pages() {
                break;
            }
            tiff.next_page()?;
            pages += 1;
        }
        let file = TiffFile { path, stamp: tiff.stamp, pages };
        Ok(Self { file, tiff, reader_bytes, odd, left_out, thumbnails })
    }
}
