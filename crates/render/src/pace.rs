//! Pixels per submission of a picture with a deadline: as many as the device draws in a moment, so that giving up is
//! reported in time.
//!
//! A march queries [`Pace::pixels`] before each submission and reports it to [`Pace::submitted`], which waits for the
//! submission before. So the device always has one to go on with, and the wait costs it nothing; only the very first,
//! of unknown speed, is waited for itself. The slowest pixels so far set the pace; later ones may be slower, so reads
//! are bounded as well.

use crate::{Gpu, GpuError};
use std::cell::{Cell, RefCell};
use std::time::{Duration, Instant};

/// Longest time of a submission: at least this, or this part of the remaining time.
const LEAST_TIME: Duration = Duration::from_millis(50);
const PART_OF_REST: u32 = 64;

/// Pixels of a picture's first submissions, whose speed is unknown.
const FIRST_PIXELS: u32 = 1 << 10;

/// Most growth of a submission's pixels over the last measured one, a factor.
const MOST_GROWTH: u32 = 4;

/// Most texture reads of a submission, however fast the ones before: rays through emptiness are no measure. A software
/// rasteriser takes a second for them.
const MOST_READS: f64 = (1 << 27) as f64;

/// The pace of one picture. Without a deadline, all submissions are as large as possible.
#[derive(Debug)]
pub(crate) struct Pace {
    /// When the picture is given up; `None` never.
    pub(crate) until: Option<Instant>,
    pixels: Cell<u32>,
    /// Seconds per pixel in the slowest submission.
    slowest_s: Cell<f64>,
    /// Whether a submission of this picture or an earlier one has been waited for.
    is_known: Cell<bool>,
    in_flight: RefCell<Option<InFlight>>,
}

#[derive(Debug)]
struct InFlight {
    submission: wgpu::SubmissionIndex,
    pixels: u32,
    /// The earliest time at which the device may have begun it.
    begun: Instant,
}

impl Pace {
    /// Starts a first picture, without a deadline.
    pub(crate) fn new() -> Self {
        Self {
            until: None,
            pixels: Cell::new(FIRST_PIXELS),
            slowest_s: Cell::default(),
            is_known: Cell::default(),
            in_flight: RefCell::default(),
        }
    }

    /// Starts the next picture, which is given up at `until`; `None` never. It begins at the last picture's pace.
    pub(crate) fn restart(&mut self, until: Option<Instant>) {
        *self = Self { until, pixels: self.pixels.clone(), is_known: self.is_known.clone(), ..Self::new() };
    }

    /// The most pixels for the next submission, with at most `reads` texture reads per ray.
    pub(crate) fn pixels(&self, reads: f64) -> u32 {
        let bound = (MOST_READS / reads.max(1.0)) as u32;
        if self.until.is_some() { self.pixels.get().min(bound) } else { u32::MAX }
    }

    /// Reports a submission and its number of pixels.
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

    /// Waits for a submission, and sets the pace by it. Returns its end.
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
        // As after empty rows.
        pace.pixels.set(u32::MAX);
        pace.restart(Some(Instant::now()));
        for reads in [1.0, 1e3, 1e9] {
            assert!(f64::from(pace.pixels(reads)) * reads <= MOST_READS, "{reads}");
        }
    }
}
