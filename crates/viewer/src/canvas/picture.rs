//! The wanted and the shown picture, and the choice of the next one after a streaming step. Pure.

use brickyard::frame_governor::{Change, Quality, QualityControl};
use brickyard::session::Frame;
use brickyard::volume::Scene;

/// The wanted picture: scene, size and quality.
#[derive(Clone)]
pub(super) struct Wanted {
    pub(super) scene: Scene,
    pub(super) size_px: (u32, u32),
    /// Whether the session chooses the time step, as during playback.
    pub(super) is_paced: bool,
    /// Number of scene changes so far.
    pub(super) change: u64,
}

impl Wanted {
    /// Whether this picture is still wanted if `other` is.
    pub(super) fn is_as(&self, other: &Self) -> bool {
        self.scene == other.scene && self.size_px == other.size_px
    }

    /// The same picture at a frame's time step.
    pub(super) fn at(&self, frame: &Frame) -> Self {
        let time = if self.is_paced { frame.scene.time } else { self.scene.time };
        Self { scene: Scene { time, ..self.scene.clone() }, ..*self }
    }
}

/// A picture on display, or about to be.
#[derive(Clone)]
pub(super) struct Shown {
    /// The requested picture.
    pub(super) of: Wanted,
    pub(super) frame: Frame,
    pub(super) quality: Quality,
    /// Samples per pixel still to be drawn; 0 if the picture is complete. `None` until it has all bricks and every pixel.
    pub(super) samples_left: Option<usize>,
}

impl Shown {
    /// Whether it is the wanted picture, perhaps coarser.
    pub(super) fn is_of(&self, wanted: &Wanted) -> bool {
        self.of.is_as(wanted)
    }

    /// Whether a frame of the wanted picture would look no better during playback, until the next step is due.
    pub(super) fn stands(&self, wanted: &Wanted, frame: &Frame) -> bool {
        self.is_of(wanted) && self.frame.shows_as_much_as(frame)
    }

    /// Whether it is as good as one of missing bricks with this share of the exact work: it took more work, or has all bricks as coarse as its
    /// pixels.
    pub(super) fn suffices(&self, share: f64) -> bool {
        let is_whole = self.frame.status.resident == self.frame.status.wanted;
        self.quality.share() > share || self.frame.level_bias > 0.0 && is_whole
    }
}

/// Chooses the quality of pictures.
pub(super) struct Choice<'a> {
    pub(super) control: &'a mut QualityControl,
    /// Whether a moving view is drawn coarser, and a resting one refined step by step.
    pub(super) is_adaptive: bool,
    pub(super) is_gradual: bool,
}

impl Choice<'_> {
    /// Chooses the picture to follow `shown`, and whether its view moves. A streaming view counts as moving: the exact picture is drawn once, with
    /// all bricks.
    pub(super) fn next(self, wanted: Wanted, frame: Frame, shown: Option<&Shown>) -> (Shown, bool) {
        let before = shown.filter(|shown| shown.is_of(&wanted) && frame.status.settled);
        let moved = before.is_none();
        let quality = match before {
            Some(before) if self.is_gradual => self.control.refine(before.quality),
            _ => self.control.next(Change { moved, refined: true }).unwrap_or(Quality::EXACT),
        };
        let quality = if self.is_adaptive { quality.with_coarse_bricks(frame.level_bias) } else { Quality::EXACT };
        (Shown { of: wanted, frame, quality, samples_left: None }, moved)
    }
}
