//! Unmarked pages at most half as large as the first: levels of a pyramid and thumbnails. They are left out, unless one size has more pages than
//! the first page's: then they may be the stack.

use brickyard_volume::counted;

/// Such pages of one file, by their sizes.
#[derive(Default)]
pub(super) struct Thumbnails(Vec<Size>);

struct Size {
    width: u32,
    height: u32,
    pages: u32,
    /// The first one's number, from 1.
    first: u32,
}

impl Thumbnails {
    /// Adds a page by its number, from 1. Returns the number of pages of its size so far.
    pub(super) fn add(&mut self, (width, height): (u32, u32), page: u32) -> u32 {
        let known = self.0.iter_mut().find(|size| (size.width, size.height) == (width, height));
        if let Some(size) = known {
            size.pages += 1;
            return size.pages;
        }
        self.0.push(Size { width, height, pages: 1, first: page });
        1
    }

    pub(super) fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Why they cannot be left out beside `planes` pages of the first one's size; `None` if they can.
    pub(super) fn problem(&self, planes: u32) -> Option<String> {
        let Size { width, height, pages, first } = self.0.iter().find(|size| size.pages > planes)?;
        let planes = counted(planes.into(), "page");
        Some(format!(
            "has {pages} pages of {width}x{height}, from page {first} on, beside {planes} of another size, the first among them: \
             write one kind to a file of its own (tiffcp IN,N OUT, from 0)"
        ))
    }
}
