//! The clock of playback: which time step is shown, which steps come next, and how coarse they may be.
//!
//! A clock is ticked once a frame with the time and with [how far](Readiness) the coming steps are, and moves on when a step is due and ready.
//! Steps are counted along the *path*, which runs on where the steps themselves end, turn or begin again: place 0 is where playing began.
//! What is due when is one line of the clock's time; what is done where a step is not ready is its [`Policy`].
//!
//! To hold the rate, coming steps are made coarser by a *bias* in levels: by half a level for each step that was not whole when it was due, once the
//! last change has reached the steps that are shown, or at once and by more where a step took far too long; finer by a quarter after a number of steps that were whole in good time. A trial that fails
//! doubles this number, so that the level does not pump. To hold the quality, only every so-many-th step comes. Where nothing is known of the machine yet, time
//! stands still until the first step is whole, for half a second at most, and how fast it comes gives the first bias.
//!
//! Cost: a few comparisons a tick. Pure: no threads, no time of its own.

use crate::status::Readiness;
use std::collections::VecDeque;
use std::time::Duration;

/// What gives way where steps cannot be streamed and drawn at the rate.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Policy {
    /// The level: steps are shown when they are due, as coarse as they have to be.
    #[default]
    HoldRate,
    /// Steps: those that are shown are whole, at the level that the view wants, and others are left out.
    HoldQuality,
    /// The time: every step is shown, whole, and the clock waits for it.
    EveryStep,
}

/// What follows the last step.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Ending {
    /// Nothing: the clock stops there.
    Stop,
    /// The first step.
    #[default]
    Loop,
    /// The step before: the clock turns, and turns again at the first step.
    Bounce,
}

/// How steps follow one another.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Playback {
    /// Steps a second, from a thousandth to a million. A clock takes others as the nearest of these.
    pub steps_per_second: f64,
    /// Whether the clock begins by running from later steps to earlier ones.
    pub is_backward: bool,
    /// What follows the last step.
    pub ending: Ending,
    /// What gives way where the rate cannot be held.
    pub policy: Policy,
}

impl Default for Playback {
    /// Ten steps a second, forward, again and again, at the level that this takes.
    fn default() -> Self {
        Self { steps_per_second: 10.0, is_backward: false, ending: Ending::Loop, policy: Policy::HoldRate }
    }
}

/// A time step, and how much coarser than the view asks for it may be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ShownStep {
    /// The time step.
    pub step: u32,
    /// By how many levels the step may be coarser; 0 for what the view asks for.
    pub level_bias: f64,
}

/// What a clock has done since it was made.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Tally {
    /// Steps that have been shown while playing.
    pub shown: u64,
    /// Steps among them that were not whole when they were due: they were shown late, or coarser than planned.
    pub late: u64,
    /// Steps that were passed over.
    pub dropped: u64,
}

/// How many time steps a clock plans ahead of the one that is shown, at most.
pub const MOST_COMING: usize = 8;

/// Changes of the bias, in levels: where a step is late, and where there is time to spare.
const COARSER: f64 = 0.5;
const FINER: f64 = 0.25;

/// How many times as long as it may a step takes that is late for more than having been fetched too late.
const FAR_TOO_LONG: f64 = 2.0;

/// The largest bias: more levels than a volume of 2^16 voxels has in bricks of 64.
const MOST_BIAS: f64 = 12.0;

/// The least and the greatest number of steps a second: times and places stay numbers that can be added.
const SLOWEST: f64 = 1e-3;
const FASTEST: f64 = 1e6;

/// The numbers of steps in good time that a trial of more quality waits for: at first, and at most.
const FIRST_PATIENCE: u32 = 8;
const MOST_PATIENCE: u32 = 256;

/// How long a clock waits for its first step.
const LONGEST_START: Duration = Duration::from_millis(500);

/// A clock that was not ticked for so long stood still.
const STALL: Duration = Duration::from_secs(1);

/// Which step is shown, and which come next.
#[derive(Clone, Debug)]
pub struct Clock {
    steps: u32,
    shown: ShownStep,
    tally: Tally,
    /// The step that somebody has jumped to, until something of it can be drawn.
    sought: Option<u32>,
    run: Option<Run>,
}

/// A clock that is playing.
#[derive(Clone, Debug)]
struct Run {
    playback: Playback,
    path: Path,
    /// The place that is shown, and its bias.
    place: u64,
    bias_shown: f64,
    /// A place of the path, and when it was due: a line for all others.
    anchor: (u64, Duration),
    coming: VecDeque<Coming>,
    /// When playing began, until the first step is shown of a clock that knows nothing of the machine.
    starting: Option<Duration>,
    last_tick: Duration,
    /// Smoothed time between ticks, in seconds.
    tick_s: f64,
    last_flip: Duration,
    /// From a step to the next one that comes, in places.
    stride: u64,
    bias: f64,
    trial: Trial,
}

/// A place that comes next.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Coming {
    place: u64,
    bias: f64,
    /// Whether the step was due before it was whole.
    is_late: bool,
    ready: Readiness,
}

/// What is known of how much quality can be had.
#[derive(Clone, Copy, Debug)]
struct Trial {
    /// Steps in good time since the last change.
    timely: u32,
    /// How many of them a trial of more quality waits for.
    patience: u32,
    /// Steps to show until what was changed last shows.
    pending: u32,
    /// The bias or stride that the last step to be late had; none where a trial has done better since.
    failed_at: f64,
    /// Whether the last change was for more quality.
    is_on: bool,
    /// How many cells a step wanted before the bias was changed, until the change is seen to have changed that.
    wanted_before: Option<usize>,
}

/// Less than any bias or stride.
const NEVER: f64 = -1.0;

impl Clock {
    /// A clock that stands still at a step of `steps`.
    pub fn new(step: u32, steps: u32) -> Self {
        let shown = ShownStep { step, level_bias: 0.0 };
        Self { steps, shown, tally: Tally::default(), sought: None, run: None }
    }

    /// The step that is shown.
    pub fn shown(&self) -> ShownStep {
        self.shown
    }

    /// The steps that come next, the nearest first.
    pub fn coming(&self) -> impl Iterator<Item = ShownStep> {
        let sought = self.sought.map(|step| ShownStep { step, level_bias: 0.0 });
        let run = self.run.iter().filter(|_| self.sought.is_none());
        let of_run = run.flat_map(|run| {
            run.coming.iter().map(|coming| ShownStep { step: run.path.step(coming.place), level_bias: coming.bias })
        });
        sought.into_iter().chain(of_run)
    }

    /// What has been shown while playing.
    pub fn tally(&self) -> Tally {
        self.tally
    }

    /// How steps follow one another; `None` while the clock stands still.
    pub fn playback(&self) -> Option<Playback> {
        self.run.as_ref().map(|run| run.playback)
    }

    /// When the next step is due; `None` if none is, or the clock waits for the first one.
    pub fn next_due(&self) -> Option<Duration> {
        let run = self.run.as_ref()?;
        let due = run.due(run.coming.front()?.place);
        let is_awaited = run.starting.is_some() && due <= run.last_tick;
        (!is_awaited).then_some(due)
    }

    /// Begins to play from the step that is shown, or goes on in another way; stands still with `None`. The step that is shown is then shown
    /// as the view asks for it.
    pub fn play(&mut self, playback: Option<Playback>, at: Duration) {
        // Not a number is less than none.
        let within = |rate: f64| if rate >= SLOWEST { rate.min(FASTEST) } else { SLOWEST };
        let playback = playback.map(|playback| {
            let steps_per_second = within(playback.steps_per_second);
            Playback { steps_per_second, ..playback }
        });
        if self.playback() == playback {
            return;
        }
        let before = self.run.take();
        match playback.filter(|_| self.steps > 1) {
            Some(playback) => self.run = Some(Run::new(playback, self.shown.step, before, self.steps, at)),
            None => self.shown.level_bias = 0.0,
        }
    }

    /// Jumps to a step: it is shown as soon as something of it can be drawn in every place. A clock that plays goes on from there.
    pub fn seek(&mut self, step: u32) {
        self.sought = (step != self.shown.step).then_some(step);
    }

    /// Whether a step that was jumped to is not shown yet.
    pub fn is_seeking(&self) -> bool {
        self.sought.is_some()
    }

    /// Tells how many steps there are now: no fewer than before.
    pub fn grow(&mut self, steps: u32, at: Duration) {
        if steps > self.steps {
            self.go_on(self.shown.step, at);
            self.steps = steps;
        }
    }

    /// Plays on from a step, if the clock plays.
    fn go_on(&mut self, step: u32, at: Duration) {
        let run = self.run.take();
        self.run = run.map(|run| Run::new(run.playback, step, Some(run), self.steps, at));
    }

    /// Moves on, given how far the [coming steps](Self::coming) are. Returns whether another step is shown.
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
            // It has come to its end.
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
    /// Plays from a step on. After another run, it goes on with its bias, and in its direction unless that is what changes.
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
                failed_at: NEVER,
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

    /// How many places a time is long.
    fn places(&self, time: Duration) -> f64 {
        time.as_secs_f64() * self.playback.steps_per_second
    }

    /// Plans ahead, past what can no longer be shown in time.
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
        // A frame shows the step that is due in the middle of its time. But a step that is due already is not passed over for that: frames are not all equally long.
        let middle = Duration::from_secs_f64(self.tick_s.min(1.0 / self.playback.steps_per_second) / 2.0);
        let (due, due_soon) = (due_by(at), due_by(at + middle));
        self.coming.iter_mut().take(due).for_each(|coming| coming.is_late |= !coming.ready.is_whole);
        if let Some(chosen) = self.choose(if due > 0 { due } else { due_soon }) {
            self.flip(chosen, at, tally);
        }
        self.fill(at);
    }

    /// Whether the first step is still to come of a clock that knows nothing of the machine: time stands still from when it was due.
    fn awaits_first(&mut self, at: Duration) -> bool {
        let (Some(since), Some(&first)) = (self.starting, self.coming.front()) else { return false };
        let (late, waited) = (at.saturating_sub(self.due(first.place)), at.saturating_sub(since));
        self.anchor.1 += late;
        let Readiness { wanted, missing, is_planned, is_whole, .. } = first.ready;
        let came = wanted.saturating_sub(missing);
        // The first bricks may have waited for others.
        let is_telling = is_planned && 4 * came >= wanted && (is_whole || self.playback.policy == Policy::HoldRate);
        if is_telling && self.places(waited) > FAR_TOO_LONG && !self.trial.has_failed() {
            self.give_way(&first, self.places(waited) * wanted.max(1) as f64 / came.max(1) as f64);
        }
        let is_over = is_whole || waited > LONGEST_START;
        self.starting = self.starting.filter(|_| !is_over);
        !is_over
    }

    /// Which of the first `due` coming steps is shown now.
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
            // It is of before the last change.
            (false, _) => {}
        }
        self.trial.pending = self.trial.pending.saturating_sub(1);
        // There is time to spare where two steps are there before they are due.
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
                // The first steps after a change are late for what came before it, but not by so much.
                let counts = self.trial.pending == 0 || times_too_long > FAR_TOO_LONG;
                // What is finer than the present bias is of before it.
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

    /// The stride that frames allow: where they are slower than steps, not every step can be shown.
    fn frames_stride(&self) -> u64 {
        (self.tick_s * self.playback.steps_per_second).round().max(1.0) as u64
    }

    /// Plans as many steps as frames can show.
    fn follow_frames(&mut self) {
        let wanted = self.tick_s * self.playback.steps_per_second;
        // A stride that is nearly right stays.
        if (wanted.max(1.0) - self.stride as f64).abs() > 0.75 {
            self.set_stride(self.frames_stride());
        }
    }

    /// Plans anew what comes after the next step, in another stride.
    fn set_stride(&mut self, stride: u64) {
        if stride != self.stride {
            self.stride = stride;
            self.coming.truncate(1);
        }
    }

    /// Asks for less after a step that took `times_too_long`. To hold the rate, coming steps are made coarser, those that have hardly begun among them: a
    /// level has an eighth of the bricks of a finer one, so that the bias grows by a third of the octaves.
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
            // What is mostly there is there sooner as it is.
            if 2 * coming.ready.missing >= coming.ready.wanted {
                (coming.bias, coming.ready.is_planned) = (self.bias, false);
            }
        }
    }

    /// Where a coarser bias has changed nothing, as the finest level is coarser than it asks for, it has to be larger.
    fn see_change_of_bias(&mut self) {
        let Some(before) = self.trial.wanted_before.filter(|_| !self.trial.is_on) else { return };
        let changed = self.coming.iter().find(|coming| coming.bias == self.bias && coming.ready.is_planned);
        let Some(wanted) = changed.map(|coming| coming.ready.wanted) else { return };
        if wanted < before || self.bias >= MOST_BIAS {
            self.trial.wanted_before = None;
        } else {
            self.set_bias(self.bias + COARSER);
        }
    }

    /// Whether the last trial of a finer level has changed nothing.
    fn is_in_vain(&self) -> bool {
        let is_of_trial = |coming: &&Coming| coming.bias == self.bias && coming.ready.is_planned;
        let tried = self.coming.iter().find(is_of_trial).map(|coming| coming.ready.wanted);
        self.trial.is_on && tried.is_some_and(|wanted| Some(wanted) == self.trial.wanted_before)
    }
}

impl Trial {
    /// How many steps in good time a trial of this bias or stride waits for: many where it has failed before.
    fn waits_for(&self, finer: f64) -> u32 {
        if finer > self.failed_at { FIRST_PATIENCE } else { self.patience }
    }

    /// Whether any step has been late so far.
    fn has_failed(&self) -> bool {
        self.failed_at != NEVER
    }

    /// Begins a trial of more quality than the present bias or stride gives, which shows after `pending` steps.
    fn begin(&mut self, present: f64, pending: u32) {
        if present <= self.failed_at {
            // What had failed has held.
            (self.failed_at, self.patience) = (NEVER, (self.patience / 2).max(FIRST_PATIENCE));
        }
        *self = Self { timely: 0, pending, is_on: true, ..*self };
    }

    /// Takes note that a step of this bias or stride was late. If that was a trial, the next one waits for longer. Further late steps may
    /// be late for what came before them.
    fn fail(&mut self, of_step: f64) {
        if self.is_on || self.failed_at == NEVER {
            self.failed_at = of_step;
        }
        let patience = if self.is_on { (2 * self.patience).min(MOST_PATIENCE) } else { self.patience };
        *self = Self { timely: 0, patience, pending: 2, is_on: false, wanted_before: None, ..*self };
    }
}

/// The steps, place by place.
#[derive(Clone, Copy, Debug)]
struct Path {
    /// The step at place 0, and whether the path runs to earlier steps there.
    origin: u32,
    is_backward: bool,
    ending: Ending,
    /// The number of steps; at least 2.
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

    /// Where a place is on the way from the first step to the last one and back.
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
