//! Upload governor: the bytes that a frame may upload.
//!
//! A frame has a limit in bytes and a goal in time. The governor estimates the cost of a byte from reported upload times, and limits the
//! bytes to meet the goal. The cost is the median of the last few measurements, robust against single interruptions: only repeated slow
//! uploads count.

use std::collections::VecDeque;
use std::time::Duration;

/// Limits on one frame's uploads. A frame's first brick is always within them; only [`Pager::limit_uploads`](crate::Pager::limit_uploads)
/// can hold it back.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct UploadLimits {
    /// Most bytes per frame; proportionally more for frames longer than [`Self::FRAME`].
    pub bytes: u64,
    /// Time that uploads may add to a frame, as reported to [`Pager::uploads_took`](crate::Pager::uploads_took); an eighth of the time
    /// between frames if that is more, since uploads are not the cause of such slow frames.
    pub time: Duration,
}

impl UploadLimits {
    /// Time between frames for which the limits are meant.
    pub const FRAME: Duration = Duration::from_millis(16);
}

const MEASUREMENTS: usize = 5;

#[derive(Debug)]
pub(crate) struct Governor {
    limits: Option<UploadLimits>,
    /// Seconds per byte in the last frames with uploads.
    costs: VecDeque<f64>,
    /// Bytes of the last frame, until its upload time is reported.
    unmeasured: u64,
}

impl Governor {
    /// Governor for these limits; `None` allows everything.
    pub(crate) fn new(limits: Option<UploadLimits>) -> Self {
        Self { limits, costs: VecDeque::new(), unmeasured: 0 }
    }

    /// Bytes that a frame may upload, given the time since the last one; `None` for no limit. During playback frames wait for uploads,
    /// which may take half of the time between frames, whatever their bytes.
    pub(crate) fn bytes(&self, since_last: Duration, is_playing: bool) -> Option<u64> {
        let UploadLimits { bytes, time } = self.limits?;
        let frames = since_last.as_secs_f64() / UploadLimits::FRAME.as_secs_f64();
        let bytes = if is_playing { u64::MAX } else { (bytes as f64 * frames.max(1.0)) as u64 };
        let share = if is_playing { since_last / 2 } else { since_last / 8 };
        let mut costs: Vec<f64> = self.costs.iter().copied().collect();
        costs.sort_by(f64::total_cmp);
        let affordable = |cost: &f64| time.max(share).as_secs_f64() / cost;
        // Saturates.
        Some(bytes.min(costs.get(costs.len() / 2).map_or(f64::INFINITY, affordable) as u64))
    }

    pub(crate) fn spent(&mut self, bytes: u64) {
        self.unmeasured = bytes;
    }

    pub(crate) fn took(&mut self, time: Duration) {
        let bytes = std::mem::take(&mut self.unmeasured);
        if bytes == 0 {
            return;
        }
        self.costs.push_back(time.as_secs_f64() / bytes as f64);
        if self.costs.len() > MEASUREMENTS {
            self.costs.pop_front();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LIMITS: UploadLimits = UploadLimits { bytes: 8 << 20, time: Duration::from_millis(4) };
    const FRAME: Duration = Duration::from_millis(16);

    /// Runs frames on a machine uploading `rate` bytes per second, with bricks of 300,000 bytes. Returns their upload times in seconds.
    fn frames(governor: &mut Governor, count: usize, rate: f64) -> Vec<f64> {
        let brick = 300_000;
        let frame = |_| {
            let bytes = (governor.bytes(FRAME, false).unwrap() / brick).max(1) * brick;
            let seconds = bytes as f64 / rate;
            governor.spent(bytes);
            governor.took(Duration::from_secs_f64(seconds));
            seconds
        };
        (0..count).map(frame).collect()
    }

    #[test]
    fn the_time_goal_is_met_whatever_the_machine() {
        let mut governor = Governor::new(Some(LIMITS));
        // At 10 GB/s the byte limit decides, at 500 MB/s the time; at 10 MB/s one brick, 30 ms, exceeds the goal.
        assert!(frames(&mut governor, 20, 10e9).iter().all(|&s| s < 0.001));
        assert_eq!(governor.bytes(FRAME, false), Some(LIMITS.bytes));
        let slow = frames(&mut governor, 20, 500e6);
        // A change takes effect once it is the median of five.
        assert!(slow[..3].iter().all(|&s| s > 0.004), "{slow:?}");
        assert!(slow[3..].iter().all(|&s| s > 0.003 && s < 0.004 + 1e-9), "{slow:?}");
        assert!(frames(&mut governor, 20, 10e6)[3..].iter().all(|&s| s == 0.03));
        frames(&mut governor, 3, 10e9);
        assert_eq!(governor.bytes(FRAME, false), Some(LIMITS.bytes));
        // One or two interruptions have no effect.
        frames(&mut governor, 2, 1e6);
        assert_eq!(governor.bytes(FRAME, false), Some(LIMITS.bytes));
    }

    #[test]
    fn slow_frames_leave_time_for_more() {
        let mut governor = Governor::new(Some(LIMITS));
        frames(&mut governor, 5, 100e6);
        let bytes = |millis| governor.bytes(Duration::from_millis(millis), false).unwrap();
        // 4 ms, 4 ms and 20 ms at 100 MB/s; rounded down from a measured cost.
        assert!([(0, 400_000), (30, 400_000), (160, 2_000_000)].iter().all(|&(ms, b)| bytes(ms).abs_diff(b) <= 1));
    }

    #[test]
    fn without_limits_or_measurements_nothing_is_held_back() {
        let mut unlimited = Governor::new(None);
        unlimited.spent(100);
        unlimited.took(Duration::from_secs(9));
        assert_eq!(unlimited.bytes(FRAME, false), None);
        let mut governor = Governor::new(Some(LIMITS));
        governor.took(Duration::from_secs(9));
        assert_eq!(governor.bytes(FRAME, false), Some(LIMITS.bytes));
    }
}
