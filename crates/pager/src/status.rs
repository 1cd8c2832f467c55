//! Progress of views: wanted and present bricks, and costs.

use crate::source::BrickError;

/// Progress and costs of a pager's views.
#[derive(Clone, Debug)]
pub struct Status {
    /// Cells visible to the views, except those known to be hidden.
    pub wanted: usize,
    /// Wanted cells drawn with their own brick, at the view's level.
    pub resident: usize,
    /// Wanted cells whose own brick remained unreadable after the last try: an ancestor is drawn instead.
    pub failed: usize,
    /// Whether nothing more will come: every wanted cell of the views' own cuts is resident, or has failed with its stand-in resident; no
    /// brick fades in; and feedback, if given, on such a frame has changed nothing.
    pub settled: bool,
    /// Whether nothing more will come before feedback on this frame: see [`Pager::feedback`](crate::Pager::feedback).
    pub awaits_feedback: bool,
    /// Whether every wanted cell is drawn with some brick. False only before a volume's coarsest bricks arrive, when nothing is drawn, or
    /// with `error`.
    pub covered: bool,
    /// Fraction of the wanted cells' screen area drawn with the cells' own bricks, 0 to 1.
    pub completeness: f64,
    /// Largest screen-space error in pixels among cells coarser than level 0; 0 without any, infinite if the eye is inside one.
    pub effective_error_px: f64,
    /// Requested screen-space error in pixels.
    pub pixel_error: f64,
    /// Whether a cut would be finer with more slots.
    pub memory_bound: bool,
    /// Error behind a cell drawn with nothing, now and later, as neither its brick nor any ancestor can be read; one of them if there are
    /// several.
    pub error: Option<BrickError>,
    /// Bytes of all slots.
    pub gpu_bytes: u64,
    /// Host memory in use, in bytes.
    pub host_bytes: u64,
    /// Peak host memory so far, in bytes; for several pagers together, an upper bound.
    pub host_bytes_peak: u64,
    /// Totals since the pager's creation.
    pub counters: Counters,
}

impl Status {
    /// Combines this status with another pager's for the same picture.
    pub fn and(&self, other: &Self) -> Self {
        let (a, b) = (self.wanted as f64, other.wanted as f64);
        let completeness = (self.completeness * a + other.completeness * b) / (a + b);
        Self {
            wanted: self.wanted + other.wanted,
            resident: self.resident + other.resident,
            failed: self.failed + other.failed,
            settled: self.settled && other.settled,
            awaits_feedback: self.awaits_feedback || other.awaits_feedback,
            covered: self.covered && other.covered,
            completeness: if a + b > 0.0 { completeness } else { 1.0 },
            effective_error_px: self.effective_error_px.max(other.effective_error_px),
            pixel_error: self.pixel_error,
            memory_bound: self.memory_bound || other.memory_bound,
            error: self.error.clone().or_else(|| other.error.clone()),
            gpu_bytes: self.gpu_bytes + other.gpu_bytes,
            host_bytes: self.host_bytes + other.host_bytes,
            // An upper bound: the peaks need not coincide.
            host_bytes_peak: self.host_bytes_peak + other.host_bytes_peak,
            counters: self.counters.and(&other.counters),
        }
    }
}

/// Progress of a coming view: whether it can be shown when its time comes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Readiness {
    /// Wanted cells of the view; 0 while unknown.
    pub wanted: usize,
    /// Whether `wanted` refers to the view's own pixel error.
    pub is_planned: bool,
    /// Bricks still missing.
    pub missing: usize,
    /// Whether something can be drawn in every cell, or the view is whole.
    pub is_covered: bool,
    /// Whether every wanted brick is resident, or has failed with its stand-in resident.
    pub is_whole: bool,
}

impl Readiness {
    /// Combines this readiness with another pager's for the same view.
    pub fn and(self, other: Self) -> Self {
        Self {
            wanted: self.wanted + other.wanted,
            is_planned: self.is_planned && other.is_planned,
            missing: self.missing + other.missing,
            is_covered: self.is_covered && other.is_covered,
            is_whole: self.is_whole && other.is_whole,
        }
    }
}

/// Totals since the pager's creation.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Cores decoded, repeats included.
    pub decoded: u64,
    /// Encoded bytes read by the sources for cores and stored aprons, including reads for other users of a source.
    pub bytes_read: u64,
    /// Bytes of decoded voxels, stored aprons included.
    pub bytes_decoded: u64,
    /// Unreadable bricks, whether wanted for themselves or for a neighbour's apron, and unreadable stored aprons; each counts once.
    pub failed: u64,
    /// Bricks uploaded, repeats included.
    pub uploaded: u64,
    /// Uploads of recently evicted bricks (as many evictions are remembered as there are slots): a measure of thrashing.
    pub reuploaded: u64,
    /// Uploads of prefetched bricks, not yet wanted by any view.
    pub uploaded_ahead: u64,
    /// Bytes uploaded to slots.
    pub bytes_uploaded: u64,
    /// Bricks neither read nor uploaded, as a slot held the same voxels of another time step.
    pub shared: u64,
}

impl Counters {
    /// The sum of these counts and another pager's.
    pub fn and(&self, other: &Self) -> Self {
        Self {
            decoded: self.decoded + other.decoded,
            bytes_read: self.bytes_read + other.bytes_read,
            bytes_decoded: self.bytes_decoded + other.bytes_decoded,
            failed: self.failed + other.failed,
            uploaded: self.uploaded + other.uploaded,
            reuploaded: self.reuploaded + other.reuploaded,
            uploaded_ahead: self.uploaded_ahead + other.uploaded_ahead,
            bytes_uploaded: self.bytes_uploaded + other.bytes_uploaded,
            shared: self.shared + other.shared,
        }
    }
}
