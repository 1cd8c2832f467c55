//! Frames: a frame is the result of a session's step, ready to draw. A value; copies share the scene.

use crate::session::player::ComingStep;
use crate::session::resolve::ResolvedScene;
use brickyard_pager::Status;
use brickyard_volume::PixelSample;
use std::sync::Arc;

/// The drawable result of a step. Its bricks keep their slots until the next step.
#[derive(Clone, Debug)]
pub struct Frame {
    /// The resolved scene. Settings without effect on the needed bricks may be changed before drawing: jitter, step
    /// length, resolution ([`Quality::frame`](crate::session::frame_governor::Quality::frame)).
    pub scene: Arc<ResolvedScene>,
    /// Progress of the view: its numbers of wanted and of resident bricks, and whether it has settled. A view is not
    /// settled while another time step than its own is shown.
    pub status: Status,
    /// The coming time steps, the nearest first: in a live session during playback or after a jump.
    pub coming: Vec<ComingStep>,
    /// Levels by which its bricks may be coarser than the scene's: see
    /// [`Session::step_coarse`](crate::session::Session::step_coarse).
    pub level_bias: f64,
    pub(crate) step: u64,
}

impl Frame {
    /// Returns this frame with one sample of each pixel, for drawing in its place: the mean of all samples' pictures is
    /// [supersampled](brickyard_volume::supersampling).
    pub fn of_sample(&self, sample: PixelSample) -> Self {
        Self { scene: Arc::new(self.scene.of_sample(sample)), ..self.clone() }
    }

    /// Whether a picture of this frame shows everything in a later frame of the same scene.
    pub fn shows_as_much_as(&self, later: &Self) -> bool {
        let what = |frame: &Self| (frame.scene.time, frame.status.resident, frame.status.wanted);
        what(self) == what(later)
    }

    /// Whether this frame is a copy of another one, and has the same picture.
    pub fn is_copy_of(&self, other: &Self) -> bool {
        self.step == other.step && Arc::ptr_eq(&self.scene, &other.scene)
    }
}

/// The drawn part of a frame.
#[cfg(feature = "gpu")]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Drawn {
    /// Nothing: shaders are still compiling, or [`Session::shows_before`](crate::session::Session::shows_before) is
    /// true.
    Nothing,
    /// Some rows, or a picture that may lack layers of translucent meshes.
    Partly,
    /// The whole frame.
    Whole,
}
