//! Pace of a picture drawn by a GPU some rows at a time. Each part lasts a few frames of the window, whose own work queues behind it. The next
//! part follows with as many rows as would have fitted. Costs a frame of the window and a thread per part.

use crate::device::Device;
use brickyard::render::wgpu::PollType;
use std::ops::Range;
use std::sync::{Arc, OnceLock};
use std::time::{Duration, Instant};

/// Intended GPU time of a part in frames of the window without it, and its bounds: a starting drag waits for a part, and each part costs a
/// painted frame.
const FRAMES: u32 = 5;
const GOALS: [Duration; 2] = [Duration::from_millis(40), Duration::from_millis(250)];

/// Interval between checks for the end of a part.
const LOOK: Duration = Duration::from_millis(2);

/// Largest growth in rows between parts, as a factor.
const MOST_GROWTH: f64 = 4.0;

/// Least rows in a part.
const LEAST: u32 = 8;

/// Pace of a picture drawn in parts.
pub(super) struct RowPace {
    height: u32,
    begun: Instant,
    next: u32,
    /// Rows in the next part.
    rows: u32,
    /// Intended duration of a part.
    goal: Duration,
    under_way: Option<UnderWay>,
}

/// A submitted part.
struct UnderWay {
    rows: u32,
    begun: Instant,
    done: Arc<OnceLock<Instant>>,
}

impl RowPace {
    /// Paces a picture of `height` rows. A `share` of them should suit a part; frames of the window take `between`.
    pub(super) fn new(height: u32, share: f64, between: Duration) -> Self {
        let [least, most] = GOALS;
        let goal = (FRAMES * between).clamp(least, most);
        Self { height, begun: Instant::now(), next: 0, rows: rows(f64::from(height) * share), goal, under_way: None }
    }

    /// The rows to submit now; none while a part is under way, or after the last.
    pub(super) fn next(&mut self) -> Option<Range<u32>> {
        if let Some(UnderWay { rows: drawn, begun, done }) = &self.under_way {
            let took = done.get()?.duration_since(*begun).max(Duration::from_micros(100));
            let growth = self.goal.as_secs_f64() / took.as_secs_f64();
            self.rows = rows(f64::from(*drawn) * growth.min(MOST_GROWTH));
            self.under_way = None;
        }
        let end = self.height.min(self.next.saturating_add(self.rows));
        (self.next < end).then_some(self.next..end)
    }

    /// Records submitted rows. The window is repainted when they are drawn.
    pub(super) fn submitted(&mut self, rows: &Range<u32>, device: &Device) {
        let done = Arc::<OnceLock<Instant>>::default();
        let told = done.clone();
        device.state.queue.on_submitted_work_done(move || {
            let _ = told.set(Instant::now());
        });
        let (watched, device, egui) = (done.clone(), device.state.device.clone(), device.egui.clone());
        let watch = move || {
            // The device calls back only when polled. The pace holds a reference besides this thread's and the callback's while it waits.
            let is_awaited = || watched.get().is_none() && Arc::strong_count(&watched) > 2;
            while is_awaited() && device.poll(PollType::Poll).is_ok() {
                std::thread::sleep(LOOK);
            }
            egui.request_repaint();
        };
        // Without a thread, the window notices the end a little later, when it polls the device.
        let _ = std::thread::Builder::new().name("part".into()).spawn(watch);
        self.under_way = Some(UnderWay { rows: rows.end - rows.start, begun: Instant::now(), done });
        self.next = rows.end;
    }

    /// Whether a part is under way; the window is repainted after it.
    pub(super) fn is_under_way(&self) -> bool {
        self.under_way.as_ref().is_some_and(|part| part.done.get().is_none())
    }

    /// Share of the picture found fit for one part.
    pub(super) fn fitting(&self) -> f64 {
        f64::from(self.rows) / f64::from(self.height.max(1))
    }

    /// Time since the start.
    pub(super) fn since(&self) -> Duration {
        self.begun.elapsed()
    }

    /// The submitted share of the rows; 1 without rows.
    pub(super) fn share(&self) -> f64 {
        if self.height == 0 { 1.0 } else { f64::from(self.next) / f64::from(self.height) }
    }
}

/// A part's number of rows, near `wanted`.
fn rows(wanted: f64) -> u32 {
    // Whole groups of a compute shader.
    ((wanted as u32) / LEAST).max(1) * LEAST
}

#[cfg(test)]
mod tests {
    use super::*;

    fn draw(pace: &mut RowPace, row_ms: f64) -> Vec<f64> {
        let mut took_ms = Vec::new();
        let mut end = 0;
        while let Some(rows) = pace.next() {
            assert_eq!(rows.start, end, "one after the other");
            let took = f64::from(rows.end - rows.start) * row_ms;
            let (begun, done) = (Instant::now(), Arc::<OnceLock<Instant>>::default());
            pace.under_way = Some(UnderWay { rows: rows.end - rows.start, begun, done: done.clone() });
            pace.next = rows.end;
            if rows.end < pace.height {
                assert!(pace.next().is_none(), "one part at a time");
            }
            let _ = done.set(begun + Duration::from_secs_f64(took / 1e3));
            took_ms.push(took);
            end = rows.end;
        }
        assert_eq!(end, pace.height);
        took_ms
    }

    #[test]
    fn parts_come_to_take_what_they_should() {
        for row_ms in [0.01, 0.2, 2.0] {
            let took_ms = draw(&mut RowPace::new(1000, 0.01, Duration::ZERO), row_ms);
            let goal_ms = GOALS[0].as_secs_f64() * 1e3;
            assert!(took_ms.iter().all(|ms| *ms <= goal_ms.max(row_ms * f64::from(LEAST))), "{row_ms}: {took_ms:?}");
            let most = (1000.0 * row_ms / goal_ms * 1.6) as usize + 5;
            assert!(took_ms.len() <= most, "{row_ms}: {} parts", took_ms.len());
        }
    }
}
