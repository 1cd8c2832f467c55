//! Finished parts of a picture to be saved: whole samples, and tiles of the next one. The window and the drawing session share them; the lock is held
//! only briefly, never while samples are added.

use brickyard::session::{Frame, KeptTiles};
use brickyard::volume::{Picture, PictureSum, PixelSamples};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

#[derive(Default)]
pub(super) struct Made(Mutex<Parts>);

#[derive(Default)]
struct Parts {
    /// Coarseness of their bricks.
    pixel_error: f64,
    sum: PictureSum,
    /// Samples in the sum.
    samples: usize,
    /// Tiles of the next sample.
    tiles: Arc<KeptTiles>,
}

impl Made {
    /// Drops parts drawn from other bricks than this frame's.
    pub(super) fn keep_for(&self, frame: &Frame) {
        let (mut parts, pixel_error) = (self.lock(), frame.status.pixel_error);
        if parts.pixel_error != pixel_error {
            *parts = Parts { pixel_error, ..Parts::default() };
        }
    }

    /// The number of drawn samples, and the tiles of the next one.
    pub(super) fn drawn(&self) -> (usize, Arc<KeptTiles>) {
        let parts = self.lock();
        (parts.samples, parts.tiles.clone())
    }

    /// The frame of the next sample.
    pub(super) fn next(&self, frame: &Frame, samples: PixelSamples) -> Frame {
        let done = self.lock().samples;
        match samples.samples().nth(done) {
            Some(sample) if samples != PixelSamples::ONE => frame.of_sample(sample),
            _ => frame.clone(),
        }
    }

    pub(super) fn add(&self, picture: &Picture) {
        let mut sum = std::mem::take(&mut self.lock().sum);
        sum.add(picture);
        let mut parts = self.lock();
        (parts.sum, parts.tiles) = (sum, Arc::default());
        parts.samples += 1;
    }

    /// The picture, if it has all its samples.
    pub(super) fn whole(&self, samples: PixelSamples) -> Option<Picture> {
        let sum = {
            let mut parts = self.lock();
            (parts.samples == samples.count()).then(|| std::mem::take(&mut parts.sum))?
        };
        let picture = sum.mean();
        self.lock().sum = sum;
        Some(picture)
    }

    fn lock(&self) -> MutexGuard<'_, Parts> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
