//! The upload governor: how many bytes a frame may upload.
//!
//! A frame has a limit in bytes and a goal in time. Who carries the uploads out says how long they took; from that the cost of a
//! byte is followed, and the bytes are cut so that the goal is met. The cost is the median of the last few measurements: a
//! thread that was interrupted once says nothing about uploads, and one that is slow three times does.

use std::collections::VecDeque;
use std::time::Duration;

/// Limits for one frame's uploads. A frame's first brick is always within them; only
/// [`Pager::limit_uploads`](crate::Pager::limit_uploads) can hold it back.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct UploadLimits {
    /// The most bytes per frame; in proportion more where frames take longer than [`Self::FRAME`].
    pub bytes: u64,
    /// The time that uploads may add to a frame, measured by what [`Pager::uploads_took`](crate::Pager::uploads_took) is told. An eighth of
    /// the time between frames is allowed where that is more: where frames are slow, uploads are not what makes them so.
    pub time: Duration,
}

impl UploadLimits {
    /// The time between frames for which the limits are meant.
    pub const FRAME: Duration = Duration::from_millis(16);
}

/// Measurements whose median is believed.
const MEASUREMENTS: usize = 5;

#[derive(Debug)]
pub(crate) struct Governor {
    limits: Option<UploadLimits>,
    /// Seconds that a byte took in the last frames that had uploads.
    costs: VecDeque<f64>,
    /// Bytes of the last frame, until somebody says what they took.
    unmeasured: u64,
}

impl Governor {
    /// A governor for these limits; with `None` everything is allowed.
    pub(crate) fn new(limits: Option<UploadLimits>) -> Self {
        Self { limits, costs: VecDeque::new(), unmeasured: 0 }
    }

    /// The bytes that a frame may upload, given the time since the last one; `None` if there is no limit. While time steps are played, frames
    /// wait for uploads: then what half of the time between frames can carry is allowed, however many bytes that is.
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

    /// Takes note of how many bytes a frame has handed out.
    pub(crate) fn spent(&mut self, bytes: u64) {
        self.unmeasured = bytes;
    }

    /// Takes note of how long the last frame's uploads took.
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

    /// Runs frames on a machine that uploads so many bytes a second, with bricks of 300,000 bytes. What each frame took.
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
        // 10 GB/s: the limit in bytes decides. 500 MB/s: the time. 10 MB/s: one brick, 30 ms, is more than the goal.
        assert!(frames(&mut governor, 20, 10e9).iter().all(|&s| s < 0.001));
        assert_eq!(governor.bytes(FRAME, false), Some(LIMITS.bytes));
        let slow = frames(&mut governor, 20, 500e6);
        // A change is believed once it is the middle one of five.
        assert!(slow[..3].iter().all(|&s| s > 0.004), "{slow:?}");
        assert!(slow[3..].iter().all(|&s| s > 0.003 && s < 0.004 + 1e-9), "{slow:?}");
        assert!(frames(&mut governor, 20, 10e6)[3..].iter().all(|&s| s == 0.03));
        frames(&mut governor, 3, 10e9);
        assert_eq!(governor.bytes(FRAME, false), Some(LIMITS.bytes));
        // One interruption, or two, is nothing.
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
