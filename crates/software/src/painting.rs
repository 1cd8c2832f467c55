//! A picture while it is drawn, shared by who draws it and who looks at it: what is there so far, how much that is, and whether it is to be
//! abandoned. Costs a lock and a copy for each tile.

use crate::tiles::{Tile, TilePixels, put};
use brickyard_volume::Picture;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};

/// A picture that is being drawn, tile by tile; or several, one after the other, such as two eyes' or the samples of pixels.
#[derive(Debug)]
pub struct Painting {
    so_far: Mutex<Picture>,
    pictures: u32,
    done_tiles: AtomicU32,
    /// Tiles of one picture.
    all_tiles: AtomicU32,
    is_abandoned: AtomicBool,
}

impl Painting {
    /// A painting of so many pictures over one of the same size, which is seen where nothing is drawn yet.
    pub fn over(picture: Picture, pictures: u32) -> Self {
        let (done_tiles, all_tiles) = (AtomicU32::new(0), AtomicU32::new(0));
        Self { so_far: Mutex::new(picture), pictures, done_tiles, all_tiles, is_abandoned: AtomicBool::new(false) }
    }

    /// Tells who draws to stop: within milliseconds, with [`SoftwareError::Abandoned`](crate::SoftwareError::Abandoned).
    pub fn abandon(&self) {
        self.is_abandoned.store(true, Ordering::Relaxed);
    }

    /// Whether it was [abandoned](Painting::abandon).
    pub fn is_abandoned(&self) -> bool {
        self.is_abandoned.load(Ordering::Relaxed)
    }

    /// The share of all pictures that is drawn, 0 to 1.
    pub fn progress(&self) -> f64 {
        let all = f64::from(self.all_tiles.load(Ordering::Relaxed)) * f64::from(self.pictures);
        (f64::from(self.done_tiles.load(Ordering::Relaxed)) / all.max(1.0)).min(1.0)
    }

    /// The picture as it is so far.
    pub fn so_far(&self) -> Picture {
        self.lock().clone()
    }

    /// Begins a picture of so many tiles.
    pub(crate) fn begin(&self, tiles: usize) {
        self.all_tiles.store(tiles as u32, Ordering::Relaxed);
    }

    /// Puts a tile of a picture in its place. A picture of another size, such as one eye's, is counted alone.
    pub(crate) fn put(&self, size_px: (u32, u32), tile: &Tile, pixels: &TilePixels) {
        let mut so_far = self.lock();
        if (so_far.width, so_far.height) == size_px {
            put(&mut so_far, tile, pixels);
        }
        drop(so_far);
        self.done_tiles.fetch_add(1, Ordering::Relaxed);
    }

    fn lock(&self) -> MutexGuard<'_, Picture> {
        self.so_far.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
