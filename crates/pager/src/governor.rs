//! The upload governor: how many bytes a frame may upload.
//!
//! A frame has a limit in bytes and a goal in time. Who carries the uploads out says how long they took; from that the cost of a
//! byte is followed, and the bytes are cut so that the goal is met. Dearer bytes are believed at once, cheaper ones slowly:
//! one slow frame is noticed, one fast frame is not luck to count on. Costs nothing.

use std::time::Duration;

/// Limits for one frame's uploads, of which there is always at least one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct UploadLimits {
    /// At most so many bytes.
    pub bytes: u64,
    /// What uploads may add to a frame, as far as [`Pager::uploads_took`](crate::Pager::uploads_took) is told.
    pub time: Duration,
}

/// How much of a cheaper measurement is believed.
const TRUST: f64 = 0.125;

#[derive(Debug)]
pub(crate) struct Governor {
    limits: Option<UploadLimits>,
    /// Seconds that a byte takes, as far as is known.
    cost: Option<f64>,
    /// Bytes of the last frame, until somebody says what they took.
    unmeasured: u64,
}

impl Governor {
    /// A governor; without limits everything is allowed.
    pub(crate) fn new(limits: Option<UploadLimits>) -> Self {
        Self { limits, cost: None, unmeasured: 0 }
    }

    /// What a frame may upload, if there is a limit.
    pub(crate) fn bytes(&self) -> Option<u64> {
        let UploadLimits { bytes, time } = self.limits?;
        let affordable = self.cost.map_or(f64::INFINITY, |cost| time.as_secs_f64() / cost);
        // Saturates.
        Some(bytes.min(affordable as u64))
    }

    /// A frame has handed out so many bytes.
    pub(crate) fn spent(&mut self, bytes: u64) {
        self.unmeasured = bytes;
    }

    /// The last frame's uploads took so long.
    pub(crate) fn took(&mut self, time: Duration) {
        let bytes = std::mem::take(&mut self.unmeasured);
        if bytes == 0 {
            return;
        }
        let measured = time.as_secs_f64() / bytes as f64;
        let cost = self
            .cost
            .map_or(measured, |cost| if measured > cost { measured } else { cost + (measured - cost) * TRUST });
        self.cost = Some(cost);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LIMITS: UploadLimits = UploadLimits { bytes: 8 << 20, time: Duration::from_millis(4) };

    /// Runs frames on a machine that uploads so many bytes a second, with bricks of 300,000 bytes. What each frame took.
    fn frames(governor: &mut Governor, count: usize, rate: f64) -> Vec<f64> {
        let brick = 300_000;
        let frame = |_| {
            let bytes = (governor.bytes().unwrap() / brick).max(1) * brick;
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
        assert_eq!(governor.bytes(), Some(LIMITS.bytes));
        let slow = frames(&mut governor, 20, 500e6);
        assert!(slow[0] > 0.004 && slow[1..].iter().all(|&s| s > 0.003 && s < 0.004 + 1e-9), "{slow:?}");
        assert!(frames(&mut governor, 20, 10e6)[1..].iter().all(|&s| s == 0.03));
        // When the machine is fast again, it is found out within a second of frames.
        frames(&mut governor, 60, 10e9);
        assert_eq!(governor.bytes(), Some(LIMITS.bytes));
    }

    #[test]
    fn without_limits_or_measurements_nothing_is_held_back() {
        let mut unlimited = Governor::new(None);
        unlimited.spent(100);
        unlimited.took(Duration::from_secs(9));
        assert_eq!(unlimited.bytes(), None);
        let mut governor = Governor::new(Some(LIMITS));
        governor.took(Duration::from_secs(9));
        assert_eq!(governor.bytes(), Some(LIMITS.bytes));
    }
}
