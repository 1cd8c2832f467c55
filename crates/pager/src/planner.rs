//! The planner: makes the cut for the newest view from the last cut, and lists what the next views may want, on a thread of its
//! own or at once.
//!
//! Ahead of the view there are two tiers, each with a share of the slots: bricks of the cut of the foreseen camera
//! that this cut lacks, and the face neighbours of its cells just outside of the frustum.
//!
//! On a thread, views go in and cuts come out through channels of one place, each emptied before it is filled: what is newer
//! replaces what nobody has taken. A frame with a new view waits a millisecond, which is enough for the usual cut; else it
//! draws the newest finished one, whichever view that was made for. At once, the cut is always the view's own, and the same
//! views give the same cuts.

use crate::cut::{Cut, Node, View, cut_capacity};
use crate::plan::{self, Tier};
use crate::source::BrickSource;
use crate::split;
use crate::visibility::Visibility;
use brickyard_volume::{BrickId, BrickIndex, ViewRays};
use crossbeam_channel::{Receiver, Sender, bounded};
use glam::DVec3;
use std::collections::HashSet;
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::Duration;

/// Where cuts are made.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Planning {
    /// Within the frame, each anew: for pictures that are waited for. The same view always has the same cut, whatever was
    /// seen before it.
    #[default]
    Inline,
    /// On a thread of its own, each from the last one: for a moving camera. A frame may draw the cut of an earlier view.
    Thread,
}

/// How long a frame waits for its own view's cut.
const PATIENCE: Duration = Duration::from_millis(1);

/// What to plan for.
#[derive(Clone)]
pub(crate) struct Job {
    pub(crate) view: View,
    /// What is known of the visibility of cells, and its number.
    pub(crate) visibility: Option<(u64, Arc<Visibility>)>,
    /// Whether to look ahead, and the camera that is foreseen.
    pub(crate) ahead: Option<Option<ViewRays>>,
    /// The version of what is known of bricks' occupancy.
    pub(crate) occupancy: u64,
}

impl Job {
    fn visibility(&self) -> Option<&Visibility> {
        self.visibility.as_ref().map(|(_, visibility)| &**visibility)
    }

    /// Whether another job's cut would be the same. A camera that stops is no reason to look ahead anew.
    fn is_same(&self, other: &Self) -> bool {
        let number = |job: &Self| job.visibility.as_ref().map(|(number, _)| *number);
        self.view == other.view && number(self) == number(other) && self.occupancy == other.occupancy
    }
}

/// What has been planned.
#[derive(Clone)]
pub(crate) struct Outlook {
    pub(crate) cut: Arc<Cut>,
    /// What to fetch ahead, first things first.
    pub(crate) ahead: Arc<[(Tier, BrickId)]>,
}

/// Makes one plan after the other.
struct Desk {
    source: Arc<dyn BrickSource>,
    slots: usize,
    max_cells: usize,
    is_incremental: bool,
    last: Option<Arc<Cut>>,
}

impl Desk {
    fn cut(&mut self, job: &Job) -> Arc<Cut> {
        let cut = split::cut(&*self.source, &job.view, self.max_cells, self.last.as_deref(), job.visibility());
        let cut = Arc::new(cut);
        if self.is_incremental {
            self.last = Some(cut.clone());
        }
        cut
    }

    /// What to fetch ahead of a job's cut.
    fn look_ahead(&self, job: &Job, cut: &Cut) -> Arc<[(Tier, BrickId)]> {
        let Some(rays) = job.ahead else { return [].into() };
        let mut listed: HashSet<BrickId> = cut.cells().collect();
        // Of two eyes one: the other one sees hardly anything else.
        let foreseen = rays.map(|rays| View { rays, other_eye: None, ..cut.view.clone() });
        let foreseen =
            foreseen.map(|view| split::cut(&*self.source, &view, self.max_cells, Some(cut), job.visibility()));
        let predicted =
            foreseen.iter().flat_map(|cut| cut.wanted_cells().map(|cell| (cut.id(cell), cut.error_px(cell))));
        let ring = ring(&*self.source, cut);
        let mut ahead = Vec::new();
        for (tier, bricks) in [(Tier::Predicted, predicted.collect()), (Tier::Ring, ring)] {
            let new = bricks.into_iter().filter(|(id, _)| listed.insert(*id)).collect();
            // Twice what there is room for: so that what is there already is not forgotten for being a little less urgent.
            let room = 2 * tier.slots(self.slots);
            let ordered = plan::ordered(self.source.pyramid(), tier, new);
            ahead.extend(ordered.into_iter().take(room).map(|id| (tier, id)));
        }
        ahead.into()
    }
}

/// Face neighbours of the wanted cells, of their level, that are outside of the frustum and not empty; with the cells' errors.
fn ring(source: &dyn BrickSource, cut: &Cut) -> Vec<(BrickId, f64)> {
    let frusta = cut.view.frusta();
    let mut ring = Vec::new();
    for cell in cut.wanted_cells() {
        let Node { level, index, low, high, error_px, .. } = cut.nodes[cell as usize];
        let (at, bricks, size) = (index.to_array(), source.pyramid().level(level).bricks, high - low);
        for (axis, side) in [(0, -1), (0, 1), (1, -1), (1, 1), (2, -1), (2, 1)] {
            let mut beside = at;
            beside[axis] = at[axis].wrapping_add_signed(side);
            let away = DVec3::AXES[axis] * size * side as f64;
            // A neighbour at the volume's end may be smaller than the cell: then this asks a little too much.
            let is_shown = cut.view.is_inside_clip(low + away, high + away);
            if bricks.contains(beside) && is_shown && !frusta.meet_box(low + away, high + away) {
                let id = cut.view.id(level, BrickIndex::from_array(beside));
                if cut.view.shows(source, id) {
                    ring.push((id, error_px));
                }
            }
        }
    }
    ring
}

pub(crate) struct Planner {
    source: Arc<dyn BrickSource>,
    /// What was asked for last, and its number.
    asked: Option<Job>,
    number: u64,
    /// The newest outlook, and the number of what it was made for.
    newest: Option<(u64, Outlook)>,
    place: Place,
}

enum Place {
    Inline(Desk),
    Thread(PlannerThread),
}

impl Planner {
    pub(crate) fn new(source: &Arc<dyn BrickSource>, slots: u32, planning: Planning) -> std::io::Result<Self> {
        let roots = source.pyramid().level(source.pyramid().coarsest()).bricks.volume() as usize;
        let max_cells = cut_capacity(slots, roots);
        let is_incremental = planning == Planning::Thread;
        let desk = Desk { source: source.clone(), slots: slots as usize, max_cells, is_incremental, last: None };
        let place = match planning {
            Planning::Inline => Place::Inline(desk),
            Planning::Thread => Place::Thread(PlannerThread::start(desk)?),
        };
        Ok(Self { source: source.clone(), asked: None, number: 0, newest: None, place })
    }

    /// The newest there is, of the view's time step and channel. If it is not what is asked for, that is on its way.
    pub(crate) fn outlook(&mut self, job: Job) -> Outlook {
        let (time, channel) = (job.view.time, job.view.channel);
        if let Place::Thread(thread) = &self.place {
            self.newest = thread.newest(Duration::ZERO).or(self.newest.take());
        }
        if self.asked.as_ref().is_none_or(|asked| !asked.is_same(&job)) {
            self.number += 1;
            match &mut self.place {
                Place::Inline(desk) => {
                    let cut = desk.cut(&job);
                    self.newest = Some((self.number, Outlook { ahead: desk.look_ahead(&job, &cut), cut }));
                }
                Place::Thread(thread) => {
                    thread.ask(self.number, job.clone());
                    self.newest = thread.newest(PATIENCE).or(self.newest.take());
                }
            }
            self.asked = Some(job.clone());
        }
        let guess = |cut: Cut| (0, Outlook { cut: Arc::new(cut), ahead: [].into() });
        let newest = match self.newest.take() {
            // Before the first: the coarsest level.
            None => guess(Cut::new(&*self.source, &job.view, 0)),
            Some((_, Outlook { cut, .. })) if (cut.view.time, cut.view.channel) != (time, channel) => {
                guess(cut.at(&*self.source, time, channel))
            }
            Some(newest) => newest,
        };
        self.newest.insert(newest).1.clone()
    }

    /// Whether the newest outlook is what was asked for last.
    pub(crate) fn is_done(&self) -> bool {
        self.newest.as_ref().is_some_and(|(number, _)| *number == self.number)
    }

    /// Where the next one comes from, if it is on its way.
    pub(crate) fn awaited(&self) -> Option<&Receiver<(u64, Outlook)>> {
        match &self.place {
            Place::Thread(thread) if !self.is_done() => Some(&thread.outlooks),
            _ => None,
        }
    }
}

struct PlannerThread {
    /// `None` only while dropping.
    jobs: Option<Sender<(u64, Job)>>,
    /// The other end, to take back what the thread has not taken.
    untaken: Receiver<(u64, Job)>,
    outlooks: Receiver<(u64, Outlook)>,
    thread: Option<JoinHandle<()>>,
}

impl PlannerThread {
    fn start(mut desk: Desk) -> std::io::Result<Self> {
        let (jobs, untaken) = bounded::<(u64, Job)>(1);
        let (finished, outlooks) = bounded(1);
        let (inbox, unseen) = (untaken.clone(), outlooks.clone());
        let work = move || {
            let finish = |number, cut, ahead| {
                while unseen.try_recv().is_ok() {}
                finished.send((number, Outlook { cut, ahead })).is_ok()
            };
            let mut ahead: Arc<[_]> = [].into();
            for (number, job) in inbox {
                // A frame may be waiting for the cut.
                let cut = desk.cut(&job);
                let mut goes_on = finish(number, cut.clone(), ahead);
                ahead = desk.look_ahead(&job, &cut);
                goes_on = goes_on && finish(number, cut, ahead.clone());
                if !goes_on {
                    return;
                }
            }
        };
        let thread = Some(std::thread::Builder::new().name("planner".into()).spawn(work)?);
        Ok(Self { jobs: Some(jobs), untaken, outlooks, thread })
    }

    fn ask(&self, number: u64, job: Job) {
        while self.untaken.try_recv().is_ok() {}
        if let Some(jobs) = &self.jobs {
            // The planner holds the other end as long as it lives; `newest` says so if it does not.
            let _ = jobs.try_send((number, job));
        }
    }

    /// The newest outlook that nobody has taken; if there is none, that which comes within a time.
    fn newest(&self, patience: Duration) -> Option<(u64, Outlook)> {
        match self.outlooks.recv_timeout(patience) {
            Ok(outlook) => Some(outlook),
            Err(_) if self.thread.as_ref().is_none_or(JoinHandle::is_finished) => panic!("the planner has panicked"),
            Err(_) => None,
        }
    }
}

impl Drop for PlannerThread {
    fn drop(&mut self) {
        self.jobs = None;
        if let Some(thread) = self.thread.take() {
            // Its own panic has been printed; there is nothing to add while dropping.
            let _ = thread.join();
        }
    }
}
