//! A picture that the CPU draws beside the window: its session leaves for a thread of the picture's own, and comes home with what it has drawn. Until then the
//! window asks what the session knew when it left, and shows what is drawn so far. Costs a thread and a copy of the draw lists for each picture.

use brickyard::doubtful_extremes::DoubtfulExtremes;
use brickyard::pager::DrawList;
use brickyard::session::{Painting, ResolvedScene, Session, SessionError, VolumeSource};
use brickyard::volume::Picture;
use eframe::egui;
use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// When the window shows a picture that is done. By a delay of none egui would paint the window twice.
const AT_ONCE: Duration = Duration::from_millis(1);

/// Answers to a window that asks while its session is away.
#[derive(Clone, Default)]
pub(crate) struct Known {
    pub(crate) volumes: Vec<VolumeSource>,
    pub(crate) backend_line: String,
    pub(crate) backend_bytes: u64,
    pub(crate) slots: u64,
    pub(crate) draw_lists: Vec<DrawList>,
    pub(crate) doubtful: DoubtfulExtremes,
}

impl Known {
    /// What a session knows, which shows this scene.
    pub(crate) fn of(session: &Session, scene: Option<&ResolvedScene>) -> Self {
        Self {
            volumes: session.volumes().to_vec(),
            backend_line: session.backend_line().into(),
            backend_bytes: session.backend_bytes(),
            slots: session.slots(),
            draw_lists: session.draw_lists().cloned().collect(),
            doubtful: scene.map_or_else(Default::default, |scene| session.doubtful_extremes(scene)),
        }
    }
}

/// What comes of drawing: the picture, if there is one yet.
type Drawn = Result<Option<Picture>, SessionError>;

/// A session that comes home.
pub(crate) struct Home {
    pub(crate) session: Box<Session>,
    pub(crate) drawn: Drawn,
    /// How long it took.
    pub(crate) took: Duration,
}

/// A picture that is being drawn. Dropping it abandons the picture, and does not wait.
pub(crate) struct Drawing {
    pub(crate) known: Known,
    painting: Arc<Painting>,
    begun: Instant,
    /// Set before the window is told: a thread that has told it may still be about to end.
    is_done: Arc<AtomicBool>,
    thread: Option<JoinHandle<Home>>,
}

impl Drawing {
    /// Sends a session to draw on a painting. The window is painted again when it is done.
    ///
    /// # Errors
    /// If there is no thread for it; the session is lost.
    pub(crate) fn begin(
        mut session: Box<Session>,
        known: Known,
        painting: Painting,
        egui: egui::Context,
        draw: impl FnOnce(&mut Session, &Arc<Painting>) -> Drawn + Send + 'static,
    ) -> io::Result<Self> {
        let painting = Arc::new(painting);
        let (begun, is_done) = (Instant::now(), Arc::<AtomicBool>::default());
        let of_thread = (painting.clone(), is_done.clone());
        let work = move || {
            let home = Home { drawn: draw(&mut session, &of_thread.0), session, took: begun.elapsed() };
            of_thread.1.store(true, Ordering::Release);
            egui.request_repaint_after(AT_ONCE);
            home
        };
        let thread = std::thread::Builder::new().name("drawing".into()).spawn(work)?;
        Ok(Self { known, painting, begun, is_done, thread: Some(thread) })
    }

    /// Whether the session waits to be taken home.
    pub(crate) fn is_over(&self) -> bool {
        // A thread that panicked has only ended.
        self.is_done.load(Ordering::Acquire) || self.thread.as_ref().is_none_or(JoinHandle::is_finished)
    }

    /// Since when it draws.
    pub(crate) fn since(&self) -> Duration {
        self.begun.elapsed()
    }

    /// The share of the picture that is drawn.
    pub(crate) fn progress(&self) -> f64 {
        self.painting.progress()
    }

    /// The picture as it is so far.
    pub(crate) fn so_far(&self) -> Picture {
        self.painting.so_far()
    }

    /// Tells it to stop, which takes milliseconds.
    pub(crate) fn abandon(&self) {
        self.painting.abandon();
    }

    /// Whether it was told to stop.
    pub(crate) fn is_abandoned(&self) -> bool {
        self.painting.is_abandoned()
    }

    /// Takes the session home, and waits for that. A panic of its goes on here.
    pub(crate) fn end(mut self) -> Option<Home> {
        let home = self.thread.take()?.join();
        Some(home.unwrap_or_else(|panic| std::panic::resume_unwind(panic)))
    }
}

impl Drop for Drawing {
    fn drop(&mut self) {
        self.abandon();
    }
}
