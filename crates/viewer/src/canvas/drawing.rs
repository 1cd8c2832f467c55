//! A picture drawn by the CPU beside the window: its session leaves for a thread, streams and draws there, and returns with the picture. Meanwhile
//! the window shows the picture so far and relies on the session's last report. Costs a thread per picture, and a copy of the draw lists per
//! streaming step.

use super::FrameTimes;
use super::meeting::Meeting;
use super::picture::Shown;
use brickyard::doubtful_extremes::DoubtfulExtremes;
use brickyard::frame_governor::{Quality, QualityControl};
use brickyard::pager::DrawList;
use brickyard::session::{Frame, Painting, ResolvedScene, Session, SessionError, VolumeSource};
use brickyard::volume::Picture;
use eframe::egui;
use std::io;
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Delay until a finished picture is shown. Without a delay egui would paint the window twice.
const AT_ONCE: Duration = Duration::from_millis(1);

/// A session and the quality of its pictures.
pub(super) struct Engine {
    pub(super) session: Session,
    pub(super) control: QualityControl,
}

/// The session's properties, for queries while it is away.
#[derive(Clone, Default)]
pub(super) struct Known {
    pub(super) volumes: Vec<VolumeSource>,
    pub(super) backend_line: String,
    pub(super) backend_bytes: u64,
    pub(super) slots: u64,
    pub(super) draw_lists: Vec<DrawList>,
    pub(super) doubtful: DoubtfulExtremes,
}

impl Known {
    /// Copies the properties of a session showing this scene.
    pub(super) fn of(session: &Session, scene: Option<&ResolvedScene>) -> Self {
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

/// A step of streaming taken beside the window.
pub(super) struct News {
    pub(super) known: Known,
    pub(super) frame: Frame,
    /// The drawing of the frame; `None` while waiting for bricks or a time step.
    pub(super) begun: Option<Begun>,
}

/// A picture in progress.
#[derive(Clone, Copy)]
pub(super) struct Begun {
    pub(super) quality: Quality,
    /// Whether the view moves: the previous picture shows another one.
    pub(super) is_of_motion: bool,
    pub(super) at: Instant,
}

/// State shared by the window and a session beside it.
pub(super) struct Stage {
    /// The picture so far, and whether it is abandoned.
    pub(super) painting: Arc<Painting>,
    /// The last streaming step, until the window takes it.
    news: Mutex<Option<News>>,
    meeting: Meeting,
}

impl Stage {
    /// Reports a streaming step to the window.
    pub(super) fn tell(&self, session: &Session, frame: &Frame, begun: Option<Begun>) {
        let known = Known::of(session, Some(&frame.scene));
        let news = News { known, frame: frame.clone(), begun };
        *self.news.lock().unwrap_or_else(PoisonError::into_inner) = Some(news);
    }
}

/// A session's result.
pub(super) enum Done {
    /// The picture was abandoned.
    Nothing,
    /// A picture of the scene.
    Picture { picture: Picture, shown: Box<Shown>, times: FrameTimes },
    /// A sample of the shown picture, and its time.
    Sample(Picture, Duration),
    /// A picture to be saved, and its frame.
    Capture(Picture, Box<Frame>),
}

/// A returning session.
pub(super) struct Home {
    pub(super) engine: Box<Engine>,
    pub(super) done: Result<Done, SessionError>,
}

/// A picture in progress. Dropping it abandons the picture without waiting.
pub(super) struct Drawing {
    stage: Arc<Stage>,
    since: Instant,
    /// The reported picture in progress; the outer `None` before the first streaming step.
    begun: Option<Option<Begun>>,
    thread: Option<JoinHandle<Home>>,
}

impl Drawing {
    /// Sends a session to draw. The window is repainted at the end.
    ///
    /// # Errors
    /// If no thread can be started; the session is lost.
    pub(super) fn begin(
        mut engine: Box<Engine>,
        painting: Painting,
        egui: egui::Context,
        draw: impl FnOnce(&mut Engine, &Stage) -> Result<Done, SessionError> + Send + 'static,
    ) -> io::Result<Self> {
        let (news, meeting) = Default::default();
        let stage = Arc::new(Stage { painting: Arc::new(painting), news, meeting });
        let of_thread = stage.clone();
        let work = move || {
            let home = Home { done: draw(&mut engine, &of_thread), engine };
            if !of_thread.meeting.arrive() {
                egui.request_repaint_after(AT_ONCE);
            }
            home
        };
        let thread = std::thread::Builder::new().name("drawing".into()).spawn(work)?;
        Ok(Self { stage, since: Instant::now(), begun: None, thread: Some(thread) })
    }

    /// Takes the last streaming step, if it is new.
    pub(super) fn hear(&mut self) -> Option<News> {
        let news = self.stage.news.lock().unwrap_or_else(PoisonError::into_inner).take()?;
        self.begun = Some(news.begun);
        Some(news)
    }

    /// The reported picture in progress; `None` while only streaming.
    pub(super) fn begun(&self) -> Option<Begun> {
        self.begun.flatten()
    }

    /// Whether no streaming step is reported yet.
    pub(super) fn is_in_first_step(&self) -> bool {
        self.begun.is_none()
    }

    /// Whether the session can be taken home.
    pub(super) fn is_over(&self) -> bool {
        // A thread that panicked has only ended.
        self.stage.meeting.is_due() || self.thread.as_ref().is_none_or(JoinHandle::is_finished)
    }

    /// Waits `at_most` for the session. Returns whether it can be taken home.
    pub(super) fn wait(&self, at_most: Duration) -> bool {
        self.stage.meeting.wait(at_most)
    }

    /// Time since the session left.
    pub(super) fn since(&self) -> Duration {
        self.since.elapsed()
    }

    /// The picture so far. Once it is abandoned, the session stops within a streaming step, or milliseconds while drawing.
    pub(super) fn painting(&self) -> &Painting {
        &self.stage.painting
    }

    /// Waits for the session and takes it home. A panic of its thread continues here.
    pub(super) fn end(mut self) -> Option<Home> {
        let home = self.thread.take()?.join();
        Some(home.unwrap_or_else(|panic| std::panic::resume_unwind(panic)))
    }
}

impl Drop for Drawing {
    fn drop(&mut self) {
        self.painting().abandon();
    }
}
