//! Clocks with a model of a machine of given streaming rate, in cells per second, and frame time.

use super::*;
use std::collections::HashMap;

const STEPS: u32 = 100;

/// A machine that fills the present step, then the coming ones, in their order.
struct Machine {
    cells_per_s: f64,
    frame: Duration,
    /// Wanted cells of a step without bias. Each level has an eighth of them; the level first changes at this bias.
    cells: f64,
    first_change: f64,
    /// Present cells, by step and wanted number.
    there: HashMap<(u32, usize), f64>,
    now: Duration,
}

/// One shown step of a run.
struct Shown {
    at: Duration,
    step: ShownStep,
    is_whole: bool,
}

impl Machine {
    fn new(cells_per_s: f64, frame_ms: u64) -> Self {
        let frame = Duration::from_millis(frame_ms);
        Self { cells_per_s, frame, cells: 512.0, first_change: 0.0, there: HashMap::new(), now: Duration::ZERO }
    }

    /// A machine that has filled the step before which playing begins.
    fn at_rest(self) -> Self {
        let mut machine = self;
        machine.run(&mut Clock::new(0, STEPS), 10.0);
        Self { now: Duration::ZERO, ..machine }
    }

    fn wanted(&self, bias: f64) -> usize {
        (self.cells * 8f64.powf(-(bias - self.first_change).max(0.0))).ceil() as usize
    }

    fn run(&mut self, clock: &mut Clock, seconds: f64) -> Vec<Shown> {
        let end = self.now + Duration::from_secs_f64(seconds);
        let mut shown = Vec::new();
        while self.now < end {
            let coming: Vec<ShownStep> = clock.coming().collect();
            let mut room = self.cells_per_s * self.frame.as_secs_f64();
            for &ShownStep { step, level_bias } in [clock.shown()].iter().chain(&coming) {
                let wanted = self.wanted(level_bias);
                let there = self.there.entry((step, wanted)).or_default();
                let more = room.min(wanted as f64 - *there);
                *there += more;
                room -= more;
            }
            self.there.retain(|(step, _), _| *step == clock.shown().step || coming.iter().any(|c| c.step == *step));
            let ready: Vec<Readiness> = coming.iter().map(|&step| self.ready(step)).collect();
            self.now += self.frame;
            if clock.tick(self.now, &ready) {
                shown.push(Shown { at: self.now, step: clock.shown(), is_whole: self.ready(clock.shown()).is_whole });
            }
        }
        shown
    }

    fn ready(&self, ShownStep { step, level_bias }: ShownStep) -> Readiness {
        let wanted = self.wanted(level_bias);
        let there = self.there.get(&(step, wanted)).copied().unwrap_or_default();
        let missing = (wanted as f64 - there).ceil() as usize;
        Readiness { wanted, is_planned: true, missing, is_covered: there >= 1.0, is_whole: missing == 0 }
    }
}

fn playing(policy: Policy, steps_per_second: f64) -> Clock {
    let mut clock = Clock::new(0, STEPS);
    clock.play(Some(Playback { policy, steps_per_second, ..Playback::default() }), Duration::ZERO);
    clock
}

#[test]
fn paths_end_run_round_and_turn() {
    let steps = |origin, is_backward, ending| {
        let path = Path { origin, is_backward, ending, steps: 4 };
        (0..9).map(|place| path.step(place)).collect::<Vec<_>>()
    };
    assert_eq!(steps(1, false, Ending::Stop), [1, 2, 3, 3, 3, 3, 3, 3, 3]);
    assert_eq!(steps(2, true, Ending::Stop), [2, 1, 0, 0, 0, 0, 0, 0, 0]);
    assert_eq!(steps(1, false, Ending::Loop), [1, 2, 3, 0, 1, 2, 3, 0, 1]);
    assert_eq!(steps(1, true, Ending::Loop), [1, 0, 3, 2, 1, 0, 3, 2, 1]);
    assert_eq!(steps(1, false, Ending::Bounce), [1, 2, 3, 2, 1, 0, 1, 2, 3]);
    assert_eq!(steps(1, true, Ending::Bounce), [1, 0, 1, 2, 3, 2, 1, 0, 1]);
    let path = Path { origin: 2, is_backward: false, ending: Ending::Bounce, steps: 4 };
    assert_eq!([0, 1, 2, 3, 4].map(|place| path.is_backward_at(place)), [false, true, true, true, false]);
}

#[test]
fn a_machine_that_is_fast_enough_shows_every_step_when_it_is_due() {
    for policy in [Policy::HoldRate, Policy::HoldQuality, Policy::EveryStep] {
        let mut machine = Machine::new(20_000.0, 5).at_rest();
        let mut clock = playing(policy, 20.0);
        let shown = machine.run(&mut clock, 10.0);
        assert!(shown.iter().all(|shown| shown.is_whole && shown.step.level_bias == 0.0), "{policy:?}");
        assert!(shown.windows(2).all(|pair| pair[1].step.step == (pair[0].step.step + 1) % STEPS), "{policy:?}");
        assert!((198..=200).contains(&shown.len()), "{policy:?}: {}", shown.len());
        assert!(clock.tally().late <= 1 && clock.tally().dropped == 0, "{policy:?}: {:?}", clock.tally());
        // Each within a frame of its time.
        let late = shown.iter().zip(1u32..).map(|(shown, i)| shown.at.abs_diff(Duration::from_millis(50) * i));
        assert!(late.max().unwrap() <= Duration::from_millis(10));
    }
}

#[test]
fn frames_that_are_unequally_long_show_every_step() {
    let mut machine = Machine::new(1e6, 0);
    let mut clock = playing(Policy::HoldRate, 20.0);
    let mut shown = 0;
    // Of 47 ms on average, up to half as long again.
    for frame_ms in [25, 70, 45].into_iter().cycle().take(600) {
        machine.frame = Duration::from_millis(frame_ms);
        shown += machine.run(&mut clock, 1e-3).len() as u64;
    }
    let tally = clock.tally();
    assert!(shown == tally.shown && shown.abs_diff(560) <= 2 && (tally.late, tally.dropped) == (0, 0), "{tally:?}");
}

#[test]
fn a_clock_waits_for_its_first_step_and_learns_from_it() {
    // A step takes 256 ms, five times its time: a coarser one can be shown before that.
    for (policy, start_ms) in [(Policy::HoldRate, 110..=170), (Policy::HoldQuality, 250..=270)] {
        let mut machine = Machine::new(2_000.0, 5).at_rest();
        let mut clock = playing(policy, 20.0);
        let shown = machine.run(&mut clock, 0.3);
        assert!(shown[0].is_whole && shown[0].step.step == 1, "{policy:?}");
        assert!(start_ms.contains(&shown[0].at.as_millis()), "{policy:?}: {:?}", shown[0].at);
        machine.run(&mut clock, 3.0);
        let tally = clock.tally();
        assert!(tally.late <= 5 && (policy == Policy::HoldQuality || tally.dropped <= 3), "{policy:?}: {tally:?}");
    }
    // A step that does not come is waited for no longer than half a second.
    let mut machine = Machine::new(200.0, 5).at_rest();
    let mut clock = playing(Policy::HoldRate, 20.0);
    let shown = machine.run(&mut clock, 1.0);
    assert!((490..=560).contains(&shown[0].at.as_millis()) && !shown[0].is_whole, "{:?}", shown[0].at);
}

#[test]
fn the_rate_is_held_by_a_level_that_comes_to_rest() {
    // A fifth of the rate for full quality; also with a finest level twice as fine as requested.
    for first_change in [0.0, 1.2] {
        let mut machine = Machine { first_change, ..Machine::new(2_000.0, 5) };
        let mut clock = playing(Policy::HoldRate, 20.0);
        machine.run(&mut clock, 5.0);
        let before = clock.tally();
        let shown = machine.run(&mut clock, 60.0);
        let after = clock.tally();
        let (late, dropped) = (after.late - before.late, after.dropped - before.dropped);
        assert!(shown.len() >= 1150 && late <= 40 && dropped <= 40, "{}: {late} {dropped}", shown.len());
        let mean = shown.iter().map(|shown| shown.step.level_bias).sum::<f64>() / shown.len() as f64;
        // The right bias for the rate would be 0.77 levels.
        assert!((0.7..1.5).contains(&(mean - first_change)), "{mean}");
        let changes = shown.windows(2).filter(|pair| pair[0].step.level_bias != pair[1].step.level_bias).count();
        assert!(changes <= 30, "{changes} changes of the level in a minute");
        // The same clock with time to spare is as fine as the view requests.
        machine.cells_per_s = 50_000.0;
        machine.run(&mut clock, 60.0);
        assert_eq!(clock.shown().level_bias, 0.0, "{first_change}");
    }
}

#[test]
fn the_quality_is_held_by_steps_that_are_left_out() {
    let mut machine = Machine::new(2_000.0, 5);
    let mut clock = playing(Policy::HoldQuality, 20.0);
    machine.run(&mut clock, 5.0);
    let before = clock.tally();
    let shown = machine.run(&mut clock, 60.0);
    let after = clock.tally();
    assert!(shown.iter().all(|shown| shown.is_whole && shown.step.level_bias == 0.0));
    // A step takes 256 ms: every sixth is shown, 3.3 per second, out of 3.9 for which there is time.
    assert!((180..=235).contains(&shown.len()), "{}", shown.len());
    assert!(after.late - before.late <= 20, "{}", after.late - before.late);
    let (shown, dropped) = ((after.shown - before.shown) as i64, (after.dropped - before.dropped) as i64);
    assert!((shown + dropped - 1200).abs() <= 20, "time runs on: {shown} {dropped}");
    // It returns to every step once there is time.
    machine.cells_per_s = 50_000.0;
    machine.run(&mut clock, 60.0);
    let shown = machine.run(&mut clock, 10.0);
    assert!(shown.windows(2).all(|pair| pair[1].step.step == (pair[0].step.step + 1) % STEPS));
}

#[test]
fn every_step_is_shown_though_time_waits() {
    let mut machine = Machine::new(2_000.0, 5);
    let mut clock = playing(Policy::EveryStep, 20.0);
    let shown = machine.run(&mut clock, 60.0);
    assert!(shown.iter().all(|shown| shown.is_whole && shown.step.level_bias == 0.0));
    assert!(shown.windows(2).all(|pair| pair[1].step.step == (pair[0].step.step + 1) % STEPS));
    assert!((225..=235).contains(&shown.len()), "{}", shown.len());
    assert!(clock.tally().late >= 200 && clock.tally().dropped == 0, "{:?}", clock.tally());
}

#[test]
fn where_frames_are_slower_than_steps_only_what_they_can_show_is_planned() {
    for policy in [Policy::HoldRate, Policy::HoldQuality] {
        let mut machine = Machine::new(50_000.0, 100);
        let mut clock = playing(policy, 50.0);
        machine.run(&mut clock, 5.0);
        let before = clock.tally();
        let shown = machine.run(&mut clock, 20.0);
        // Five steps per frame.
        assert!(shown.len() >= 190 && shown.iter().all(|shown| shown.is_whole), "{policy:?}: {}", shown.len());
        let ahead: Vec<u32> = clock.coming().map(|coming| coming.step).collect();
        assert!(ahead.windows(2).all(|pair| (pair[1] + STEPS - pair[0]) % STEPS == 5), "{ahead:?}");
        let dropped = clock.tally().dropped - before.dropped;
        assert!(dropped.abs_diff(800) <= 20, "{policy:?}: {dropped}");
    }
}

#[test]
fn a_jump_shows_a_step_as_soon_as_there_is_something_of_it() {
    let mut clock = Clock::new(3, STEPS);
    let ms = Duration::from_millis;
    clock.seek(40);
    assert_eq!(clock.coming().map(|coming| coming.step).collect::<Vec<_>>(), [40]);
    assert!(!clock.tick(ms(1), &[Readiness::default()]) && clock.shown().step == 3);
    // Another jump replaces an unfinished one.
    clock.seek(41);
    let covered = Readiness { wanted: 9, missing: 8, is_covered: true, ..Readiness::default() };
    assert!(clock.tick(ms(2), &[covered]) && clock.shown().step == 41);
    assert_eq!((clock.coming().count(), clock.tally()), (0, Tally::default()));
    // Back to the shown step: nothing is to come.
    clock.seek(50);
    clock.seek(41);
    assert_eq!(clock.coming().count(), 0);
    clock.play(Some(Playback::default()), ms(10));
    clock.seek(7);
    assert_eq!(clock.coming().map(|coming| coming.step).collect::<Vec<_>>(), [7]);
    assert!(clock.tick(ms(20), &[covered]));
    assert_eq!(clock.coming().next().map(|coming| coming.step), Some(8));
}

#[test]
fn a_clock_stops_at_the_end_where_it_is_to_stop() {
    let mut machine = Machine::new(50_000.0, 5);
    let mut clock = Clock::new(96, STEPS);
    clock.play(Some(Playback { ending: Ending::Stop, ..Playback::default() }), Duration::ZERO);
    let shown = machine.run(&mut clock, 2.0);
    assert_eq!(shown.iter().map(|shown| shown.step.step).collect::<Vec<_>>(), [97, 98, 99]);
    assert_eq!((clock.playback(), clock.next_due(), clock.shown().level_bias), (None, None, 0.0));
    // A single step has no successor.
    let mut clock = Clock::new(0, 1);
    clock.play(Some(Playback::default()), Duration::ZERO);
    assert_eq!(clock.playback(), None);
}

#[test]
fn a_clock_that_bounces_goes_on_in_its_direction_after_a_change() {
    let mut machine = Machine::new(50_000.0, 5);
    let mut clock = Clock::new(98, STEPS);
    let bounce = Playback { ending: Ending::Bounce, ..Playback::default() };
    clock.play(Some(bounce), Duration::ZERO);
    machine.run(&mut clock, 0.35);
    assert_eq!(clock.shown().step, 97);
    clock.play(Some(Playback { steps_per_second: 20.0, ..bounce }), machine.now);
    machine.run(&mut clock, 0.12);
    assert_eq!(clock.shown().step, 95);
    clock.grow(200, machine.now);
    machine.run(&mut clock, 0.12);
    assert_eq!(clock.shown().step, 93);
}

#[test]
fn any_rate_is_a_rate() {
    for (rate, steps) in [(f64::NAN, 0), (0.0, 0), (-1.0, 0), (1e-300, 0), (1e300, 100), (f64::INFINITY, 100)] {
        for policy in [Policy::HoldRate, Policy::HoldQuality, Policy::EveryStep] {
            let mut machine = Machine::new(50_000.0, 10).at_rest();
            let shown = machine.run(&mut playing(policy, rate), 1.0).len();
            assert!(shown <= steps && (shown > 0 || steps == 0), "{rate} {policy:?}: {shown}");
        }
    }
}

#[test]
fn a_clock_that_stood_still_drops_nothing_for_it() {
    let mut machine = Machine::new(50_000.0, 5);
    let mut clock = playing(Policy::HoldRate, 20.0);
    machine.run(&mut clock, 1.0);
    machine.now += Duration::from_secs(60);
    machine.run(&mut clock, 1.0);
    assert!(clock.tally().dropped == 0 && clock.tally().shown >= 37, "{:?}", clock.tally());
}
