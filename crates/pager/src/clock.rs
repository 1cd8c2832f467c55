//! Playback clock: the shown time step, the coming steps, and how coarse they may be.
//!
//! Each frame ticks the clock with the time and the [readiness](Readiness) of the coming steps; it advances when a step is due and ready.
//! Steps are counted along the *path*, which continues where the steps themselves end, turn or restart; place 0 is the start of playing.
//! Due times lie on a line; the [`Policy`] handles steps not ready in time.
//!
//! To hold the rate, a *bias* in levels makes coming steps coarser: by half a level for each step not whole when due, once the last change
//! has reached the shown steps, or at once and by more if a step took far too long; finer by a quarter level after a number of steps whole
//! in good time. A failed trial doubles this number, so the level does not pump. To hold the quality, only every n-th step comes. A clock
//! new to the machine stops time until its first step is whole, at most half a second; the step's speed gives the first bias.
//!
//! Costs a few comparisons per tick. Pure: no threads, no time of its own.

use crate::status::Readiness;
use std::collections::VecDeque;
use std::time::Duration;

/// Quantity to sacrifice if the rate is too high for streaming and drawing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Policy {
    /// The level: steps are shown when due, as coarse as necessary.
    #[default]
    HoldRate,
    /// Steps: shown ones are whole, at the view's level; others are left out.
    HoldQuality,
    /// Time: every step is shown, whole, and the clock waits for it.
    EveryStep,
}

/// Continuation after the last step.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Ending {
    /// None: the clock stops.
    Stop,
    /// The first step.
    #[default]
    Loop,
    /// The previous step: the clock turns, and again at the first step.
    Bounce,
}

/// Order, rate and policy of playback.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Playback {
    /// Steps per second, clamped to a thousandth to a million.
    pub steps_per_second: f64,
    /// Whether the clock starts backwards.
    pub is_backward: bool,
    /// Continuation after the last step.
    pub ending: Ending,
    /// Policy for an unattainable rate.
    pub policy: Policy,
}

impl Default for Playback {
    /// Ten steps per second, forward in a loop, as fine as this rate allows.
    fn default() -> Self {
        Self { steps_per_second: 10.0, is_backward: false, ending: Ending::Loop, policy: Policy::HoldRate }
    }
}

/// A time step, and its bias to coarser levels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ShownStep {
    /// The time step.
    pub step: u32,
    /// Most levels coarser than the view's own; 0 for the view's level.
    pub level_bias: f64,
}

/// Counts of a clock since its creation.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Tally {
    /// Steps shown while playing.
    pub shown: u64,
    /// Shown steps not whole when due: shown late, or coarser than planned.
    pub late: u64,
    /// Skipped steps.
    pub dropped: u64,
}

/// Most time steps planned ahead of the shown one.
pub const MOST_COMING: usize = 8;

/// Changes of the bias, in levels: after a late step, and with time to spare.
const COARSER: f64 = 0.5;
const FINER: f64 = 0.25;

/// Multiple of a step's time above which lateness is more than a late start of fetching.
const FAR_TOO_LONG: f64 = 2.0;

/// Largest bias: more levels than a volume of 2^16 voxels has in bricks of 64.
const MOST_BIAS: f64 = 12.0;

/// Range of steps per second in which times and places can be added safely.
const SLOWEST: f64 = 1e-3;
const FASTEST: f64 = 1e6;

/// Steps in good time before a trial of more quality: at first, and at most.
const FIRST_PATIENCE: u32 = 8;
const MOST_PATIENCE: u32 = 256;

/// Longest wait for the first step.
const LONGEST_START: Duration = Duration::from_millis(500);

/// Time without a tick after which a clock counts as stopped.
const STALL: Duration = Duration::from_secs(1);

/// Playback clock: the shown time step and the coming ones.
#[derive(Clone, Debug)]
pub struct Clock {
    steps: u32,
    shown: ShownStep,
    tally: Tally,
    /// Target of a jump, until any of it can be drawn.
    sought: Option<u32>,
    run: Option<Run>,
}

/// State of a playing clock.
#[derive(Clone, Debug)]
struct Run {
    playback: Playback,
    path: Path,
    /// The shown place, and its bias.
    place: u64,
    bias_shown: f64,
    /// A place of the path and its due time; all others follow from it.
    anchor: (u64, Duration),
    coming: VecDeque<Coming>,
    /// Start of playing, until the first step is shown; only if the machine's speed is unknown.
    starting: Option<Duration>,
    last_tick: Duration,
    /// Smoothed time between ticks, in seconds.
    tick_s: f64,
    last_flip: Duration,
    /// Places from a step to the next planned one.
    stride: u64,
    bias: f64,
    trial: Trial,
}

/// A coming place on the path through the time steps.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Coming {
    place: u64,
    bias: f64,
    /// Whether the step was due before it was whole.
    is_late: bool,
    ready: Readiness,
}

/// Knowledge of the attainable quality.
#[derive(Clone, Copy, Debug)]
struct Trial {
    /// Steps in good time since the last change.
    timely: u32,
    /// Such steps required before a trial of more quality.
    patience: u32,
    /// Steps to show until the last change takes effect.
    pending: u32,
    /// Bias or stride of the last late step; `None` before any, or if a trial has done better since.
    failed_at: Option<f64>,
    /// Whether the last change was for more quality.
    is_on: bool,
    /// A step's wanted cells before the change of bias, until the change has a visible effect.
    wanted_before: Option<usize>,
}

impl Clock {
    /// Creates a clock standing still at one of `steps` steps.
    pub fn new(step: u32, steps: u32) -> Self {
        let shown = ShownStep { step, level_bias: 0.0 };
        Self { steps, shown, tally: Tally::default(), sought: None, run: None }
    }

    /// The shown step.
    pub fn shown(&self) -> ShownStep {
        self.shown
    }

    /// The coming steps, the nearest first.
    pub fn coming(&self) -> impl Iterator<Item = ShownStep> {
        let sought = self.sought.map(|step| ShownStep { step, level_bias: 0.0 });
        let run = self.run.iter().filter(|_| self.sought.is_none());
        let of_run = run.flat_map(|run| {
            run.coming.iter().map(|coming| ShownStep { step: run.path.step(coming.place), level_bias: coming.bias })
        });
        sought.into_iter().chain(of_run)
    }

    /// Counts of steps shown while playing.
    pub fn tally(&self) -> Tally {
        self.tally
    }

    /// Current playback; `None` while the clock stands still.
    pub fn playback(&self) -> Option<Playback> {
        self.run.as_ref().map(|run| run.playback)
    }

    /// Due time of the next step; `None` without one, or while waiting for the first.
    pub fn next_due(&self) -> Option<Duration> {
        let run = self.run.as_ref()?;
        let due = run.due(run.coming.front()?.place);
        let is_awaited = run.starting.is_some() && due <= run.last_tick;
        (!is_awaited).then_some(due)
    }

    /// Starts playing from the shown step, or changes the playback; `None` stops. The shown step then returns to the view's level.
    pub fn play(&mut self, playback: Option<Playback>, at: Duration) {
        // NaN counts as below the range.
        let within = |rate: f64| if rate >= SLOWEST { rate.min(FASTEST) } else { SLOWEST };
        let playback =
            playback.map(|playback| Playback { steps_per_second: within(playback.steps_per_second), ..playback });
        if self.playback() == playback {
            return;
        }
        let before = self.run.take();
        match playback.filter(|_| self.steps > 1) {
            Some(playback) => self.run = Some(Run::new(playback, self.shown.step, before, self.steps, at)),
            None => self.shown.level_bias = 0.0,
        }
    }

    /// Jumps to a step, shown as soon as something can be drawn everywhere. A playing clock continues from there.
    pub fn seek(&mut self, step: u32) {
        self.sought = (step != self.shown.step).then_some(step);
    }

    /// Whether the target of a jump is not shown yet.
    pub fn is_seeking(&self) -> bool {
        self.sought.is_some()
    }

    /// Sets the number of steps, no fewer than before.
    pub fn grow(&mut self, steps: u32, at: Duration) {
        if steps > self.steps {
            self.go_on(self.shown.step, at);
            self.steps = steps;
        }
    }

    /// Continues from a step, if the clock plays.
    fn go_on(&mut self, step: u32, at: Duration) {
        let run = self.run.take();
        self.run = run.map(|run| Run::new(run.playback, step, Some(run), self.steps, at));
    }

    /// Advances, given the readiness of the [coming steps](Self::coming). Returns whether another step is shown.
    pub fn tick(&mut self, at: Duration, ready: &[Readiness]) -> bool {
        if let Some(step) = self.sought {
            return self.tick_sought(step, at, ready);
        }
        let Some(run) = &mut self.run else { return false };
        let before = run.place;
        run.tick(at, ready, &mut self.tally);
        let has_flipped = run.place != before;
        if has_flipped {
            self.shown = ShownStep { step: run.path.step(run.place), level_bias: run.bias_shown };
        }
        if run.coming.is_empty() {
            // The end of the path.
            self.run = None;
            self.shown.level_bias = 0.0;
        }
        has_flipped
    }

    fn tick_sought(&mut self, step: u32, at: Duration, ready: &[Readiness]) -> bool {
        let is_there = ready.first().is_some_and(|ready| ready.is_covered);
        if is_there {
            (self.shown, self.sought) = (ShownStep { step, level_bias: 0.0 }, None);
            self.go_on(step, at);
        }
        is_there
    }
}

impl Run {
    /// Plays from a step. After another run, keeps its bias, and its direction unless that changes.
    fn new(playback: Playback, origin: u32, before: Option<Self>, steps: u32, at: Duration) -> Self {
        let is_same_way = |run: &&Self| run.playback.is_backward == playback.is_backward;
        let way = before.as_ref().filter(is_same_way).map(|run| run.path.is_backward_at(run.place));
        let is_backward = way.unwrap_or(playback.is_backward);
        let holds_rate = playback.policy == Policy::HoldRate;
        let waits = playback.policy != Policy::EveryStep && before.is_none();
        let mut run = Self {
            playback,
            path: Path { origin, is_backward, ending: playback.ending, steps },
            place: 0,
            bias_shown: 0.0,
            anchor: (0, at),
            coming: VecDeque::new(),
            starting: waits.then_some(at),
            last_tick: at,
            tick_s: 0.0,
            last_flip: at,
            stride: 1,
            bias: before.filter(|_| holds_rate).map_or(0.0, |run| run.bias),
            // The first steps could not be fetched ahead.
            trial: Trial {
                timely: 0,
                patience: FIRST_PATIENCE,
                pending: 2,
                failed_at: None,
                is_on: false,
                wanted_before: None,
            },
        };
        run.fill(at);
        run
    }

    fn due(&self, place: u64) -> Duration {
        let (from, at) = self.anchor;
        at + Duration::from_secs_f64(place.saturating_sub(from) as f64 / self.playback.steps_per_second)
    }

    /// Length of a time in places.
    fn places(&self, time: Duration) -> f64 {
        time.as_secs_f64() * self.playback.steps_per_second
    }

    /// Plans ahead, past places already too late to show.
    fn fill(&mut self, at: Duration) {
        let most = MOST_COMING.min(self.path.steps as usize - 1);
        let (from, since) = self.anchor;
        let next = match self.playback.policy {
            Policy::EveryStep => 0,
            Policy::HoldRate | Policy::HoldQuality => from + self.places(at.saturating_sub(since)) as u64 + 1,
        };
        while self.coming.len() < most {
            let before = self.coming.back().map_or(self.place, |coming| coming.place);
            // The last step is shown whatever the stride.
            let place = (before + self.stride).max(next).min(self.path.last());
            if place <= before {
                return;
            }
            self.coming.push_back(Coming { place, bias: self.bias, is_late: false, ready: Readiness::default() });
        }
    }

    fn tick(&mut self, at: Duration, ready: &[Readiness], tally: &mut Tally) {
        let since_last = at.saturating_sub(self.last_tick);
        self.last_tick = at;
        if since_last > STALL {
            (self.anchor, self.tick_s) = ((self.place, at), 0.0);
        } else {
            self.tick_s += 0.2 * (since_last.as_secs_f64() - self.tick_s);
        }
        for (i, coming) in self.coming.iter_mut().enumerate() {
            coming.ready = ready.get(i).copied().unwrap_or_default();
        }
        self.see_change_of_bias();
        if self.awaits_first(at) {
            return;
        }
        let due_by = |at| self.coming.iter().take_while(|coming| self.due(coming.place) <= at).count();
        // A frame shows the step due at its middle. A step already due is not skipped for that: frames vary in length.
        let middle = Duration::from_secs_f64(self.tick_s.min(1.0 / self.playback.steps_per_second) / 2.0);
        let (due, due_soon) = (due_by(at), due_by(at + middle));
        self.coming.iter_mut().take(due).for_each(|coming| coming.is_late |= !coming.ready.is_whole);
        if let Some(chosen) = self.choose(if due > 0 { due } else { due_soon }) {
            self.flip(chosen, at, tally);
        }
        self.fill(at);
    }

    /// Whether a clock new to the machine still lacks its first step; time stands still from its due time.
    fn awaits_first(&mut self, at: Duration) -> bool {
        let (Some(since), Some(&first)) = (self.starting, self.coming.front()) else { return false };
        let (late, waited) = (at.saturating_sub(self.due(first.place)), at.saturating_sub(since));
        self.anchor.1 += late;
        let Readiness { wanted, missing, is_planned, is_whole, .. } = first.ready;
        let came = wanted.saturating_sub(missing);
        // The first bricks may have waited for others.
        let is_telling = is_planned && 4 * came >= wanted && (is_whole || self.playback.policy == Policy::HoldRate);
        if is_telling && self.places(waited) > FAR_TOO_LONG && self.trial.failed_at.is_none() {
            self.give_way(&first, self.places(waited) * wanted.max(1) as f64 / came.max(1) as f64);
        }
        let is_over = is_whole || waited > LONGEST_START;
        self.starting = self.starting.filter(|_| !is_over);
        !is_over
    }

    /// Index among the first `due` coming steps of the one to show now.
    fn choose(&self, due: usize) -> Option<usize> {
        let last = |is_ready: fn(&Readiness) -> bool| (0..due).rev().find(|&i| is_ready(&self.coming[i].ready));
        let whole = last(|ready| ready.is_whole);
        match self.playback.policy {
            Policy::EveryStep => (due > 0 && self.coming[0].ready.is_whole).then_some(0),
            Policy::HoldQuality => whole,
            Policy::HoldRate => whole.or_else(|| last(|ready| ready.is_covered)),
        }
    }

    fn flip(&mut self, chosen: usize, at: Duration, tally: &mut Tally) {
        let Some(coming) = self.coming.drain(..=chosen).next_back() else { return };
        tally.shown += 1;
        tally.late += coming.is_late as u64;
        tally.dropped += coming.place - self.place - 1;
        (self.place, self.bias_shown) = (coming.place, coming.bias);
        if self.playback.policy == Policy::EveryStep && coming.is_late {
            self.anchor = (self.place, at);
        }
        let taken = self.places(at.saturating_sub(self.last_flip)).ceil() as u64;
        self.last_flip = at;
        match (coming.is_late, self.trial.pending) {
            (true, _) => self.trial.timely = 0,
            (false, 0) => self.trial.timely += 1,
            // It precedes the last change.
            (false, _) => {}
        }
        self.trial.pending = self.trial.pending.saturating_sub(1);
        // There is time to spare if two steps are whole before they are due.
        let spare = self.coming.len().min(2);
        let has_spare = self.coming.iter().take(spare).all(|coming| coming.ready.is_whole);
        let finer = match self.playback.policy {
            Policy::HoldQuality => self.stride as f64 - 1.0,
            Policy::HoldRate | Policy::EveryStep => self.bias - FINER,
        };
        let is_patient = self.trial.waits_for(finer) <= self.trial.timely && self.trial.pending == 0 && has_spare;
        let times_too_long = taken as f64 / self.stride as f64;
        match self.playback.policy {
            Policy::EveryStep => {}
            Policy::HoldRate => {
                self.follow_frames();
                // The first steps after a change may be late for earlier reasons, but not by so much.
                let counts = self.trial.pending == 0 || times_too_long > FAR_TOO_LONG;
                // A step finer than the present bias was planned before it.
                if coming.is_late && counts && coming.bias >= self.bias {
                    self.give_way(&coming, times_too_long);
                } else if self.bias > 0.0 && (is_patient || has_spare && self.is_in_vain()) {
                    self.try_finer();
                }
            }
            Policy::HoldQuality => {
                let least = self.frames_stride();
                if coming.is_late && taken > self.stride {
                    self.give_way(&coming, times_too_long);
                } else if least > self.stride {
                    self.set_stride(least);
                } else if is_patient && self.stride > least {
                    self.trial.begin(self.stride as f64, 0);
                    self.set_stride(self.stride - 1);
                }
            }
        }
    }

    /// Stride that frames allow, as slow frames cannot show every step.
    fn frames_stride(&self) -> u64 {
        (self.tick_s * self.playback.steps_per_second).round().max(1.0) as u64
    }

    /// Plans as many steps as frames can show.
    fn follow_frames(&mut self) {
        let wanted = self.tick_s * self.playback.steps_per_second;
        // A nearly correct stride stays.
        if (wanted.max(1.0) - self.stride as f64).abs() > 0.75 {
            self.set_stride(self.frames_stride());
        }
    }

    /// Replans the steps after the next one, with another stride.
    fn set_stride(&mut self, stride: u64) {
        if stride != self.stride {
            self.stride = stride;
            self.coming.truncate(1);
        }
    }

    /// Lowers the demand after a step that took `times_too_long`. To hold the rate, even barely begun steps are made coarser: a level has
    /// an eighth of the bricks of a finer one, so the bias grows by a third of the octaves.
    fn give_way(&mut self, late: &Coming, times_too_long: f64) {
        match self.playback.policy {
            Policy::EveryStep => {}
            Policy::HoldRate => {
                self.trial.fail(late.bias);
                self.trial.wanted_before = Some(late.ready.wanted);
                self.set_bias(late.bias + COARSER.max(times_too_long.log2() / 3.0));
            }
            Policy::HoldQuality => {
                self.trial.fail(self.stride as f64);
                self.set_stride((times_too_long * self.stride as f64).ceil() as u64);
            }
        }
    }

    fn try_finer(&mut self) {
        let wanted = self.coming.back().map_or(0, |coming| coming.ready.wanted);
        self.trial.begin(self.bias, self.coming.len() as u32);
        self.trial.wanted_before = Some(wanted);
        self.bias = (self.bias - FINER).max(0.0);
    }

    fn set_bias(&mut self, bias: f64) {
        self.bias = bias.min(MOST_BIAS);
        for coming in &mut self.coming {
            // Mostly complete steps are ready sooner unchanged.
            if 2 * coming.ready.missing >= coming.ready.wanted {
                (coming.bias, coming.ready.is_planned) = (self.bias, false);
            }
        }
    }

    /// Increases a bias without effect, where even the finest level is coarser than requested.
    fn see_change_of_bias(&mut self) {
        let Some(before) = self.trial.wanted_before.filter(|_| !self.trial.is_on) else { return };
        let Some(wanted) = self.wanted_now() else { return };
        if wanted < before || self.bias >= MOST_BIAS {
            self.trial.wanted_before = None;
        } else {
            self.set_bias(self.bias + COARSER);
        }
    }

    /// Whether the last trial of a finer level had no effect.
    fn is_in_vain(&self) -> bool {
        self.trial.is_on && self.wanted_now().is_some_and(|wanted| Some(wanted) == self.trial.wanted_before)
    }

    /// Wanted cells of a step planned with the present bias; `None` while there is none.
    fn wanted_now(&self) -> Option<usize> {
        let is_planned = |coming: &&Coming| coming.bias == self.bias && coming.ready.is_planned;
        self.coming.iter().find(is_planned).map(|coming| coming.ready.wanted)
    }
}

impl Trial {
    /// Steps in good time before a trial of this bias or stride: many if it failed before.
    fn waits_for(&self, finer: f64) -> u32 {
        if self.failed_at.is_none_or(|failed| finer > failed) { FIRST_PATIENCE } else { self.patience }
    }

    /// Begins a trial of more quality than the present bias or stride, with effect after `pending` steps.
    fn begin(&mut self, present: f64, pending: u32) {
        if self.failed_at.is_some_and(|failed| present <= failed) {
            // The failed value has held.
            (self.failed_at, self.patience) = (None, (self.patience / 2).max(FIRST_PATIENCE));
        }
        *self = Self { timely: 0, pending, is_on: true, ..*self };
    }

    /// Records a late step of this bias or stride. A failed trial prolongs the wait for the next. Further late steps may have earlier
    /// causes.
    fn fail(&mut self, of_step: f64) {
        if self.is_on || self.failed_at.is_none() {
            self.failed_at = Some(of_step);
        }
        let patience = if self.is_on { (2 * self.patience).min(MOST_PATIENCE) } else { self.patience };
        *self = Self { timely: 0, patience, pending: 2, is_on: false, wanted_before: None, ..*self };
    }
}

/// Steps by place.
#[derive(Clone, Copy, Debug)]
struct Path {
    /// The step at place 0, and the direction there.
    origin: u32,
    is_backward: bool,
    ending: Ending,
    /// Number of steps; at least 2.
    steps: u32,
}

impl Path {
    fn step(&self, place: u64) -> u32 {
        let (origin, count) = (u64::from(self.origin), u64::from(self.steps));
        let step = match (self.ending, self.is_backward) {
            (Ending::Stop, false) => (origin + place).min(count - 1),
            (Ending::Stop, true) => origin.saturating_sub(place),
            (Ending::Loop, false) => (origin + place) % count,
            (Ending::Loop, true) => (origin + count - place % count) % count,
            (Ending::Bounce, _) => {
                let (phase, turn) = (self.phase(place), count - 1);
                if phase <= turn { phase } else { 2 * turn - phase }
            }
        };
        step as u32
    }

    /// The last place; the greatest number if there is none.
    fn last(&self) -> u64 {
        match (self.ending, self.is_backward) {
            (Ending::Stop, true) => self.origin.into(),
            (Ending::Stop, false) => (self.steps - 1 - self.origin).into(),
            (Ending::Loop | Ending::Bounce, _) => u64::MAX,
        }
    }

    /// Position on the way from the first step to the last and back.
    fn phase(&self, place: u64) -> u64 {
        let turn = u64::from(self.steps - 1);
        let origin = if self.is_backward { 2 * turn - u64::from(self.origin) } else { self.origin.into() };
        (origin + place) % (2 * turn)
    }

    fn is_backward_at(&self, place: u64) -> bool {
        match self.ending {
            Ending::Bounce => self.phase(place) >= u64::from(self.steps - 1),
            Ending::Stop | Ending::Loop => self.is_backward,
        }
    }
}

#[cfg(test)]
mod tests;
