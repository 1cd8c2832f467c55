//! Pixels per submission of a picture that may be given up: as many as the device draws in a moment, so that giving up is told in time.
//!
//! A march asks for [`Pace::pixels`] before each submission and tells of it in [`Pace::submitted`], which waits for the submission before. So the
//! device always has one to go on with, and the wait costs it nothing.

use crate::error::GpuError;
use crate::gpu::Gpu;
use std::cell::{Cell, RefCell};
use std::time::{Duration, Instant};

/// How long a submission may take: at least this, or this part of the time that is left.
const LEAST_TIME: Duration = Duration::from_millis(50);
const PART_OF_REST: u32 = 64;

/// The pixels of a picture's first submissions, of which nothing is known.
const FIRST_PIXELS: u32 = 1 << 10;

/// How many times more, or less, pixels a submission has than a known one.
const MOST_GROWTH: f64 = 8.0;
const MOST_SHRINKAGE: f64 = 0.5;

/// The pace at which one picture is drawn. All submissions of a picture that is never given up are as large as they can be.
#[derive(Debug)]
pub(crate) struct Pace {
    until: Option<Instant>,
    pixels: Cell<u32>,
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
    /// For a picture that is given up at some time; `None` never.
    pub(crate) fn new(until: Option<Instant>) -> Self {
        Self { until, pixels: Cell::new(FIRST_PIXELS), in_flight: RefCell::default() }
    }

    /// When the picture is given up.
    pub(crate) fn until(&self) -> Option<Instant> {
        self.until
    }

    /// How many pixels the next submission should have at most.
    pub(crate) fn pixels(&self) -> u32 {
        if self.until.is_some() { self.pixels.get() } else { u32::MAX }
    }

    /// Tells of a submission with so many pixels.
    ///
    /// # Errors
    /// [`GpuError::TooLong`] if the picture is given up, or if the device fails.
    pub(crate) fn submitted(&self, gpu: &Gpu, submission: wgpu::SubmissionIndex, pixels: u32) -> Result<(), GpuError> {
        let Some(until) = self.until else { return Ok(()) };
        let mut next = InFlight { submission, pixels, begun: Instant::now() };
        if let Some(before) = self.in_flight.take() {
            gpu.wait(before.submission)?;
            let done = Instant::now();
            if done >= until {
                return Err(GpuError::TooLong);
            }
            let allowed = LEAST_TIME.max((until - done) / PART_OF_REST);
            let taken = (done - before.begun).max(Duration::from_micros(1));
            let growth = (allowed.as_secs_f64() / taken.as_secs_f64()).clamp(MOST_SHRINKAGE, MOST_GROWTH);
            self.pixels.set((f64::from(before.pixels) * growth) as u32);
            next.begun = done;
        }
        self.in_flight.replace(Some(next));
        Ok(())
    }
}
