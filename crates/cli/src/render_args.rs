//! The flags of `render`, and the settings derived from them.

use super::named::Named;
use super::sampling_args::SamplingArguments;
use super::scene_args::SceneArguments;
use super::session_args::{BACKENDS, SessionLimits};
use super::{heading, values};
use brickyard::backend::{BackendChoice, CompositorChoice};
use brickyard::movie_file::PictureRate;
use brickyard::overlay::Overlays;
use brickyard::session::SessionOptions;
use brickyard::volume::PixelSamples;
use clap::Args;
use std::path::PathBuf;
use std::time::Duration;

/// `brickyard render STORE... -o out.png`, or `--movie out.mp4`
#[derive(Args)]
pub(crate) struct RenderArguments {
    /// The store; or several, up to 32, in one picture, each in its own world or placed by --volume N:matrix=...
    #[arg(required = true)]
    pub(super) stores: Vec<PathBuf>,
    /// Output PNG; several pictures are numbered: out_000.png, ... - writes a single one to standard output
    #[arg(help_heading = heading::OUTPUT, short, long, value_name = "out.png", required_unless_present = "movie")]
    pub(super) output: Option<PathBuf>,
    /// Write the pictures into one movie instead: .gif (256 colours of each picture), .y4m (all pixels, uncompressed)
    /// or .mp4 (H.264, by the program ffmpeg, which must be installed). As in `--movie flow.mp4 --time all --rate 12`
    #[arg(help_heading = heading::OUTPUT, long, value_name = "out.gif|out.y4m|out.mp4", conflicts_with = "output")]
    pub(super) movie: Option<PathBuf>,
    /// Frames per second of the movie, to a thousandth: as in `--rate 29.97`
    #[arg(help_heading = heading::OUTPUT, long, value_name = "R", default_value = "24", allow_negative_numbers = true, conflicts_with = "output")]
    pub(super) rate: PictureRate,
    /// Picture size in pixels
    #[arg(help_heading = heading::OUTPUT, long, value_name = "WxH", default_value = "512x512", value_parser = values::size_px)]
    pub(super) size: (u32, u32),
    #[command(flatten)]
    pub(super) scene: SceneArguments,
    #[command(flatten)]
    pub(super) sampling: SamplingArguments,
    /// Samples of each pixel: more make edges smoother, and drawing proportionally slower [default: 4, or 1 in
    /// projections and slices, unless a scene file sets it]
    #[arg(help_heading = heading::SAMPLING, long, value_name = "1|2|4|8|16")]
    pub(super) aa: Option<PixelSamples>,
    /// Turn the camera once around its target in N pictures; with more time steps, in as many pictures as steps
    #[arg(help_heading = heading::CAMERA, long, value_name = "N", conflicts_with = "path")]
    pub(super) orbit: Option<u32>,
    /// Cameras of several pictures (JSON list), a picture each. A camera may have a time step, as in `{"eye": ...,
    /// "time": 40}`: cameras between two of those show the steps between, rounded down
    #[arg(help_heading = heading::CAMERA, long, value_name = "path.json")]
    pub(super) path: Option<PathBuf>,
    /// Make N pictures evenly along the path, from the first camera to the last, as in `--path path.json --frames 240`
    /// [default: one for each camera]
    #[arg(help_heading = heading::CAMERA, long, value_name = "N", requires = "path")]
    pub(super) frames: Option<u32>,
    /// Where to render; auto is a hardware GPU if there is one, else the CPU
    #[arg(help_heading = heading::DRAWING, long, value_parser = BACKENDS, default_value = "auto")]
    pub(super) backend: BackendChoice,
    /// How to render: sorted composites bricks back to front (GPU only), raycast follows each ray front to back,
    /// compute does so in compute shaders (GPU only); auto is raycast; reference holds whole levels in memory, in f64
    #[arg(help_heading = heading::DRAWING, long, value_parser = PICTURE_COMPOSITORS, default_value = "auto")]
    pub(super) compositor: PictureCompositor,
    /// Draw every brick wanted by the view, however few fit at once: one volume in passes on a GPU (a software one will
    /// do), if the compositor is sorted or auto; else in tiles
    #[arg(help_heading = heading::DRAWING, long)]
    pub(super) exact: bool,
    #[command(flatten)]
    pub(super) limits: SessionLimits,
    /// Give up on a picture not settled or not drawn after S seconds
    #[arg(help_heading = heading::DRAWING, long, value_name = "S", default_value = "600", value_parser = values::positive)]
    pub(super) max_wait: f64,
    /// Write statistics (JSON); - is standard output
    #[arg(help_heading = heading::OUTPUT, long, value_name = "stats.json")]
    pub(super) stats: Option<PathBuf>,
    /// Write no letters for a patient's sides on slices
    #[arg(help_heading = heading::OUTPUT, long)]
    pub(super) no_letters: bool,
    /// Draw a bar of a round length: in perspective, at the distance of the camera's target
    #[arg(help_heading = heading::OVERLAYS, long)]
    pub(super) scale_bar: bool,
    /// Draw colour bars: colours by value
    #[arg(help_heading = heading::OVERLAYS, long)]
    pub(super) color_bar: bool,
    /// Draw the box around the volumes, with ticks and units
    #[arg(help_heading = heading::OVERLAYS, long)]
    pub(super) axes: bool,
    /// Write a line of text, as in `--label "cell 12, 40 min"`
    #[arg(help_heading = heading::OVERLAYS, long, value_name = "TEXT")]
    pub(super) label: Option<String>,
    /// End with exit code 5 if bricks could not be read and coarser ones stand in; pictures are written all the same
    #[arg(help_heading = heading::OUTPUT, long)]
    pub(super) strict: bool,
    /// Replace existing pictures
    #[arg(help_heading = heading::OUTPUT, long)]
    pub(super) overwrite: bool,
}

/// A compositor; `None` is the reference.
type PictureCompositor = Option<CompositorChoice>;

const PICTURE_COMPOSITORS: Named<PictureCompositor> = Named(&[
    ("auto", Some(CompositorChoice::Auto), ""),
    ("sorted", Some(CompositorChoice::Sorted), ""),
    ("raycast", Some(CompositorChoice::Raycast), ""),
    ("compute", Some(CompositorChoice::Compute), ""),
    ("reference", None, ""),
]);

impl RenderArguments {
    pub(super) fn overlays(&self) -> Overlays {
        let Self { scale_bar, color_bar, axes, .. } = *self;
        Overlays { scale_bar, color_bar, axes, label: self.label.clone() }
    }

    pub(super) fn session_options(&self, compositor: CompositorChoice, pictures: usize) -> SessionOptions {
        SessionOptions { backend: self.backend, compositor, keeps_decoded: pictures > 1, ..self.limits.options() }
    }

    pub(super) fn max_wait(&self) -> Duration {
        Duration::from_secs_f64(self.max_wait.min(1e9))
    }
}
