//! Pixels per submission of a picture that may be given up: as many as the device draws in a moment, so that giving up is told in time.
//!
//! A march asks for [`Pace::pixels`] before each submission and tells of it in [`Pace::submitted`], which waits for the submission before. So the
//! device always has one to go on with, and the wait costs it nothing; but the very first is waited for, as nothing is known of it. The slowest pixels
//! seen so far set the pace; since nothing is known of those to come, reads are bounded, too.

use crate::error::GpuError;
use crate::gpu::Gpu;
use std::cell::{Cell, RefCell};
use std::time::{Duration, Instant};

/// How long a submission may take: at least this, or this part of the time that is left.
const LEAST_TIME: Duration = Duration::from_millis(50);
const PART_OF_REST: u32 = 64;

/// The pixels of a picture's first submissions, of which nothing is known.
const FIRST_PIXELS: u32 = 1 << 10;

/// How many times more pixels a submission has than a known one at most.
const MOST_GROWTH: u32 = 4;

/// Reads of textures in a submission at most, however fast the ones before were: where rays meet nothing, they tell nothing. A rasteriser in software
/// takes a second for them.
const MOST_READS: f64 = (1 << 27) as f64;

/// The pace at which one picture is drawn. All submissions of a picture that is never given up are as large as they can be.
#[derive(Debug)]
pub(crate) struct Pace {
    until: Option<Instant>,
    pixels: Cell<u32>,
    /// Seconds that a pixel of the slowest submission took.
    slowest_s: Cell<f64>,
    /// Whether a submission of this picture or one before has been waited for.
    is_known: Cell<bool>,
    in_flight: RefCell<Option<InFlight>>,
}

#[derive(Debug)]
struct InFlight {
    submission: wgpu::SubmissionIndex,
    pixels: u32,
    /// When the device began with it, at the earliest.
    begun: Instant,
}

impl Pace {
    /// For a first picture, which is never given up.
    pub(crate) fn new() -> Self {
        Self {
            until: None,
            pixels: Cell::new(FIRST_PIXELS),
            slowest_s: Cell::default(),
            is_known: Cell::default(),
            in_flight: RefCell::default(),
        }
    }

    /// For the next picture, which is given up at some time; `None` never. It begins as the one before ended.
    pub(crate) fn restart(&mut self, until: Option<Instant>) {
        *self = Self { until, pixels: self.pixels.clone(), is_known: self.is_known.clone(), ..Self::new() };
    }

    /// When the picture is given up.
    pub(crate) fn until(&self) -> Option<Instant> {
        self.until
    }

    /// How many pixels the next submission should have at most, whose rays read textures so many times at most.
    pub(crate) fn pixels(&self, reads: f64) -> u32 {
        let bound = (MOST_READS / reads.max(1.0)) as u32;
        if self.until.is_some() { self.pixels.get().min(bound) } else { u32::MAX }
    }

    /// Tells of a submission with so many pixels.
    ///
    /// # Errors
    /// [`GpuError::TooLong`] if the picture is given up, or if the device fails.
    pub(crate) fn submitted(&self, gpu: &Gpu, submission: wgpu::SubmissionIndex, pixels: u32) -> Result<(), GpuError> {
        let Some(until) = self.until else { return Ok(()) };
        let mut next = InFlight { submission, pixels, begun: Instant::now() };
        if !self.is_known.replace(true) {
            return self.wait(gpu, next, until).map(|_| ());
        }
        if let Some(before) = self.in_flight.take() {
            next.begun = self.wait(gpu, before, until)?;
        }
        self.in_flight.replace(Some(next));
        Ok(())
    }

    /// Waits for a submission, and sets the pace by it. Returns when it was done.
    fn wait(&self, gpu: &Gpu, before: InFlight, until: Instant) -> Result<Instant, GpuError> {
        gpu.wait(before.submission)?;
        let done = Instant::now();
        if done >= until {
            return Err(GpuError::TooLong);
        }
        let allowed = LEAST_TIME.max((until - done) / PART_OF_REST);
        let taken_s = (done - before.begun).as_secs_f64() / f64::from(before.pixels);
        let slowest_s = taken_s.max(self.slowest_s.get());
        self.slowest_s.set(slowest_s);
        self.pixels.set(((allowed.as_secs_f64() / slowest_s) as u32).min(before.pixels.saturating_mul(MOST_GROWTH)));
        Ok(done)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn where_nothing_is_known_of_rays_their_reads_are_bounded() {
        let mut pace = Pace::new();
        assert_eq!(pace.pixels(1e9), u32::MAX, "a picture that is never given up");
        pace.restart(Some(Instant::now()));
        assert_eq!(pace.pixels(1.0), FIRST_PIXELS);
        // As after rows in which nothing is seen.
        pace.pixels.set(u32::MAX);
        pace.restart(Some(Instant::now()));
        for reads in [1.0, 1e3, 1e9] {
            assert!(f64::from(pace.pixels(reads)) * reads <= MOST_READS, "{reads}");
        }
    }
}
