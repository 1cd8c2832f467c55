//! How far views are: what is wanted, what is there, and what it has cost.

use crate::source::BrickError;

/// How far the views of a pager's volumes are, and what they have cost.
#[derive(Clone, Debug)]
pub struct Status {
    /// Cells that the views see, those aside that are known to be hidden.
    pub wanted: usize,
    /// Cells drawn with their own brick, at the level that the view wants.
    pub resident: usize,
    /// Cells whose own brick cannot be read, nor at the last try: an ancestor stands in.
    pub failed: usize,
    /// Whether nothing more will come: every cell of the view's own cut is resident, or failed with its stand-in resident;
    /// none fades in any more; and, where feedback is given, that of such a frame has changed nothing.
    pub settled: bool,
    /// Whether nothing more will come before it is known what is seen of this frame: see [`Pager::feedback`](crate::Pager::feedback).
    pub awaits_feedback: bool,
    /// Whether every cell is drawn with something. False only before a volume's coarsest bricks have arrived, when nothing is
    /// drawn, or with `error`.
    pub covered: bool,
    /// Share of the screen area of all cells that is drawn with the cells' own bricks, 0 to 1.
    pub completeness: f64,
    /// Largest error, in pixels, among cells that a finer level could improve; 0 if there are none, infinite where the eye
    /// is inside one.
    pub effective_error_px: f64,
    /// The error asked for.
    pub pixel_error: f64,
    /// Whether the cut would be finer with more slots.
    pub memory_bound: bool,
    /// A settled view has cells for which neither their brick nor any ancestor can be read: one of the reasons.
    pub error: Option<BrickError>,
    /// Bytes of all slots.
    pub gpu_bytes: u64,
    /// Bytes of host memory in use.
    pub host_bytes: u64,
    /// The most so far.
    pub host_bytes_peak: u64,
    /// Totals since the pager was made.
    pub counters: Counters,
}

impl Status {
    /// Combines this status with that of another pager, of the same picture.
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

/// Totals since the pager was made.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Cores decoded, with repeats.
    pub decoded: u64,
    /// Encoded bytes that the source has read for them and for stored aprons, and for whoever else uses it.
    pub bytes_read: u64,
    /// Bytes of voxels that came out, those of stored aprons included.
    pub bytes_decoded: u64,
    /// Bricks that could not be read, each counted once, whether wanted for themselves or for a neighbour's apron; and stored
    /// aprons.
    pub failed: u64,
    /// Bricks uploaded, with repeats.
    pub uploaded: u64,
    /// Uploads of bricks among the last evicted ones (as many as there are slots are remembered): a measure of thrash.
    pub reuploaded: u64,
    /// Uploads of bricks that no view wanted yet.
    pub uploaded_ahead: u64,
    /// Bytes uploaded.
    pub bytes_uploaded: u64,
}

impl Counters {
    /// Adds another pager's counts.
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
        }
    }
}
