//! A picture being drawn, shared by its renderer and its viewer: the pixels so far, the progress, and a flag for
//! abandoning it. Costs a lock and a copy per tile.

use crate::tiles::{Tile, TilePixels, put, tiles};
use brickyard_volume::Picture;
use std::collections::HashMap;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// A picture being drawn, tile by tile; or several, one after the other, such as two eyes' or the samples of pixels.
#[derive(Debug)]
pub struct Painting {
    so_far: Mutex<Picture>,
    size_px: (u32, u32),
    pictures: u32,
    done_tiles: AtomicU32,
    all_tiles: AtomicU32,
    is_abandoned: AtomicBool,
    kept: Mutex<Option<Arc<KeptTiles>>>,
}

/// Tiles of a picture that outlive an abandoned painting, for the next one to continue with. They are of one frame and
/// one eye.
#[derive(Debug, Default)]
pub struct KeptTiles(Mutex<HashMap<(u32, u32), TilePixels>>);

impl KeptTiles {
    /// The tiles' share of a picture of this size.
    pub fn share(&self, (width, height): (u32, u32)) -> f64 {
        let kept = self.0.lock().unwrap_or_else(PoisonError::into_inner).len();
        kept as f64 / tiles(width, height).count().max(1) as f64
    }

    pub(crate) fn get(&self, tile: &Tile) -> Option<TilePixels> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).get(&(tile.x0, tile.y0)).copied()
    }

    pub(crate) fn put(&self, tile: &Tile, pixels: &TilePixels) {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).insert((tile.x0, tile.y0), *pixels);
    }
}

impl Painting {
    /// Creates a painting of a size, for a number of pictures. Nothing is visible until they are done, unless another
    /// picture [lies under](Painting::lay_under) them.
    pub fn new(size_px: (u32, u32), pictures: u32) -> Self {
        let so_far = Mutex::new(Picture { width: 0, height: 0, rgb: Vec::new() });
        let (done_tiles, all_tiles, is_abandoned, kept) = Default::default();
        Self { so_far, size_px, pictures, done_tiles, all_tiles, is_abandoned, kept }
    }

    /// Lays a picture under those not yet begun: it is visible where nothing is drawn yet, smoothly scaled to the
    /// painting's size.
    pub fn lay_under(&self, picture: Picture) {
        *self.lock() = picture;
    }

    /// Continues with tiles in the pictures to come: kept tiles are not drawn again, and newly drawn ones are kept.
    pub fn go_on_with(&self, tiles: Option<Arc<KeptTiles>>) {
        *self.kept.lock().unwrap_or_else(PoisonError::into_inner) = tiles;
    }

    pub(crate) fn kept(&self) -> Option<Arc<KeptTiles>> {
        self.kept.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Stops the drawing, within milliseconds, with [`SoftwareError::Abandoned`](crate::SoftwareError::Abandoned).
    pub fn abandon(&self) {
        self.is_abandoned.store(true, Ordering::Relaxed);
    }

    /// Whether it was [abandoned](Painting::abandon).
    pub fn is_abandoned(&self) -> bool {
        self.is_abandoned.load(Ordering::Relaxed)
    }

    /// The drawn share of all pictures, 0 to 1.
    pub fn progress(&self) -> f64 {
        let all = f64::from(self.all_tiles.load(Ordering::Relaxed)) * f64::from(self.pictures);
        (f64::from(self.done_tiles.load(Ordering::Relaxed)) / all.max(1.0)).min(1.0)
    }

    /// The picture so far; one without pixels if none lies under it.
    pub fn so_far(&self) -> Picture {
        self.lock().clone()
    }

    pub(crate) fn begin(&self, size_px: (u32, u32), tiles: usize) {
        self.all_tiles.store(tiles as u32, Ordering::Relaxed);
        let mut so_far = self.lock();
        if size_px == self.size_px && (so_far.width, so_far.height) != size_px && !so_far.rgb.is_empty() {
            *so_far = scaled(&so_far, size_px);
        }
    }

    /// Puts a tile of a picture in its place. A picture of another size, such as one eye's, is only counted.
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

fn scaled(picture: &Picture, (width, height): (u32, u32)) -> Picture {
    // For each pixel along an axis its two neighbours in the source, and the share of the second.
    let along = |from: u32, to: u32| -> Vec<(usize, usize, f32)> {
        let place = |i: u32| ((i as f32 + 0.5) * from as f32 / to as f32 - 0.5).clamp(0.0, (from - 1) as f32);
        let split = |at: f32| (at as usize, (at as usize + 1).min(from as usize - 1), at.fract());
        (0..to).map(|i| split(place(i))).collect()
    };
    let (columns, rows) = (along(picture.width, width), along(picture.height, height));
    let mut rgb = Vec::with_capacity(width as usize * height as usize);
    for (up, down, below) in rows {
        let [up, down] = [up, down].map(|row| &picture.rgb[row * picture.width as usize..]);
        rgb.extend(columns.iter().map(|&(left, right, beside)| {
            std::array::from_fn(|k| {
                let mix = |a: u8, b: u8, share: f32| f32::from(a) + (f32::from(b) - f32::from(a)) * share;
                let [above, under] = [up, down].map(|row| mix(row[left][k], row[right][k], beside));
                (above + (under - above) * below + 0.5) as u8
            })
        }));
    }
    Picture { width, height, rgb }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_scaled_picture_is_a_line_between_its_pixels() {
        let ramp = Picture { width: 2, height: 1, rgb: vec![[0, 40, 200], [100, 40, 0]] };
        let wide = scaled(&ramp, (4, 2));
        assert_eq!(wide.rgb[..4], [[0, 40, 200], [25, 40, 150], [75, 40, 50], [100, 40, 0]]);
        assert_eq!(wide.rgb[4..], wide.rgb[..4]);
    }
}
