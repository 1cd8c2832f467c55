//! The planner: makes the cuts of all volumes for the newest views from the last cuts, and lists bricks to prefetch, on a separate thread
//! or inline.
//!
//! Prefetching has two tiers, each with a share of the slots: bricks of the predicted camera's cuts missing from these cuts, and face
//! neighbours of their cells just outside the frustum. The cuts of coming time steps precede both. While there are any, each cut has half
//! of the cells, so two steps fit, and a step's cut is ready in time.
//!
//! On a thread, views go in and cuts come out through channels with one place, each emptied before it is filled, so the newest replaces
//! any untaken. A frame with a new view waits a millisecond, enough for the usual cut; else it draws the newest finished cut, whatever
//! its view. It waits longer only for volumes newly placed on one grid. Inline, the cut is always the view's own, and equal views give
//! equal cuts.

use crate::budget::Planning;
use crate::cut::{Cut, Node, View, cut_capacity};
use crate::goal::VolumeBrick;
use crate::leave::Threads;
use crate::plan::{self, Key};
use crate::source::BrickSource;
use crate::split::{self, Subject};
use crate::tier::Tier;
use crate::visibility::Visibility;
use brickyard_volume::{BrickId, BrickIndex, ViewRays};
use crossbeam_channel::{Receiver, RecvTimeoutError, Sender, bounded};
use glam::DVec3;
use rustc_hash::FxHashSet;
use std::sync::Arc;
use std::time::Duration;

/// Longest wait of a frame for its own view's cut.
const PATIENCE: Duration = Duration::from_millis(1);

/// Input of the planner's thread: the views to cut.
#[derive(Clone)]
pub(crate) struct Job {
    pub(crate) views: Vec<View>,
    /// Coming views, the nearest first.
    pub(crate) coming: Arc<[Vec<View>]>,
    /// Known visibility of each volume's cells, and its version.
    pub(crate) visibility: Vec<Option<(u64, Arc<Visibility>)>>,
    /// Predicted camera, if any, for prefetching; `None` without prefetching.
    pub(crate) ahead: Option<Option<ViewRays>>,
    /// Version of each volume's known occupancy.
    pub(crate) occupancy: Vec<u64>,
}

impl Job {
    /// Whether another job's cuts would be the same. A stopping camera is no reason to prefetch anew.
    fn is_same(&self, other: &Self) -> bool {
        fn numbers(job: &Job) -> impl Iterator<Item = Option<u64>> {
            job.visibility.iter().map(|known| known.as_ref().map(|(number, _)| *number))
        }
        let is_same_view = self.views == other.views && self.coming == other.coming;
        is_same_view && numbers(self).eq(numbers(other)) && self.occupancy == other.occupancy
    }
}

/// Whether cuts have the views' time steps and channels.
fn are_of_times(cuts: &[Arc<Cut>], views: &[View]) -> bool {
    let times = |view: &View| (view.time, view.channel);
    cuts.iter().map(|cut| times(&cut.view)).eq(views.iter().map(times))
}

/// Plan for a job: cuts, and bricks to prefetch.
#[derive(Clone)]
pub(crate) struct Outlook {
    pub(crate) cuts: Vec<Arc<Cut>>,
    /// Cuts of coming views, as far as there is room.
    pub(crate) coming: Arc<[Vec<Arc<Cut>>]>,
    /// Bricks to prefetch, the most urgent first.
    pub(crate) ahead: Arc<[(Tier, VolumeBrick)]>,
    /// Number of the answered request; 0 for a guess.
    number: u64,
    /// Whether `coming` and `ahead` belong to this job; if not, its own follow with the same cuts.
    is_whole: bool,
}

impl Outlook {
    /// Cuts of coming views; `None` if there are none yet.
    pub(crate) fn coming(&self, views: &[View]) -> Option<&[Arc<Cut>]> {
        self.coming.iter().find(|cuts| are_of_times(cuts, views)).map(Vec::as_slice)
    }
}

/// Maker of successive plans.
struct Desk {
    sources: Vec<Arc<dyn BrickSource>>,
    slots: usize,
    roots: usize,
    is_incremental: bool,
    last: Vec<Arc<Cut>>,
    /// Cuts of coming views, and the version of their occupancy.
    coming: Arc<[Vec<Arc<Cut>>]>,
    coming_occupancy: Vec<u64>,
}

impl Desk {
    fn new(sources: &[Arc<dyn BrickSource>], slots: u32, planning: Planning) -> Self {
        let roots = |source: &Arc<dyn BrickSource>| source.pyramid().level(source.pyramid().coarsest()).bricks.volume();
        let roots: u64 = sources.iter().map(roots).sum();
        let (sources, is_incremental) = (sources.to_vec(), planning == Planning::Thread);
        Self {
            sources,
            slots: slots as usize,
            roots: roots as usize,
            is_incremental,
            last: Vec::new(),
            coming: [].into(),
            coming_occupancy: Vec::new(),
        }
    }

    /// Cuts of a job's own views, following those made while their step was coming.
    fn cuts(&mut self, job: &Job) -> Vec<Arc<Cut>> {
        let cuts = self.cuts_for(&job.views, job, self.last_for(&job.views));
        if self.is_incremental {
            self.last.clone_from(&cuts);
        }
        cuts
    }

    /// Cuts of a job's own views, of views near them, or of its coming ones.
    fn cuts_for(&self, views: &[View], job: &Job, last: &[Arc<Cut>]) -> Vec<Arc<Cut>> {
        let slots = if job.coming.is_empty() { self.slots } else { self.slots / 2 };
        let last: Vec<&Cut> = last.iter().map(|cut| &**cut).collect();
        let subjects = subjects(&self.sources, views, &job.visibility);
        let cuts = split::cuts(&subjects, cut_capacity(slots as u32, self.roots), &last);
        cuts.into_iter().map(Arc::new).collect()
    }

    /// The cuts to precede those for these views.
    fn last_for(&self, views: &[View]) -> &[Arc<Cut>] {
        let known = self.coming.iter().find(|cuts| self.is_incremental && are_of_times(cuts, views));
        known.map_or(&self.last, |cuts| cuts)
    }

    /// The plan for a job with these cuts of its own views.
    fn outlook(&mut self, number: u64, job: &Job, cuts: Vec<Arc<Cut>>) -> Outlook {
        self.make_coming(job);
        let ahead = self.look_ahead(job, &cuts);
        Outlook { cuts, coming: self.coming.clone(), ahead, number, is_whole: true }
    }

    /// Makes the cuts of the coming views, until their wanted cells fill the slots. Visibility in the present step hides nothing in later
    /// ones, but puts their likely visible cells first.
    fn make_coming(&mut self, job: &Job) {
        let is_known = self.coming_occupancy == job.occupancy;
        let is_same = |cuts: &&Vec<Arc<Cut>>, views: &[View]| is_known && cuts.iter().map(|cut| &cut.view).eq(views);
        let mut coming: Vec<Vec<Arc<Cut>>> = Vec::new();
        let mut room = self.slots;
        for views in job.coming.iter() {
            let cuts = match self.coming.iter().find(|cuts| is_same(cuts, views)) {
                Some(cuts) => cuts.clone(),
                None => self.cuts_for(views, job, self.last_for(views)),
            };
            let wanted: usize = cuts.iter().map(|cut| cut.wanted()).sum();
            if wanted > room && !coming.is_empty() {
                break;
            }
            room = room.saturating_sub(wanted);
            coming.push(cuts);
        }
        self.coming = coming.into();
        self.coming_occupancy.clone_from(&job.occupancy);
    }

    /// Bricks to prefetch, beyond a job's cuts.
    fn look_ahead(&self, job: &Job, cuts: &[Arc<Cut>]) -> Arc<[(Tier, VolumeBrick)]> {
        let Some(rays) = job.ahead else { return [].into() };
        let of_volume = |volume: usize| move |id| VolumeBrick { volume, id };
        let mut listed: FxHashSet<VolumeBrick> =
            cuts.iter().enumerate().flat_map(|(volume, cut)| cut.cells().map(of_volume(volume))).collect();
        let foreseen = rays.map_or(Vec::new(), |rays| {
            // One of two eyes: the other sees hardly anything else.
            let views: Vec<View> =
                job.views.iter().map(|view| View { rays, other_eye: None, ..view.clone() }).collect();
            self.cuts_for(&views, job, cuts)
        });
        let predicted =
            |cut: &Cut| cut.wanted_cells().map(|cell| (cut.id(cell), cut[cell].error_px)).collect::<Vec<_>>();
        let predicted: Vec<Vec<(BrickId, f64)>> = foreseen.iter().map(|cut| predicted(cut)).collect();
        let ring = self.sources.iter().zip(cuts).map(|(source, cut)| ring(&**source, cut)).collect();
        let mut ahead = Vec::new();
        for (tier, bricks) in [(Tier::Predicted, predicted), (Tier::Ring, ring)] {
            let mut keyed: Vec<(Key, VolumeBrick)> = Vec::new();
            for (volume, of_volume) in bricks.into_iter().enumerate() {
                let pyramid = self.sources[volume].pyramid();
                let new = of_volume.into_iter().filter(|&(id, _)| listed.insert(VolumeBrick { volume, id }));
                keyed.extend(new.map(|(id, error)| (plan::key(pyramid, tier, id, error), VolumeBrick { volume, id })));
            }
            // Twice the room, so resident bricks are not forgotten for being slightly less urgent.
            let room = 2 * tier.slots(self.slots);
            ahead.extend(plan::in_order(keyed).into_iter().take(room));
        }
        ahead.into()
    }
}

fn subjects<'a>(
    sources: &'a [Arc<dyn BrickSource>],
    views: &'a [View],
    visibility: &'a [Option<(u64, Arc<Visibility>)>],
) -> Vec<Subject<'a>> {
    let known = visibility.iter().map(|known| known.as_ref().map(|(_, visibility)| &**visibility));
    let all = sources.iter().zip(views).zip(known.chain(std::iter::repeat(None)));
    all.map(|((source, view), visibility)| Subject { source: &**source, view, visibility }).collect()
}

/// Neighbours at the faces of wanted cells, of the same level, outside of the frustum and not empty, with the cells' errors.
fn ring(source: &dyn BrickSource, cut: &Cut) -> Vec<(BrickId, f64)> {
    let frusta = cut.view.frusta();
    let mut ring = Vec::new();
    for cell in cut.wanted_cells() {
        let Node { level, index, low, high, error_px, .. } = cut[cell];
        let (at, bricks, size) = (index.to_array(), source.pyramid().level(level).bricks, high - low);
        for (axis, side) in [(0, -1), (0, 1), (1, -1), (1, 1), (2, -1), (2, 1)] {
            let mut beside = at;
            beside[axis] = at[axis].wrapping_add_signed(side);
            let away = DVec3::AXES[axis] * size * side as f64;
            // A neighbour at the volume's end may be smaller than the cell, and this box slightly too large.
            let (low, high) = (low + away, high + away);
            let id = cut.view.id(level, BrickIndex::from_array(beside));
            let is_outside = bricks.contains(beside) && !frusta.meet_box(low, high);
            if is_outside && cut.view.shows(source, id, (low, high)) {
                ring.push((id, error_px));
            }
        }
    }
    ring
}

pub(crate) struct Planner {
    sources: Vec<Arc<dyn BrickSource>>,
    /// The last request and its number.
    asked: Option<Job>,
    number: u64,
    newest: Option<Outlook>,
    place: Place,
}

enum Place {
    Inline(Desk),
    Thread(PlannerThread),
}

impl Planner {
    pub(crate) fn new(sources: &[Arc<dyn BrickSource>], slots: u32, planning: Planning) -> std::io::Result<Self> {
        let desk = Desk::new(sources, slots, planning);
        let place = match planning {
            Planning::Inline => Place::Inline(desk),
            Planning::Thread => Place::Thread(PlannerThread::start(desk)?),
        };
        Ok(Self { sources: sources.to_vec(), asked: None, number: 0, newest: None, place })
    }

    /// The newest outlook, with cuts of the views' time steps and channels. If it is not the job's own, that one is on its way.
    pub(crate) fn outlook(&mut self, job: Job) -> Outlook {
        if let Place::Thread(thread) = &self.place {
            self.newest = thread.newest(Duration::ZERO).or(self.newest.take());
        }
        if self.asked.as_ref().is_none_or(|asked| !asked.is_same(&job)) {
            self.number += 1;
            match &mut self.place {
                Place::Inline(desk) => {
                    let cuts = desk.cuts(&job);
                    self.newest = Some(desk.outlook(self.number, &job, cuts));
                }
                Place::Thread(thread) => {
                    thread.ask(self.number, job.clone());
                    self.newest = thread.newest(PATIENCE).or(self.newest.take());
                    // Cells of one grid have one order only in cuts made together, so wait for those.
                    let subjects = subjects(&self.sources, &job.views, &[]);
                    while self.newest.as_ref().is_some_and(|newest| !split::share_trees(&subjects, &newest.cuts)) {
                        self.newest = thread.newest(PATIENCE).or(self.newest.take());
                    }
                }
            }
            self.asked = Some(job.clone());
        }
        let guess = |cuts, coming| Outlook { cuts, coming, ahead: [].into(), number: 0, is_whole: false };
        let newest = match self.newest.take() {
            // Before the first: the coarsest level.
            None => {
                let cuts = split::cuts(&subjects(&self.sources, &job.views, &job.visibility), 0, &[]);
                guess(cuts.into_iter().map(Arc::new).collect(), [].into())
            }
            Some(newest) if !are_of_times(&newest.cuts, &job.views) => {
                let cuts = match newest.coming(&job.views) {
                    Some(cuts) => cuts.to_vec(),
                    None => split::recut(&newest.cuts, &self.sources, &job.views),
                };
                guess(cuts, newest.coming)
            }
            Some(newest) => newest,
        };
        self.newest.insert(newest).clone()
    }

    /// Whether the newest outlook answers the last request.
    pub(crate) fn is_done(&self) -> bool {
        self.newest.as_ref().is_some_and(|newest| newest.number == self.number)
    }

    /// Channel of the next outlook, if one is on its way.
    pub(crate) fn awaited(&self) -> Option<&Receiver<Outlook>> {
        let is_whole = self.newest.as_ref().is_some_and(|newest| newest.is_whole);
        match &self.place {
            Place::Thread(thread) if !(self.is_done() && is_whole) => Some(&thread.outlooks),
            _ => None,
        }
    }
}

struct PlannerThread {
    jobs: Sender<(u64, Job)>,
    /// The other end, for taking back jobs.
    untaken: Receiver<(u64, Job)>,
    outlooks: Receiver<Outlook>,
    /// Dropped after the channels, whose end stops the thread.
    _thread: Threads,
}

impl PlannerThread {
    fn start(mut desk: Desk) -> std::io::Result<Self> {
        let (jobs, untaken) = bounded::<(u64, Job)>(1);
        let (finished, outlooks) = bounded(1);
        let (inbox, unseen) = (untaken.clone(), outlooks.clone());
        let work = move || {
            let finish = |outlook: Outlook| {
                while unseen.try_recv().is_ok() {}
                finished.send(outlook).is_ok()
            };
            let mut ahead: Arc<[_]> = [].into();
            for (number, job) in inbox {
                // A frame may be waiting for the cuts.
                let cuts = desk.cuts(&job);
                let coming = desk.coming.clone();
                let is_heard = finish(Outlook { cuts: cuts.clone(), coming, ahead, number, is_whole: false });
                let outlook = desk.outlook(number, &job, cuts);
                ahead = outlook.ahead.clone();
                if !is_heard || !finish(outlook) {
                    return;
                }
            }
        };
        let mut thread = Threads::default();
        thread.start("planner".into(), work)?;
        Ok(Self { jobs, untaken, outlooks, _thread: thread })
    }

    fn ask(&self, number: u64, job: Job) {
        while self.untaken.try_recv().is_ok() {}
        // The planner holds the other end for life; `newest` reports its death.
        let _ = self.jobs.try_send((number, job));
    }

    /// The newest untaken outlook, or the next one within `patience`.
    fn newest(&self, patience: Duration) -> Option<Outlook> {
        match self.outlooks.recv_timeout(patience) {
            Ok(outlook) => Some(outlook),
            Err(RecvTimeoutError::Timeout) => None,
            Err(RecvTimeoutError::Disconnected) => panic!("the planner has panicked"),
        }
    }
}
