//! The pipelines of a renderer, compiled at first use or ahead of it on a thread, so that other pictures need not wait
//! for a compiler.
//!
//! Each is compiled once, by whichever side comes first; a picture waits for the thread if it is compiling the needed
//! pipeline. A failure is an error of the picture that needs the pipeline; the next picture tries again.

use crate::GpuError;
use crate::pipelines::{Maker, Pipeline, Wanted};
use std::collections::HashMap;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, OnceLock, PoisonError};
use std::thread::JoinHandle;

/// A pipeline, or its error, once compiled.
type Making = Arc<OnceLock<Result<Pipeline, GpuError>>>;

/// All pipelines compiled so far, and the thread that compiles some ahead on request.
#[derive(Debug)]
pub(crate) struct Pipelines {
    maker: Arc<Maker>,
    all: HashMap<Wanted, Making>,
    requests: Arc<Requests>,
    thread: Option<JoinHandle<()>>,
}

/// Pipelines requested from the compiling thread.
#[derive(Debug, Default)]
struct Requests {
    list: Mutex<List>,
    changed: Condvar,
}

#[derive(Debug, Default)]
struct List {
    wanted: Vec<(Wanted, Making)>,
    is_over: bool,
}

impl Requests {
    fn lock(&self) -> MutexGuard<'_, List> {
        self.list.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn set(&self, list: List) {
        *self.lock() = list;
        self.changed.notify_all();
    }

    /// Waits for the next request; `None` at the end.
    fn next(&self) -> Option<(Wanted, Making)> {
        let is_idle = |list: &mut List| list.wanted.is_empty() && !list.is_over;
        let mut list = self.changed.wait_while(self.lock(), is_idle).unwrap_or_else(PoisonError::into_inner);
        list.wanted.pop()
    }
}

impl Pipelines {
    /// Takes the pipelines left by another renderer from `kept` if `maker` would produce the same ones, else returns an
    /// empty set.
    pub(crate) fn kept_or_new(kept: &mut Vec<Self>, maker: Maker) -> Self {
        match kept.iter().position(|kept| kept.maker.makes_the_same(&maker)) {
            Some(i) => kept.swap_remove(i),
            None => Self { maker: Arc::new(maker), all: HashMap::new(), requests: Default::default(), thread: None },
        }
    }

    /// Compiles a pipeline unless it exists, or waits for the thread compiling it.
    ///
    /// # Errors
    /// If the pipeline cannot be compiled.
    pub(crate) fn need(&mut self, wanted: &Wanted) -> Result<(), GpuError> {
        let making = self.all.entry(wanted.clone()).or_default();
        match making.get_or_init(|| self.maker.make(wanted)) {
            Ok(_) => Ok(()),
            Err(error) => {
                let error = error.clone();
                self.all.remove(wanted);
                Err(error)
            }
        }
    }

    pub(crate) fn get(&self, wanted: &Wanted) -> Option<&Pipeline> {
        self.all.get(wanted)?.get()?.as_ref().ok()
    }

    /// Requests a picture's pipelines from the thread. Earlier requests not begun yet are dropped.
    pub(crate) fn prepare(&mut self, wanted: Vec<Wanted>) {
        let mut with_making = |wanted: Wanted| (wanted.clone(), self.all.entry(wanted).or_default().clone());
        let wanted: Vec<_> =
            wanted.into_iter().map(&mut with_making).filter(|(_, making)| making.get().is_none()).collect();
        if wanted.is_empty() {
            return;
        }
        if self.thread.is_none() {
            let (maker, requests) = (self.maker.clone(), self.requests.clone());
            let run = move || {
                while let Some((wanted, making)) = requests.next() {
                    making.get_or_init(|| maker.make(&wanted));
                }
            };
            match std::thread::Builder::new().name("pipelines".into()).spawn(run) {
                Ok(thread) => self.thread = Some(thread),
                Err(error) => {
                    tracing::warn!("no thread for pipelines: {error}; they are made at once");
                    for (wanted, making) in &wanted {
                        making.get_or_init(|| self.maker.make(wanted));
                    }
                    return;
                }
            }
        }
        self.requests.set(List { wanted, is_over: false });
    }

    /// Whether these pipelines have all been compiled or have failed.
    pub(crate) fn are_made(&self, wanted: &[Wanted]) -> bool {
        wanted.iter().all(|wanted| self.all.get(wanted).is_some_and(|making| making.get().is_some()))
    }
}

impl Drop for Pipelines {
    /// Waits for the thread's current pipeline: drivers do not survive the end of a process in the middle of it.
    fn drop(&mut self) {
        self.requests.set(List { wanted: Vec::new(), is_over: true });
        if let Some(thread) = self.thread.take() {
            // Its work is guarded; had it died all the same, there is nobody left to notify.
            let _ = thread.join();
        }
    }
}
