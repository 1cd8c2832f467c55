//! Parts of a picture to be saved that are drawn already: whole samples, and tiles of the next one. The window and the session that draws share them; a
//! lock is held for a moment only, and not while samples are added.

use brickyard::session::{Frame, KeptTiles};
use brickyard::volume::{Picture, PictureSum, PixelSamples};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

#[derive(Default)]
pub(super) struct Made(Mutex<Parts>);

#[derive(Default)]
struct Parts {
    /// The coarseness of the bricks that they are drawn from.
    pixel_error: f64,
    sum: PictureSum,
    /// Samples that are in the sum.
    samples: usize,
    /// Tiles of the sample that comes next.
    tiles: Arc<KeptTiles>,
}

impl Made {
    /// Forgets what does not go on with this frame: what is drawn from other bricks.
    pub(super) fn keep_for(&self, frame: &Frame) {
        let (mut parts, pixel_error) = (self.lock(), frame.status.pixel_error);
        if parts.pixel_error != pixel_error {
            *parts = Parts { pixel_error, ..Parts::default() };
        }
    }

    /// Samples that are drawn, and tiles of the next one.
    pub(super) fn drawn(&self) -> (usize, Arc<KeptTiles>) {
        let parts = self.lock();
        (parts.samples, parts.tiles.clone())
    }

    /// Adds the next sample.
    pub(super) fn add(&self, picture: &Picture) {
        let mut sum = std::mem::take(&mut self.lock().sum);
        sum.add(picture);
        let mut parts = self.lock();
        (parts.sum, parts.tiles) = (sum, Arc::default());
        parts.samples += 1;
    }

    /// The picture if it has all its samples.
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
