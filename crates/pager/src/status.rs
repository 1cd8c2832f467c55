//! How far views are: what is wanted, what is there, and what it has cost.

use crate::source::BrickError;

/// How far the views of a pager's volumes are, and what they have cost.
#[derive(Clone, Debug)]
pub struct Status {
    /// The number of cells that the views see, without those that are known to be hidden.
    pub wanted: usize,
    /// The number of wanted cells that are drawn with their own brick, at the level that the view wants.
    pub resident: usize,
    /// The number of wanted cells whose own brick could not be read, not even at the last try: an ancestor is drawn instead.
    pub failed: usize,
    /// Whether nothing more will come: every cell that the views' own cuts want is resident, or has failed and its stand-in is resident; no
    /// brick fades in any more; and, where feedback is given, the feedback about such a frame has changed nothing.
    pub settled: bool,
    /// Whether nothing more will come before the pager is told what was seen of this frame: see [`Pager::feedback`](crate::Pager::feedback).
    pub awaits_feedback: bool,
    /// Whether every wanted cell is drawn with some brick. False only before a volume's coarsest bricks have arrived, when nothing is
    /// drawn, or with `error`.
    pub covered: bool,
    /// The share of the wanted cells' screen area that is drawn with the cells' own bricks, 0 to 1.
    pub completeness: f64,
    /// The largest screen-space error, in pixels, among cells that a finer level could improve; 0 if there are none, infinite where the eye
    /// is inside one.
    pub effective_error_px: f64,
    /// The screen-space error that was asked for, in pixels.
    pub pixel_error: f64,
    /// Whether a cut would be finer with more slots.
    pub memory_bound: bool,
    /// Why a cell is drawn with nothing, now and later: neither its brick nor any ancestor can be read. If there are several
    /// such cells, this is the reason for one of them; `None` if there are none.
    pub error: Option<BrickError>,
    /// Bytes of all slots together.
    pub gpu_bytes: u64,
    /// Bytes of host memory in use.
    pub host_bytes: u64,
    /// The most bytes of host memory that have been in use so far; for several pagers together, an upper bound.
    pub host_bytes_peak: u64,
    /// Totals since the pager was made.
    pub counters: Counters,
}

impl Status {
    /// Combines this status with the status of another pager for the same picture.
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
            // At most: they need not have come at the same time.
            host_bytes_peak: self.host_bytes_peak + other.host_bytes_peak,
            counters: self.counters.and(&other.counters),
        }
    }
}

/// How far a view is that comes next: whether it can be shown when its time comes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Readiness {
    /// The number of cells that the view wants; 0 while that is not known.
    pub wanted: usize,
    /// Whether `wanted` is of the view's own pixel error.
    pub is_planned: bool,
    /// The number of bricks that are still to come.
    pub missing: usize,
    /// Whether something can be drawn in every cell, or the view is whole.
    pub is_covered: bool,
    /// Whether every brick that the view wants is resident, or has failed and its stand-in is resident.
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

/// Totals since the pager was made.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Cores decoded, with repeats.
    pub decoded: u64,
    /// Encoded bytes that the sources have read for cores and stored aprons, those read for other users of a source included.
    pub bytes_read: u64,
    /// Bytes of decoded voxels, those of stored aprons included.
    pub bytes_decoded: u64,
    /// Bricks that could not be read, whether wanted for themselves or for a neighbour's apron, and stored aprons that could not be read;
    /// each is counted once.
    pub failed: u64,
    /// Bricks uploaded, with repeats.
    pub uploaded: u64,
    /// Uploads of bricks that had been evicted not long before (as many evictions as there are slots are remembered): a measure of thrashing.
    pub reuploaded: u64,
    /// Uploads of bricks fetched ahead, which no view wanted yet.
    pub uploaded_ahead: u64,
    /// Bytes uploaded to slots.
    pub bytes_uploaded: u64,
    /// Bricks that were neither read nor uploaded, since a slot held the same voxels of another time step.
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
