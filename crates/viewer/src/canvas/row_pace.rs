//! Pace of a picture that a GPU draws some rows at a time, each part a few frames of the window long: the window's own work comes after work
//! submitted before. The next part follows once the one before is done, and has the rows that would have fitted. Costs a frame of the
//! window and a thread for each part.

use brickyard::render::wgpu::{self, PollType};
use eframe::egui::Context;
use std::ops::Range;
use std::sync::{Arc, OnceLock};
use std::time::{Duration, Instant};

/// How many times longer a part is to take on the GPU than a frame of the window takes without it, and the bounds of that: a hand that begins to
/// move waits for a part, and a frame is painted for each.
const FRAMES: u32 = 5;
const GOALS: [Duration; 2] = [Duration::from_millis(40), Duration::from_millis(250)];

/// How often it is looked whether a part is done.
const LOOK: Duration = Duration::from_millis(2);

/// How many times more rows a part has than the one before at most.
const MOST_GROWTH: f64 = 4.0;

/// The least rows of a part.
const LEAST: u32 = 8;

/// The parts of a picture.
pub(super) struct RowPace {
    height: u32,
    begun: Instant,
    next: u32,
    /// Rows of the next part.
    rows: u32,
    /// How long a part is to take.
    goal: Duration,
    under_way: Option<UnderWay>,
}

/// A part that has been submitted.
struct UnderWay {
    rows: u32,
    begun: Instant,
    /// When it was done.
    done: Arc<OnceLock<Instant>>,
}

impl RowPace {
    /// For a picture of so many rows, of which a share is taken to be fit for a part; frames of the window take so long besides.
    pub(super) fn new(height: u32, share: f64, between: Duration) -> Self {
        let [least, most] = GOALS;
        let goal = (FRAMES * between).clamp(least, most);
        Self { height, begun: Instant::now(), next: 0, rows: rows(f64::from(height) * share), goal, under_way: None }
    }

    /// The rows that are to be submitted now; none while the part before is under way, and once all are.
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

    /// Takes note that rows have been submitted to a device. The window is painted again when they are drawn.
    pub(super) fn submitted(
        &mut self,
        rows: &Range<u32>,
        (device, queue): (&wgpu::Device, &wgpu::Queue),
        egui: &Context,
    ) {
        let done = Arc::<OnceLock<Instant>>::default();
        let told = done.clone();
        queue.on_submitted_work_done(move || {
            let _ = told.set(Instant::now());
        });
        let (watched, device, egui) = (done.clone(), device.clone(), egui.clone());
        let watch = move || {
            // The device tells when somebody looks at it. Besides this thread and the one who tells, the pace waits for it.
            let is_awaited = || watched.get().is_none() && Arc::strong_count(&watched) > 2;
            while is_awaited() && device.poll(PollType::Poll).is_ok() {
                std::thread::sleep(LOOK);
            }
            egui.request_repaint();
        };
        // Without a thread it is seen a little later, when the window looks at the device.
        let _ = std::thread::Builder::new().name("part".into()).spawn(watch);
        self.under_way = Some(UnderWay { rows: rows.end - rows.start, begun: Instant::now(), done });
        self.next = rows.end;
    }

    /// Whether a part is under way.
    pub(super) fn is_under_way(&self) -> bool {
        self.under_way.as_ref().is_some_and(|part| part.done.get().is_none())
    }

    /// The share of the picture that has turned out to be fit for a part.
    pub(super) fn fitting(&self) -> f64 {
        f64::from(self.rows) / f64::from(self.height.max(1))
    }

    /// Since when the picture is drawn.
    pub(super) fn since(&self) -> Duration {
        self.begun.elapsed()
    }

    /// The share of the rows that are submitted; all of a picture without rows.
    pub(super) fn share(&self) -> f64 {
        if self.height == 0 { 1.0 } else { f64::from(self.next) / f64::from(self.height) }
    }
}

/// A number of rows that is fit for a part.
fn rows(wanted: f64) -> u32 {
    // Whole groups of a compute shader's.
    ((wanted as u32) / LEAST).max(1) * LEAST
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Draws a picture whose rows take so long, and returns how long the parts took.
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
