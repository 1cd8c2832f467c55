//! A frame: the result of a session's step, which can be drawn. A value; copies share the scene.

use crate::session::player::ComingStep;
use crate::session::resolve::ResolvedScene;
use brickyard_pager::Status;
use brickyard_volume::PixelSample;
use std::sync::Arc;

/// The result of a step, which can be drawn. Its bricks keep their slots until the next step.
#[derive(Clone, Debug)]
pub struct Frame {
    /// The resolved scene. Anything that needs no other bricks may be changed before drawing: jitter, step length,
    /// resolution ([`Quality::frame`](crate::session::frame_governor::Quality::frame)).
    pub scene: Arc<ResolvedScene>,
    /// How far the view is: how many bricks it wants, how many are resident, and whether it has settled. A view has not settled while another
    /// time step than its own is shown.
    pub status: Status,
    /// The time steps that come next, the nearest first: of a live session that plays, or that has jumped to a step.
    pub coming: Vec<ComingStep>,
    /// By how many levels its bricks may be coarser than the scene asks for: see [`Session::step_coarse`](crate::session::Session::step_coarse).
    pub level_bias: f64,
    /// The number of the step.
    pub(crate) step: u64,
}

impl Frame {
    /// This frame with one sample of each of its pixels, to be drawn in its place: the mean of the pictures of all samples is [supersampled](brickyard_volume::supersampling).
    pub fn of_sample(&self, sample: PixelSample) -> Self {
        Self { scene: Arc::new(self.scene.of_sample(sample)), ..self.clone() }
    }

    /// Whether a picture of this frame has all that one of a later frame of the same scene has.
    pub fn shows_as_much_as(&self, later: &Self) -> bool {
        let what = |frame: &Self| (frame.scene.time, frame.status.resident, frame.status.wanted);
        what(self) == what(later)
    }

    /// Whether this frame is a copy of another one, so that both have the same picture.
    pub fn is_copy_of(&self, other: &Self) -> bool {
        self.step == other.step && Arc::ptr_eq(&self.scene, &other.scene)
    }
}

#[cfg(feature = "gpu")]
impl Frame {
    /// Whether this frame is of the step with this number.
    pub(crate) fn is_of(&self, step: u64) -> bool {
        self.step == step
    }
}

/// Parts of a frame that have been drawn.
#[cfg(feature = "gpu")]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Drawn {
    /// Nothing: shaders are compiled meanwhile, or [`Session::shows_before`](crate::session::Session::shows_before) says so.
    Nothing,
    /// Some rows, or a picture that may lack layers of translucent meshes.
    Partly,
    /// All of it.
    Whole,
}
