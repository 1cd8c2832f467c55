//! What `--stats` writes: how a rendering went, in numbers.

use crate::memory::ProcessMemory;
use crate::session::Session;
use brickyard_pager::Status;
use serde::Serialize;
use std::time::Instant;

/// Statistics of one run of `render`.
#[derive(Clone, Debug, Default, Serialize)]
pub struct RenderStats {
    /// The backend in words: adapter or processor.
    pub adapter: String,
    /// `gpu` or `cpu`.
    pub backend: &'static str,
    /// `sorted`, `raycast` or `reference`.
    pub compositor: &'static str,
    /// Settled pictures written.
    pub frames: usize,
    /// Time to draw a settled frame, milliseconds.
    pub frame_ms: Percentiles,
    /// From the start of the command's work (opening the store) to the first complete picture, milliseconds.
    pub first_image_ms: f64,
    /// From the start to the first settled picture, milliseconds.
    pub settled_ms: f64,
    /// Highest accounted bytes of the backend.
    pub gpu_bytes_peak: u64,
    /// What that would have been, had the device not refused some of it.
    pub gpu_bytes_asked: u64,
    /// Highest accounted bytes of decoded bricks, staging and scratch.
    pub host_bytes_peak: u64,
    /// Highest resident set of the process, mapped files included.
    pub rss_peak: u64,
    /// Highest anonymous memory seen.
    pub anonymous_peak: u64,
    /// Bricks of the last frame and of the whole run.
    pub bricks: BrickCounts,
    /// Bytes of the whole run.
    pub bytes: ByteCounts,
    /// Share of the picture, by area, drawn at the level that the view wants; 1 when settled without failures.
    pub completeness: f64,
    /// The largest projected voxel, pixels, among those that a finer level could improve; 0 if there are none. No number
    /// (`null` in JSON) if the eye is inside such a brick, where there is no bound, and of the reference compositor.
    pub effective_pixel_error: Option<f64>,
    /// What was asked for, pixels.
    pub pixel_error: f64,
    /// Passes of the last picture, if it was asked to be exact and drawn in passes.
    pub passes: Option<usize>,
    /// Tiles of the last picture, if it was asked to be exact and drawn in tiles.
    pub tiles: Option<usize>,
    /// How many times the GPU was lost and started anew.
    pub device_losses: u32,
    /// Whether the budget, not the view, ended the refinement.
    pub memory_bound: bool,
    /// How many cells of the last frame were drawn from each level, finest first.
    pub level_cells: Vec<usize>,
}

/// The middle and the tail of a list of times.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Percentiles {
    /// Median.
    pub p50: f64,
    /// 95th percentile.
    pub p95: f64,
    /// 99th percentile.
    pub p99: f64,
}

impl Percentiles {
    /// Nearest-rank percentiles; zeros for an empty list.
    pub fn of(values: &[f64]) -> Self {
        let mut sorted = values.to_vec();
        sorted.sort_by(f64::total_cmp);
        let at = |p: f64| match sorted.len() {
            0 => 0.0,
            n => sorted[((p * n as f64).ceil() as usize).clamp(1, n) - 1],
        };
        Self { p50: at(0.50), p95: at(0.95), p99: at(0.99) }
    }
}

/// Milliseconds since then.
pub fn ms(since: Instant) -> f64 {
    since.elapsed().as_secs_f64() * 1e3
}

/// Counts of bricks.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct BrickCounts {
    /// Wanted by the last view.
    pub wanted: u64,
    /// Wanted bricks that are resident.
    pub resident: u64,
    /// Uploads of the whole run.
    pub uploaded: u64,
    /// Uploads of bricks that had been uploaded before.
    pub reuploaded: u64,
    /// Wanted bricks that could not be read.
    pub failed: u64,
    /// Bricks and stored aprons that could not be read, wanted for themselves or for what borders on them, over the whole run.
    pub unreadable: u64,
}

/// Counts of bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct ByteCounts {
    /// Encoded bricks from the store's files, whether the disk or the page cache had them.
    pub read: u64,
    /// Decoded voxels.
    pub decoded: u64,
    /// Padded bricks handed to the backend.
    pub uploaded: u64,
}

impl RenderStats {
    /// Takes over what draws in a session.
    pub fn describe(&mut self, session: &Session) {
        self.adapter = session.backend_line().into();
        if let Some(backend) = session.backend() {
            (self.backend, self.compositor) = (backend.name(), backend.compositor());
            self.gpu_bytes_asked = backend.asked_bytes();
        }
    }

    /// Takes over what the pager reports and what the kernel counts.
    pub fn record(&mut self, status: &Status, gpu_bytes: u64) {
        let memory = ProcessMemory::now();
        self.gpu_bytes_peak = self.gpu_bytes_peak.max(gpu_bytes);
        self.host_bytes_peak = self.host_bytes_peak.max(status.host_bytes_peak);
        self.rss_peak = memory.resident_peak_bytes;
        self.anonymous_peak = self.anonymous_peak.max(memory.anonymous_bytes);
        self.bricks = BrickCounts {
            wanted: status.wanted as u64,
            resident: status.resident as u64,
            uploaded: status.counters.uploaded,
            reuploaded: status.counters.reuploaded,
            failed: status.failed as u64,
            unreadable: status.counters.failed,
        };
        self.bytes = ByteCounts {
            read: status.counters.bytes_read,
            decoded: status.counters.bytes_decoded,
            uploaded: status.counters.bytes_uploaded,
        };
        self.completeness = status.completeness;
        self.effective_pixel_error = Some(status.effective_error_px).filter(|error| error.is_finite());
        self.pixel_error = status.pixel_error;
        self.memory_bound = status.memory_bound;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percentiles_are_nearest_rank() {
        let values: Vec<f64> = (1..=100).rev().map(f64::from).collect();
        assert_eq!(Percentiles::of(&values), Percentiles { p50: 50.0, p95: 95.0, p99: 99.0 });
        assert_eq!(Percentiles::of(&[7.0]), Percentiles { p50: 7.0, p95: 7.0, p99: 7.0 });
        assert_eq!(Percentiles::of(&[]), Percentiles::default());
    }
}
