//! Pace of a window's frames: the time of each on the window's thread, with drawing apart, for files of statistics. Costs a few numbers per frame,
//! for the last hundred thousand at most.

use crate::canvas::{Answer, FrameTimes, keep_last};
use brickyard::stats::Percentiles;
use serde::Serialize;
use std::collections::VecDeque;
use std::time::{Duration, Instant};

/// Most frames kept.
const MOST: usize = 100_000;

/// A frame with a drawn picture.
#[derive(Clone, Copy, Debug)]
struct Drawn {
    at: Instant,
    /// Milliseconds on the window's thread without drawing, and in drawing.
    blocked_ms: f64,
    draw_ms: f64,
    /// The share of the exact picture's work.
    quality: f64,
}

/// Number of times between frames kept: the least is free of waits for the display or the user.
const TIMES_BETWEEN: usize = 8;

/// Times of a window's frames.
#[derive(Default)]
pub(crate) struct Pacing {
    /// End of the last frame's work, if the next one was to follow at once.
    ended: Option<Instant>,
    between: VecDeque<Duration>,
    first: Option<Instant>,
    drawn: VecDeque<Drawn>,
    /// Time of each frame, with or without a picture, on the window's thread without drawing.
    blocked_ms: VecDeque<f64>,
    /// Times from changes to their first pictures: of all changes, and of those at rest.
    answers_ms: Vec<f64>,
    first_answers_ms: Vec<f64>,
    blocked_most_ms: f64,
    frames: u64,
}

/// Statistics of a window's frames, as written.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct PacingStats {
    /// Milliseconds from opening the volumes to the first picture, if any.
    first_picture_ms: Option<f64>,
    /// Number of frames, and of those with a drawn picture.
    frames: u64,
    drawn: usize,
    /// Pictures per second while drawing: pauses over a quarter of a second do not count.
    pictures_per_second: f64,
    /// Milliseconds on the window's thread without drawing, of frames with a picture.
    blocked_ms: Percentiles,
    /// Milliseconds on the window's thread without drawing, of all frames: the maximum, and the 99.9th percentile.
    blocked_most_ms: f64,
    blocked_p999_ms: f64,
    /// Milliseconds from a change to the first picture of it or of a later one, and the number of such changes.
    answer_ms: Percentiles,
    answers: usize,
    /// Milliseconds from a change at rest, such as the press at the start of a drag, to its first picture, and the number of such changes.
    first_answer_ms: Percentiles,
    first_answers: usize,
    /// Milliseconds of drawing.
    draw_ms: Percentiles,
    /// The 50th, 5th and 1st percentile of pictures' work, as a share of the exact picture's.
    quality: [f64; 3],
}

impl Pacing {
    pub(crate) fn begin(&mut self) {
        let Some(ended) = self.ended.take() else { return };
        keep_last(&mut self.between, TIMES_BETWEEN, ended.elapsed());
    }

    /// Records the end of a frame's work, and whether the next frame follows at once.
    pub(crate) fn end(&mut self, goes_on: bool) {
        self.ended = goes_on.then(Instant::now);
    }

    /// The window's own time between the work of two frames: it is painted, and put on the display.
    pub(crate) fn between(&self) -> Duration {
        self.between.iter().min().copied().unwrap_or_default()
    }

    /// Records a frame: its time `took` on the window's thread, the part `spent` on pictures there or beside it, and their least quality.
    pub(crate) fn note(&mut self, took: Duration, spent: FrameTimes, quality: f64) {
        let ms = |time: Duration| time.as_secs_f64() * 1e3;
        let blocked_ms = ms(took.saturating_sub(spent.draw + spent.waited));
        self.frames += 1;
        self.blocked_most_ms = self.blocked_most_ms.max(blocked_ms);
        keep_last(&mut self.blocked_ms, MOST, blocked_ms);
        if spent.drawing().is_zero() {
            return;
        }
        let at = Instant::now();
        self.first.get_or_insert(at);
        keep_last(&mut self.drawn, MOST, Drawn { at, blocked_ms, draw_ms: ms(spent.drawing()), quality });
    }

    /// Records times from changes to their first pictures.
    pub(crate) fn answered(&mut self, answers: impl IntoIterator<Item = Answer>) {
        let room = MOST - self.answers_ms.len();
        for Answer { took, is_first } in answers.into_iter().take(room) {
            let ms = took.as_secs_f64() * 1e3;
            self.answers_ms.push(ms);
            if is_first {
                self.first_answers_ms.push(ms);
            }
        }
    }

    /// The statistics of a window whose volumes were opened at this time.
    pub(crate) fn stats(&self, opened: Instant) -> PacingStats {
        let of = |value: fn(&Drawn) -> f64| self.drawn.iter().map(value).collect::<Vec<_>>();
        let gaps = self.drawn.iter().zip(self.drawn.iter().skip(1)).map(|(a, b)| (b.at - a.at).as_secs_f64());
        let (mut count, mut seconds) = (0, 0.0);
        for gap in gaps.filter(|gap| *gap < 0.25) {
            (count, seconds) = (count + 1, seconds + gap);
        }
        let lacking = Percentiles::of(&of(|drawn| -drawn.quality));
        PacingStats {
            first_picture_ms: self.first.map(|first| (first - opened).as_secs_f64() * 1e3),
            frames: self.frames,
            drawn: self.drawn.len(),
            pictures_per_second: if count > 0 { f64::from(count) / seconds } else { 0.0 },
            blocked_ms: Percentiles::of(&of(|drawn| drawn.blocked_ms)),
            blocked_most_ms: self.blocked_most_ms,
            blocked_p999_ms: self.all_but_one_of_a_thousand(),
            answer_ms: Percentiles::of(&self.answers_ms),
            answers: self.answers_ms.len(),
            first_answer_ms: Percentiles::of(&self.first_answers_ms),
            first_answers: self.first_answers_ms.len(),
            draw_ms: Percentiles::of(&of(|drawn| drawn.draw_ms)),
            quality: [-lacking.p50, -lacking.p95, -lacking.p99],
        }
    }

    /// The 99.9th percentile of time on the window's thread without drawing, in milliseconds.
    fn all_but_one_of_a_thousand(&self) -> f64 {
        let mut sorted: Vec<f64> = self.blocked_ms.iter().copied().collect();
        sorted.sort_by(f64::total_cmp);
        sorted.get((sorted.len() * 999).div_ceil(1000).saturating_sub(1)).copied().unwrap_or_default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_least_time_between_frames_counts() {
        let mut pacing = Pacing::default();
        assert_eq!(pacing.between(), Duration::ZERO);
        for (pause_ms, goes_on) in [(30, true), (3, true), (0, false)] {
            pacing.end(goes_on);
            std::thread::sleep(Duration::from_millis(pause_ms));
            pacing.begin();
        }
        assert!((3..30).contains(&pacing.between().as_millis()), "{:?}", pacing.between());
        // Old times no longer count.
        for _ in 0..TIMES_BETWEEN {
            pacing.end(true);
            std::thread::sleep(Duration::from_millis(31));
            pacing.begin();
        }
        assert!(pacing.between() >= Duration::from_millis(31));
    }

    #[test]
    fn drawing_is_counted_apart() {
        let mut pacing = Pacing::default();
        let ms = Duration::from_millis;
        assert_eq!(pacing.stats(Instant::now()).first_picture_ms, None);
        for quality in [0.5, 0.25, 1.0] {
            pacing.note(ms(12), FrameTimes { step: ms(1), draw: ms(5), beside: ms(5), waited: ms(2) }, quality);
        }
        pacing.note(ms(40), FrameTimes::default(), 1.0);
        pacing.answered([(30, true), (90, false)].map(|(took, is_first)| Answer { took: ms(took), is_first }));
        let stats = pacing.stats(Instant::now());
        assert_eq!((stats.frames, stats.drawn, stats.quality), (4, 3, [0.5, 0.25, 0.25]));
        assert!((stats.blocked_ms.p99 - 5.0).abs() < 1e-9 && (stats.blocked_most_ms - 40.0).abs() < 1e-9);
        assert!((stats.blocked_p999_ms - 40.0).abs() < 1e-9 && (stats.answer_ms.p50 - 30.0).abs() < 1e-9);
        assert_eq!((stats.answers, stats.first_answers, stats.first_answer_ms.p99), (2, 1, 30.0));
        assert!((stats.draw_ms.p50 - 10.0).abs() < 1e-9 && stats.first_picture_ms.is_some());
    }
}
