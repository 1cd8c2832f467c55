//! A picture that the CPU draws beside the window: its session leaves for a thread of the picture's own, streams and draws there, and comes home with
//! the picture. Until then the window shows what is drawn so far, and answers by what the session has told last. Costs a thread for each picture, and a
//! copy of the draw lists for each step of streaming.

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

/// When the window shows a picture that is done. By a delay of none egui would paint the window twice.
const AT_ONCE: Duration = Duration::from_millis(1);

/// A session, and the quality of its pictures.
pub(super) struct Engine {
    pub(super) session: Session,
    pub(super) control: QualityControl,
}

/// Answers to a window that asks while its session is away.
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
    /// What a session knows, which shows this scene.
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

/// A step of streaming that a session has taken beside the window.
pub(super) struct News {
    pub(super) known: Known,
    pub(super) frame: Frame,
    /// How the frame is drawn; `None` while the session waits for bricks or a time step.
    pub(super) begun: Option<Begun>,
}

/// A picture that is begun.
#[derive(Clone, Copy)]
pub(super) struct Begun {
    pub(super) quality: Quality,
    /// Whether its view moves: what was shown before is of another one.
    pub(super) is_of_motion: bool,
    pub(super) at: Instant,
}

/// What the window and a session share that draws beside it.
pub(super) struct Stage {
    /// The picture as it is so far, and whether it is given up.
    pub(super) painting: Arc<Painting>,
    /// The last step of streaming of which the window has not heard.
    news: Mutex<Option<News>>,
    meeting: Meeting,
}

impl Stage {
    /// Tells the window of a step of streaming.
    pub(super) fn tell(&self, session: &Session, frame: &Frame, begun: Option<Begun>) {
        let known = Known::of(session, Some(&frame.scene));
        let news = News { known, frame: frame.clone(), begun };
        *self.news.lock().unwrap_or_else(PoisonError::into_inner) = Some(news);
    }
}

/// What a session comes home with.
pub(super) enum Done {
    /// Nothing: it was told to stop.
    Nothing,
    /// A picture of the scene.
    Picture { picture: Picture, shown: Box<Shown>, times: FrameTimes },
    /// A sample of the pixels of the picture that is shown, and how long it took.
    Sample(Picture, Duration),
    /// A picture to be saved, and its frame.
    Capture(Picture, Box<Frame>),
}

/// A session that comes home.
pub(super) struct Home {
    pub(super) engine: Box<Engine>,
    pub(super) done: Result<Done, SessionError>,
}

/// A picture that is being drawn. Dropping it gives the picture up, and does not wait.
pub(super) struct Drawing {
    stage: Arc<Stage>,
    since: Instant,
    /// How the picture is drawn, as far as the window has heard; the outer `None` before the first step of streaming is done.
    begun: Option<Option<Begun>>,
    thread: Option<JoinHandle<Home>>,
}

impl Drawing {
    /// Sends a session to draw. The window is painted again when it is done.
    ///
    /// # Errors
    /// If there is no thread for it; the session is lost.
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

    /// The last step of streaming, unless the window has heard of it already.
    pub(super) fn hear(&mut self) -> Option<News> {
        let news = self.stage.news.lock().unwrap_or_else(PoisonError::into_inner).take()?;
        self.begun = Some(news.begun);
        Some(news)
    }

    /// The picture that the session draws, as far as the window has heard; `None` while it only streams.
    pub(super) fn begun(&self) -> Option<Begun> {
        self.begun.flatten()
    }

    /// Whether the session is in its first step of streaming, as far as the window has heard.
    pub(super) fn is_in_first_step(&self) -> bool {
        self.begun.is_none()
    }

    /// Whether the session waits to be taken home.
    pub(super) fn is_over(&self) -> bool {
        // A thread that panicked has only ended.
        self.stage.meeting.is_due() || self.thread.as_ref().is_none_or(JoinHandle::is_finished)
    }

    /// Waits until the session is to be taken home, for so long at most. Returns whether it is.
    pub(super) fn wait(&self, at_most: Duration) -> bool {
        self.stage.meeting.wait(at_most)
    }

    /// Since when the session is away.
    pub(super) fn since(&self) -> Duration {
        self.since.elapsed()
    }

    /// The share of the picture that is drawn.
    pub(super) fn progress(&self) -> f64 {
        self.stage.painting.progress()
    }

    /// The picture as it is so far.
    pub(super) fn so_far(&self) -> Picture {
        self.stage.painting.so_far()
    }

    /// Tells it to stop, which takes a step of streaming at most, and milliseconds while it draws.
    pub(super) fn abandon(&self) {
        self.stage.painting.abandon();
    }

    /// Whether it was told to stop.
    pub(super) fn is_abandoned(&self) -> bool {
        self.stage.painting.is_abandoned()
    }

    /// Takes the session home, and waits for that. A panic of its goes on here.
    pub(super) fn end(mut self) -> Option<Home> {
        let home = self.thread.take()?.join();
        Some(home.unwrap_or_else(|panic| std::panic::resume_unwind(panic)))
    }
}

impl Drop for Drawing {
    fn drop(&mut self) {
        self.abandon();
    }
}
