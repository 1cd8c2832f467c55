//! Numbers by id, on disk: 8 bytes for each, of which untouched ones take no room. The pages used last are kept in memory, 4 MiB.

use lru::LruCache;
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::num::NonZeroUsize;

/// Numbers of a page.
const PAGE: usize = 512;

/// Pages kept.
const KEPT: NonZeroUsize = NonZeroUsize::new(1024).unwrap();

/// Bytes kept.
pub(crate) const TABLE_BYTES: u64 = 8 * (PAGE * KEPT.get()) as u64;

/// Numbers plus one; zeros are free.
type Page = Box<[u64; PAGE]>;

/// A table of numbers.
pub(crate) struct NumberTable {
    file: File,
    pages: LruCache<u64, Page>,
    /// Pages of the file.
    length: u64,
}

impl NumberTable {
    /// A table in an empty file.
    pub(crate) fn new(file: File) -> Self {
        Self { file, pages: LruCache::new(KEPT), length: 0 }
    }

    /// The number of an id, if it has one.
    ///
    /// # Errors
    /// If the file fails.
    pub(crate) fn get(&mut self, id: u64) -> io::Result<Option<u64>> {
        let number = self.page(id / PAGE as u64)?[id as usize % PAGE];
        Ok(number.checked_sub(1))
    }

    /// # Errors
    /// If the file fails.
    pub(crate) fn set(&mut self, id: u64, number: u64) -> io::Result<()> {
        self.page(id / PAGE as u64)?[id as usize % PAGE] = number + 1;
        Ok(())
    }

    /// Forgets all numbers.
    ///
    /// # Errors
    /// If the file fails.
    pub(crate) fn clear(&mut self) -> io::Result<()> {
        self.pages.clear();
        if self.length > 0 {
            self.length = 0;
            self.file.set_len(0)?;
        }
        Ok(())
    }

    fn page(&mut self, index: u64) -> io::Result<&mut Page> {
        if !self.pages.contains(&index) {
            let page = self.read(index)?;
            if self.pages.len() == KEPT.get()
                && let Some((index, page)) = self.pages.pop_lru()
            {
                self.write(index, &page)?;
            }
            self.pages.put(index, page);
        }
        self.pages.get_mut(&index).ok_or_else(|| io::Error::other("a page was lost"))
    }

    fn read(&mut self, index: u64) -> io::Result<Page> {
        let mut page: Page = Box::new([0; PAGE]);
        if index < self.length {
            self.file.seek(SeekFrom::Start(index * size_of::<[u64; PAGE]>() as u64))?;
            self.file.read_exact(bytemuck::cast_slice_mut(&mut page[..]))?;
        }
        Ok(page)
    }

    fn write(&mut self, index: u64, page: &Page) -> io::Result<()> {
        self.file.seek(SeekFrom::Start(index * size_of::<[u64; PAGE]>() as u64))?;
        self.file.write_all(bytemuck::cast_slice(&page[..]))?;
        self.length = self.length.max(index + 1);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_found_again_also_after_their_page_was_dropped() {
        let mut table = NumberTable::new(tempfile::tempfile().unwrap());
        // More pages than are kept, in another order, some with gaps between them.
        let ids: Vec<u64> = (0..3000u64).map(|i| i * 7919 % 3000 * 700 + i % 3).collect();
        for (number, id) in ids.iter().enumerate() {
            assert_eq!(table.get(*id).unwrap(), None);
            table.set(*id, number as u64).unwrap();
        }
        for (number, id) in ids.iter().enumerate() {
            assert_eq!(table.get(*id).unwrap(), Some(number as u64));
        }
        assert!(table.length > 0);
        table.clear().unwrap();
        assert_eq!(table.get(ids[5]).unwrap(), None);
    }
}
