//! The link to a host: its rate and latency as measured, and how much is admitted to it at a time. As much as keeps it busy; the next bricks are chosen
//! when there is room for them, so the newest plan's come first.

use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Admissions at a time, however slow the link: small requests wait for each other's latency otherwise.
const LEAST_ADMITTED: u32 = 4;

/// Bounds of the bytes admitted at a time.
const LEAST_BYTES: f64 = (256 << 10) as f64;
const MOST_BYTES: f64 = (32 << 20) as f64;

/// Parts into which the admitted bytes are divided, if bricks are small: threads that fetch.
const PARTS: f64 = 16.0;

/// Most bricks of an admission.
const MOST_BRICKS: f64 = 8.0;

/// Turns that the admitted bytes take on a link that is backed up: to end requests on it is worth the connections that end with them.
const BACKED_UP_TURNS: f64 = 5.0;

/// Time over which the rate is counted.
const COUNTED: Duration = Duration::from_millis(100);

/// Latency beside the measured one: of decoders, and of the round that measures.
const SLACK: Duration = Duration::from_millis(50);

/// A host's link.
pub struct Link {
    state: Mutex<State>,
    freed: Condvar,
}

struct State {
    admitted: u32,
    admitted_bytes: f64,
    /// Bytes fetched for a brick.
    brick_bytes: f64,
    /// Bytes of an answer.
    answer_bytes: f64,
    /// Greatest bytes per second of late.
    rate: f64,
    /// Least time to the first byte of late.
    latency: Option<Duration>,
    /// Beginning of the count, and the bytes since.
    count: (Instant, u64),
}

/// Room on a link for the bytes of some bricks; free again when dropped.
pub struct Admission<'a> {
    link: &'a Link,
    /// Bricks for which there is room.
    pub bricks: usize,
    bytes: f64,
}

impl Default for Link {
    fn default() -> Self {
        let state = State {
            admitted: 0,
            admitted_bytes: 0.0,
            brick_bytes: LEAST_BYTES / 4.0,
            answer_bytes: LEAST_BYTES / 4.0,
            rate: 0.0,
            latency: None,
            count: (Instant::now(), 0),
        };
        Self { state: Mutex::new(state), freed: Condvar::new() }
    }
}

impl Link {
    /// Waits until there is room for a brick or more.
    pub fn admit(&self) -> Admission<'_> {
        let is_full = |state: &mut State| {
            state.admitted >= LEAST_ADMITTED && state.admitted_bytes + state.brick_bytes > state.window()
        };
        let mut state = self.freed.wait_while(self.lock(), is_full).unwrap_or_else(PoisonError::into_inner);
        let bricks = (state.window() / PARTS / state.brick_bytes).clamp(1.0, MOST_BRICKS).floor();
        let bytes = bricks * state.brick_bytes;
        state.admitted += 1;
        state.admitted_bytes += bytes;
        Admission { link: self, bricks: bricks as usize, bytes }
    }

    /// Whether the admitted bytes take so long that a new plan had better end what it does not want of them.
    pub fn is_backed_up(&self) -> bool {
        let state = self.lock();
        state.rate > 0.0 && state.admitted_bytes / state.rate > BACKED_UP_TURNS * state.turn_s()
    }

    /// Bytes fetched for a brick, by the last ones.
    pub fn brick_bytes(&self) -> u64 {
        self.lock().brick_bytes as u64
    }

    /// Bytes of an answer, by the last ones.
    pub fn answer_bytes(&self) -> u64 {
        self.lock().answer_bytes as u64
    }

    /// Takes an answer into account: its bytes, and the time to the first of them.
    pub fn note(&self, bytes: u64, latency: Duration) {
        let mut state = self.lock();
        let least = state.latency.map_or(latency, |least| latency.min(least.mul_f64(1.02)));
        state.latency = Some(least);
        state.answer_bytes = mixed(state.answer_bytes, bytes as f64);
        state.count.1 += bytes;
        let counted = state.count.0.elapsed();
        if counted >= COUNTED {
            state.rate = (state.count.1 as f64 / counted.as_secs_f64()).max(state.rate * 0.95);
            state.count = (Instant::now(), 0);
        }
        drop(state);
        self.freed.notify_all();
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// A mean in which the newest eight values weigh most.
fn mixed(old: f64, new: f64) -> f64 {
    old + (new - old) / 8.0
}

impl State {
    /// Bytes admitted at a time: twice those under way on a busy link.
    fn window(&self) -> f64 {
        (2.0 * self.rate * self.turn_s()).clamp(LEAST_BYTES, MOST_BYTES)
    }

    /// Seconds from a request to its answer on an idle link.
    fn turn_s(&self) -> f64 {
        (self.latency.unwrap_or_default() + SLACK).as_secs_f64()
    }
}

impl Admission<'_> {
    /// Tells how many bytes were fetched for how many bricks.
    pub fn fetched(self, bytes: u64, bricks: usize) {
        if bytes > 0 && bricks > 0 {
            let mut state = self.link.lock();
            state.brick_bytes = mixed(state.brick_bytes, bytes as f64 / bricks as f64).max(1024.0);
        }
    }
}

impl Drop for Admission<'_> {
    fn drop(&mut self) {
        let mut state = self.link.lock();
        state.admitted -= 1;
        state.admitted_bytes = if state.admitted == 0 { 0.0 } else { state.admitted_bytes - self.bytes };
        drop(state);
        self.link.freed.notify_all();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Admissions that fit, one after the other without an end, until the next would wait.
    fn fill(link: &Link) -> Vec<Admission<'_>> {
        let has_room = |link: &Link| {
            let state = link.lock();
            state.admitted < LEAST_ADMITTED || state.admitted_bytes + state.brick_bytes <= state.window()
        };
        let mut all = Vec::new();
        while has_room(link) {
            all.push(link.admit());
        }
        all
    }

    #[test]
    fn faster_and_longer_links_take_more() {
        let admitted = |rate: f64, latency_ms: u64| {
            let link = Link::default();
            link.lock().rate = rate;
            link.lock().latency = Some(Duration::from_millis(latency_ms));
            let all = fill(&link);
            let bytes = link.lock().admitted_bytes;
            drop(all);
            assert!(link.lock().admitted == 0 && link.lock().admitted_bytes == 0.0);
            bytes
        };
        let [slow, fast, long] = [admitted(1e5, 20), admitted(1e7, 20), admitted(1e7, 200)];
        assert!(
            slow <= LEAST_BYTES && (1e6..2e6).contains(&fast) && (4e6..6e6).contains(&long),
            "{slow} {fast} {long}"
        );
    }

    #[test]
    fn slow_links_are_backed_up_and_fast_ones_are_not() {
        let is_backed_up = |rate: f64| {
            let link = Link::default();
            link.lock().rate = rate;
            link.lock().latency = Some(Duration::from_millis(100));
            let _all = fill(&link);
            link.is_backed_up()
        };
        // A quarter of a MiB, which is admitted at least, takes 2.6 s and 0.1 s.
        assert!(is_backed_up(1e5) && !is_backed_up(2e6) && !is_backed_up(0.0));
    }

    #[test]
    fn large_bricks_are_admitted_one_at_a_time_and_small_ones_together() {
        let link = Link::default();
        for _ in 0..100 {
            link.admit().fetched(8 * 50_000_000, 8);
        }
        let all = fill(&link);
        assert_eq!(all.len(), LEAST_ADMITTED as usize);
        drop(all);
        for _ in 0..200 {
            link.admit().fetched(2_000, 1);
        }
        assert_eq!(link.admit().bricks, MOST_BRICKS as usize);
    }

    #[test]
    fn an_admission_waits_for_room() {
        let link = Link::default();
        let mut all = fill(&link);
        std::thread::scope(|scope| {
            let waits = scope.spawn(|| link.admit().bricks);
            std::thread::sleep(Duration::from_millis(20));
            assert!(!waits.is_finished());
            all.pop();
            assert!(waits.join().unwrap() > 0);
        });
    }

    #[test]
    fn the_rate_is_the_greatest_of_late() {
        let link = Link::default();
        for _ in 0..3 {
            std::thread::sleep(COUNTED);
            link.note(1_000_000, Duration::from_millis(30));
        }
        let state = link.lock();
        assert!(
            (1e6..1.1e7).contains(&state.rate) && state.latency == Some(Duration::from_millis(30)),
            "{}",
            state.rate
        );
    }
}
