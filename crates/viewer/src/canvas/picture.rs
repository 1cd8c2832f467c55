//! The picture that is wanted, the one that is shown, and what a step of streaming makes of the two. Pure.

use brickyard::frame_governor::{Change, Quality, QualityControl};
use brickyard::session::Frame;
use brickyard::volume::Scene;

/// A picture that is wanted.
#[derive(Clone)]
pub(super) struct Wanted {
    pub(super) scene: Scene,
    pub(super) size_px: (u32, u32),
    /// Whether the session says which time step it is of, as it does while steps play.
    pub(super) is_paced: bool,
    /// How often another scene was asked for until then.
    pub(super) change: u64,
}

impl Wanted {
    /// Whether this picture is wanted still, if the other one is.
    pub(super) fn is_as(&self, other: &Self) -> bool {
        self.scene == other.scene && self.size_px == other.size_px
    }

    /// The same of the time step that a frame has.
    pub(super) fn at(&self, frame: &Frame) -> Self {
        let time = if self.is_paced { frame.scene.time } else { self.scene.time };
        Self { scene: Scene { time, ..self.scene.clone() }, ..*self }
    }
}

/// A picture that is shown, or is about to be.
#[derive(Clone)]
pub(super) struct Shown {
    pub(super) scene: Scene,
    pub(super) size_px: (u32, u32),
    pub(super) frame: Frame,
    pub(super) quality: Quality,
    /// How often another scene had been asked for when it was sent for.
    pub(super) change: u64,
    /// How many of its pixels' samples are still to be drawn; 0 if the picture is as it will stay. `None` before it has all bricks and every pixel.
    pub(super) samples_left: Option<usize>,
}

impl Shown {
    /// Whether it is a picture, maybe a coarser one, of what is wanted.
    pub(super) fn is_of(&self, wanted: &Wanted) -> bool {
        self.scene == wanted.scene && self.size_px == wanted.size_px
    }

    /// Whether a frame of what is wanted would look no better while steps play: until the next one is due.
    pub(super) fn stands(&self, wanted: &Wanted, frame: &Frame) -> bool {
        self.is_of(wanted) && self.frame.shows_as_much_as(frame)
    }

    /// Whether it is as good as a picture with this share of the exact one's work, of bricks that are not all there: it is better, or has all bricks that are as
    /// coarse as its pixels.
    pub(super) fn suffices(&self, share: f64) -> bool {
        let is_whole = self.frame.status.resident == self.frame.status.wanted;
        self.quality.share() > share || self.frame.level_bias > 0.0 && is_whole
    }
}

/// How pictures' quality is chosen.
pub(super) struct Choice<'a> {
    pub(super) control: &'a mut QualityControl,
    /// Whether the picture is coarser while the view moves, and whether it is refined step by step when it rests.
    pub(super) is_adaptive: bool,
    pub(super) is_gradual: bool,
}

impl Choice<'_> {
    /// The picture of a frame, which comes next after `shown`; and whether it is one of a view that moves. What still streams is drawn as that is: the exact
    /// picture comes once, when all is there.
    pub(super) fn next(self, wanted: Wanted, frame: Frame, shown: Option<&Shown>) -> (Shown, bool) {
        let before = shown.filter(|shown| shown.is_of(&wanted) && frame.status.settled);
        let moved = before.is_none();
        let quality = match before {
            Some(before) if self.is_gradual => self.control.refine(before.quality),
            _ => self.control.next(Change { moved, refined: true }).unwrap_or(Quality::EXACT),
        };
        let quality = if self.is_adaptive { quality.with_coarse_bricks(frame.level_bias) } else { Quality::EXACT };
        let Wanted { scene, size_px, change, .. } = wanted;
        (Shown { scene, size_px, frame, quality, change, samples_left: None }, moved)
    }
}
