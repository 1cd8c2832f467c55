//! The planner: makes the cut for the newest view from the last cut, on a thread of its own or at once.
//!
//! On a thread, views go in and cuts come out through channels of one place, each emptied before it is filled: what is
//! newer replaces what nobody has taken. So frames never wait; they draw the newest finished cut, whichever view that was made
//! for. At once, the cut is always the view's own, and the same views give the same cuts.

use crate::cut::{Cut, View, cut_capacity};
use crate::source::BrickSource;
use crossbeam_channel::{Receiver, Sender, bounded};
use std::sync::Arc;
use std::thread::JoinHandle;

/// Where cuts are made.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Planning {
    /// Within the frame: for pictures that are waited for, and wherever the same views are to give the same plans.
    #[default]
    Inline,
    /// On a thread of its own: for a moving camera. A frame may draw the cut of an earlier view.
    Thread,
}

/// Makes one cut after the other.
struct Desk {
    source: Arc<dyn BrickSource>,
    max_cells: usize,
    last: Option<Arc<Cut>>,
}

impl Desk {
    fn cut(&mut self, view: &View) -> Arc<Cut> {
        let cut = match &self.last {
            Some(last) => last.next(&*self.source, view, self.max_cells),
            None => Cut::new(&*self.source, view, self.max_cells),
        };
        self.last.insert(Arc::new(cut)).clone()
    }
}

pub(crate) struct Planner {
    source: Arc<dyn BrickSource>,
    /// The view asked for last, and its number.
    asked: Option<View>,
    number: u64,
    /// The newest cut, and the number of the view that it was made for.
    newest: Option<(u64, Arc<Cut>)>,
    place: Place,
}

enum Place {
    Inline(Desk),
    Thread(PlannerThread),
}

impl Planner {
    pub(crate) fn new(source: &Arc<dyn BrickSource>, slots: u32, planning: Planning) -> std::io::Result<Self> {
        let roots = source.pyramid().level(source.pyramid().coarsest()).bricks.volume() as usize;
        let desk = Desk { source: source.clone(), max_cells: cut_capacity(slots, roots), last: None };
        let place = match planning {
            Planning::Inline => Place::Inline(desk),
            Planning::Thread => Place::Thread(PlannerThread::start(desk)?),
        };
        Ok(Self { source: source.clone(), asked: None, number: 0, newest: None, place })
    }

    /// The newest cut there is, of the view's time step and channel. If it is not the view's own, that is on its way.
    pub(crate) fn cut(&mut self, view: &View) -> Arc<Cut> {
        let is_new = self.asked.as_ref() != Some(view);
        if is_new {
            self.asked = Some(view.clone());
            self.number += 1;
        }
        match &mut self.place {
            Place::Inline(desk) if is_new => self.newest = Some((self.number, desk.cut(view))),
            Place::Inline(_) => {}
            Place::Thread(thread) => {
                if is_new {
                    thread.ask(self.number, view.clone());
                }
                self.newest = thread.newest().or(self.newest.take());
            }
        }
        let (number, newest) = match self.newest.take() {
            // Before the first: the coarsest level.
            None => (0, Arc::new(Cut::new(&*self.source, view, 0))),
            Some((number, cut)) if (cut.view.time, cut.view.channel) == (view.time, view.channel) => (number, cut),
            Some((_, cut)) => (0, Arc::new(cut.at(&*self.source, view.time, view.channel))),
        };
        self.newest = Some((number, newest.clone()));
        newest
    }

    /// Whether the newest cut was made for the view asked for last.
    pub(crate) fn is_done(&self) -> bool {
        self.newest.as_ref().is_some_and(|(number, _)| *number == self.number)
    }

    /// Where the next cut comes from, if one is on its way.
    pub(crate) fn awaited(&self) -> Option<&Receiver<(u64, Arc<Cut>)>> {
        match &self.place {
            Place::Thread(thread) if !self.is_done() => Some(&thread.cuts),
            _ => None,
        }
    }
}

struct PlannerThread {
    /// `None` only while dropping.
    views: Option<Sender<(u64, View)>>,
    /// The other end, to take back what the thread has not taken.
    untaken: Receiver<(u64, View)>,
    cuts: Receiver<(u64, Arc<Cut>)>,
    thread: Option<JoinHandle<()>>,
}

impl PlannerThread {
    fn start(mut desk: Desk) -> std::io::Result<Self> {
        let (views, untaken) = bounded::<(u64, View)>(1);
        let (finished, cuts) = bounded(1);
        let (inbox, unseen) = (untaken.clone(), cuts.clone());
        let work = move || {
            for (number, view) in inbox {
                let cut = desk.cut(&view);
                while unseen.try_recv().is_ok() {}
                if finished.send((number, cut)).is_err() {
                    return;
                }
            }
        };
        let thread = Some(std::thread::Builder::new().name("planner".into()).spawn(work)?);
        Ok(Self { views: Some(views), untaken, cuts, thread })
    }

    fn ask(&self, number: u64, view: View) {
        while self.untaken.try_recv().is_ok() {}
        if let Some(views) = &self.views {
            // The planner holds the other end as long as it lives; `newest` says so if it does not.
            let _ = views.try_send((number, view));
        }
    }

    fn newest(&self) -> Option<(u64, Arc<Cut>)> {
        match self.cuts.try_recv() {
            Ok(cut) => Some(cut),
            Err(_) if self.thread.as_ref().is_none_or(JoinHandle::is_finished) => panic!("the planner has panicked"),
            Err(_) => None,
        }
    }
}

impl Drop for PlannerThread {
    fn drop(&mut self) {
        self.views = None;
        if let Some(thread) = self.thread.take() {
            // Its own panic has been printed; there is nothing to add while dropping.
            let _ = thread.join();
        }
    }
}
