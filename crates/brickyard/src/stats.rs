//! Statistics of a rendering, as written by `--stats`.

use crate::memory::ProcessMemory;
use crate::session::Session;
use brickyard_objects::{Traffic, traffic};
use brickyard_pager::Status;
use serde::Serialize;
use std::time::Instant;

/// Statistics of one run of the command `render`, or of [`Session::render`].
#[derive(Clone, Debug, Default, Serialize)]
pub struct RenderStats {
    /// Description of the backend in one line: the adapter or the CPU.
    pub adapter: String,
    /// The backend's name: `gpu` or `cpu`.
    pub backend: &'static str,
    /// The compositor's name: `sorted`, `raycast`, `compute` or `reference`.
    pub compositor: &'static str,
    /// Number of settled pictures drawn.
    pub frames: usize,
    /// Time to draw a settled frame, milliseconds.
    pub frame_ms: Percentiles,
    /// From the start of the command's work (opening the store) to the first complete picture, milliseconds.
    pub first_image_ms: f64,
    /// Part of it that drawing took, once all was here, milliseconds.
    pub first_draw_ms: f64,
    /// From the start of the command's work to the first settled picture, milliseconds.
    pub settled_ms: f64,
    /// Requests and bytes of stores at addresses until the bricks of the first complete picture were here.
    pub first_image_fetched: Fetched,
    /// Requests and bytes of stores at addresses in the whole process.
    pub fetched: Fetched,
    /// Highest accounted bytes of the backend.
    pub gpu_bytes_peak: u64,
    /// Bytes requested by the backend, including any refused by the device.
    pub gpu_bytes_asked: u64,
    /// Highest accounted bytes of decoded bricks, staging and scratch.
    pub host_bytes_peak: u64,
    /// Highest resident set of the process, mapped files included, bytes.
    pub rss_peak: u64,
    /// Highest anonymous memory of the process at any recording, bytes.
    pub anonymous_peak: u64,
    /// Counts of bricks, of the last frame or of the whole run.
    pub bricks: BrickCounts,
    /// Bytes read, decoded and uploaded in the whole run.
    pub bytes: ByteCounts,
    /// Share of the picture, by area, drawn at the wanted level; 1 when settled without failures.
    pub completeness: f64,
    /// Size in pixels of the largest projected voxel among those with a finer level left; 0 if there are none. `None`
    /// (`null` in JSON) if the eye is inside such a brick, where there is no bound, and for the reference compositor.
    pub effective_pixel_error: Option<f64>,
    /// Requested pixel error, pixels.
    pub pixel_error: f64,
    /// Number of passes of the last picture; `None` unless it was exact and drawn in passes.
    pub passes: Option<usize>,
    /// Number of tiles of the last picture; `None` unless it was exact and drawn in tiles.
    pub tiles: Option<usize>,
    /// Number of losses of the GPU device.
    pub device_losses: u32,
    /// Whether the budget, not the view, ended the refinement.
    pub memory_bound: bool,
    /// Number of cells of the last picture drawn from each level, finest first. Filled by the command and by exact
    /// pictures in passes, otherwise empty.
    pub level_cells: Vec<usize>,
}

/// Counts of a process at addresses.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Fetched {
    /// Requests, failed ones too.
    pub requests: u64,
    /// Bytes of answers.
    pub bytes: u64,
    /// Failed requests, made again or given up.
    pub failures: u64,
    /// Requests ended before their answer was whole, for nobody waited for it any more.
    pub cancelled: u64,
}

impl Fetched {
    /// The counts now.
    pub fn now() -> Self {
        let Traffic { requests, bytes, failures, cancelled, .. } = traffic();
        Self { requests, bytes, failures, cancelled }
    }
}

/// The middle and the tail of a list of times.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Percentiles {
    /// Median, the 50th percentile.
    pub p50: f64,
    /// 95th percentile.
    pub p95: f64,
    /// 99th percentile.
    pub p99: f64,
}

impl Percentiles {
    /// Computes the nearest-rank percentiles of a list; zeros for an empty one.
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

/// Returns the milliseconds since an instant.
pub fn ms(since: Instant) -> f64 {
    since.elapsed().as_secs_f64() * 1e3
}

/// Counts of bricks.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct BrickCounts {
    /// Bricks wanted by the last view.
    pub wanted: u64,
    /// Wanted bricks in slots.
    pub resident: u64,
    /// Bricks uploaded in the whole run, with repeats.
    pub uploaded: u64,
    /// Uploads of recently evicted bricks; as many evicted bricks are remembered as there are slots.
    pub reuploaded: u64,
    /// Unreadable wanted bricks.
    pub failed: u64,
    /// Unreadable bricks and stored aprons in the whole run, whether wanted themselves or for a neighbour's apron.
    pub unreadable: u64,
}

/// Counts of bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct ByteCounts {
    /// Encoded bytes read from the store's files, whether from disk or from the page cache.
    pub read: u64,
    /// Decoded bytes of voxels.
    pub decoded: u64,
    /// Bytes of padded bricks handed to the backend.
    pub uploaded: u64,
}

impl RenderStats {
    /// Records the backend and the compositor of a session.
    pub fn describe(&mut self, session: &Session) {
        self.adapter = session.backend_line().into();
        if let Some(backend) = session.backend() {
            (self.backend, self.compositor) = (backend.name(), backend.compositor());
            self.gpu_bytes_asked = backend.asked_bytes();
        }
    }

    /// Records a pager's status, the backend's bytes, and the process's memory as counted by the kernel.
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
        self.fetched = Fetched::now();
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
