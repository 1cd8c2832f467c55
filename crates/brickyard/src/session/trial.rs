//! The trial of `sorted` and `raycast` on a hardware GPU, by the first frames of a live session: `sorted` shows them,
//! `raycast` draws each of them as well, unseen, and the one with less GPU time draws all later frames. Which one is
//! faster depends on the GPU, and neither can be known before. Costs a few frames twice their time.

use brickyard_render::{AdapterReport, Compositor};
use std::collections::VecDeque;

/// Frames drawn by both whose times count.
const COUNTED: u32 = 8;
/// Earlier frames: their times include what drivers put off to the first use of a pipeline.
const WARM_UP: u32 = 2;

/// The trial of a device's compositors, and its outcome.
#[derive(Debug, Default)]
pub(crate) struct Trial {
    /// Whether software rasterisers count as hardware: for tests.
    pub(crate) takes_software: bool,
    /// Numbers of the pictures by `raycast`, the oldest first. The next number is the same frame's by `sorted`.
    asked: VecDeque<u64>,
    /// The last heard picture by `raycast` and its time, milliseconds.
    unmatched: Option<(u64, f64)>,
    /// Frames with both times, and the sums of those that count, milliseconds.
    pairs: u32,
    sorted_ms: f64,
    raycast_ms: f64,
}

impl Trial {
    /// Whether a device is tried, or has been, so that its renderers need both compositors.
    pub(crate) fn is_of(&self, adapter: &AdapterReport) -> bool {
        let is_hardware = !adapter.is_software() || self.takes_software;
        adapter.timestamps && is_hardware && self.winner() != Some(Compositor::Raycast)
    }

    /// The faster compositor; `None` while the trial goes on.
    pub(crate) fn winner(&self) -> Option<Compositor> {
        let is_sorted_faster = self.sorted_ms <= self.raycast_ms;
        let winner = if is_sorted_faster { Compositor::Sorted } else { Compositor::Raycast };
        (self.pairs >= WARM_UP + COUNTED).then_some(winner)
    }

    /// Records the number of a picture by `raycast`; `sorted` draws the same frame with the next number.
    pub(crate) fn ask(&mut self, picture: u64) {
        self.asked.push_back(picture);
    }

    /// Records the GPU time of a picture. Times come in the order of the pictures; some may be missing.
    pub(crate) fn hear(&mut self, picture: u64, ms: f64) {
        while self.asked.pop_front_if(|asked| *asked < picture).is_some() {}
        if self.asked.front() == Some(&picture) {
            self.unmatched = Some((picture, ms));
            return;
        }
        let Some((_, raycast_ms)) = self.unmatched.take_if(|(before, _)| *before + 1 == picture) else { return };
        self.pairs += 1;
        if self.pairs > WARM_UP && self.pairs <= WARM_UP + COUNTED {
            self.sorted_ms += ms;
            self.raycast_ms += raycast_ms;
        }
    }

    /// Forgets the pictures of an ended renderer: another one numbers its own from 0 again.
    pub(crate) fn forget_pictures(&mut self) {
        self.asked.clear();
        self.unmatched = None;
    }

    /// The outcome in words, to follow the adapter's name; empty while there is none.
    pub(crate) fn outcome(&self) -> String {
        let (sorted, raycast) = (self.sorted_ms, self.raycast_ms);
        match self.winner() {
            Some(Compositor::Sorted) => format!(": sorted (raycast took {:.2} times as long)", raycast / sorted),
            Some(_) => format!(": raycast (sorted took {:.2} times as long)", sorted / raycast),
            None => String::new(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Times of a frame's two pictures, by number.
    fn frame(trial: &mut Trial, number: u64, raycast_ms: f64, sorted_ms: f64) {
        trial.ask(number);
        trial.hear(number, raycast_ms);
        trial.hear(number + 1, sorted_ms);
    }

    #[test]
    fn the_one_with_less_time_in_total_wins() {
        for (raycast_ms, sorted_ms, winner) in
            [(2.0, 1.0, Compositor::Sorted), (1.0, 2.0, Compositor::Raycast), (1.0, 1.0, Compositor::Sorted)]
        {
            let mut trial = Trial::default();
            for i in 0..u64::from(WARM_UP + COUNTED) {
                assert_eq!((trial.winner(), trial.outcome()), (None, String::new()), "{i}");
                // Long first frames, as while a driver compiles, decide nothing.
                let extra_ms = if i < u64::from(WARM_UP) { 1000.0 } else { 0.0 };
                frame(&mut trial, 2 * i, raycast_ms + extra_ms * sorted_ms, sorted_ms + extra_ms * raycast_ms);
            }
            assert_eq!(trial.winner(), Some(winner));
            assert!(trial.outcome().starts_with(&format!(": {}", winner.name())), "{}", trial.outcome());
            // Later times change nothing.
            frame(&mut trial, 900, 1e6 * raycast_ms, 1e6);
            frame(&mut trial, 902, 1e6, 1e6 * raycast_ms);
            assert_eq!(trial.winner(), Some(winner));
        }
    }

    /// Answers are left out while too many pictures are in flight, and others are of frames drawn once.
    #[test]
    fn only_frames_with_both_times_count() {
        let mut trial = Trial::default();
        for i in 0..100 {
            let number = 10 * i;
            // One of both is missing.
            trial.ask(number);
            trial.hear(if i % 2 == 0 { number } else { number + 1 }, 1.0);
            trial.hear(number + 5, 1.0);
        }
        assert_eq!(trial.pairs, 0);
        // Two frames in flight.
        trial.ask(2000);
        trial.ask(2002);
        (2000..2004).for_each(|picture| trial.hear(picture, 1.0));
        assert_eq!(trial.pairs, 2);
        trial.ask(2004);
        trial.forget_pictures();
        (2004..2006).for_each(|picture| trial.hear(picture, 1.0));
        assert_eq!(trial.pairs, 2);
    }
}
