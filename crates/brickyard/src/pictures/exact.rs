//! Exact pictures in passes: every brick of a view at its own level, however few slots there are, in passes from back
//! to front into one target. Only `sorted` can blend later passes over earlier ones, so this needs a GPU, possibly a
//! software one.

use crate::memory::ProcessMemory;
use crate::session::backend::{BackendChoice, BackendError, CompositorChoice, Pictures, layer_needs};
use crate::session::device::Device;
use crate::session::gpu_backend;
use crate::session::resolve::slot_contents;
use crate::session::{ResolvedScene, SessionOptions};
use crate::stats::{BrickCounts, ByteCounts, RenderStats, ms};
use brickyard_pager::{BrickSource, ExactError, ExactPasses, Next, PagerConfig, Planning, View};
use brickyard_render::{GpuError, GpuPreference, GpuRenderer};
use brickyard_volume::{FrameSettings, Needs, Picture, SlotEncoding};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Errors in drawing an exact picture in passes.
#[derive(Debug, thiserror::Error)]
pub enum ExactPictureError {
    /// The options choose the CPU backend, or rays. Neither keeps a picture between passes from back to front.
    #[error(
        "a picture drawn in passes from back to front needs a GPU (a software one will do) and the sorted compositor"
    )]
    Way,
    /// The scene is not a single layer in its own world.
    #[error("passes draw a single volume in its own world")]
    Mixed,
    /// There is no GPU, it has too little memory, or its device was lost.
    #[error(transparent)]
    Backend(#[from] BackendError),
    /// The bricks cannot be listed or read.
    #[error(transparent)]
    Passes(#[from] ExactError),
    /// The picture was not finished in time.
    #[error("the picture is not finished after {waited_s:.1} s: {drawn} of {cells} bricks are drawn")]
    TooLong {
        /// Seconds waited.
        waited_s: f64,
        /// Number of bricks drawn so far.
        drawn: usize,
        /// Number of bricks in the picture.
        cells: usize,
    },
}

impl From<GpuError> for ExactPictureError {
    fn from(error: GpuError) -> Self {
        Self::Backend(error.into())
    }
}

/// Interval of checking the time while waiting for a brick.
const POLL: Duration = Duration::from_millis(50);

/// Losses of the device before giving up a picture.
const MAX_LOSSES: u32 = 3;

/// Draws exact pictures of one volume on a GPU, in passes from back to front.
pub struct ExactRenderer {
    source: Arc<dyn BrickSource>,
    renderer: GpuRenderer,
    backend_line: String,
    config: PagerConfig,
}

impl ExactRenderer {
    /// Creates a renderer for a source, on a GPU. `encoding` is the pictures' slot encoding, `bricks` are their
    /// requirements on bricks, and `max_size_px` is the largest size.
    ///
    /// # Errors
    /// If the options choose the CPU or rays, there is no GPU, or a budget is too small.
    pub fn new(
        source: Arc<dyn BrickSource>,
        encoding: SlotEncoding,
        bricks: Needs,
        max_size_px: (u32, u32),
        options: &SessionOptions,
    ) -> Result<Self, ExactPictureError> {
        let casts_rays = matches!(options.compositor, CompositorChoice::Raycast | CompositorChoice::Compute);
        if options.backend == BackendChoice::Cpu || casts_rays {
            return Err(ExactPictureError::Way);
        }
        let options = SessionOptions { compositor: CompositorChoice::Sorted, ..*options };
        let needs = layer_needs(&*source, encoding, bricks, false);
        let pictures = Pictures { size_px: max_size_px, has_expressions: false };
        let (renderer, backend_line) =
            gpu_backend::open(GpuPreference::Any, &mut Device::default(), &[needs], &pictures, &options)?;
        let config = PagerConfig {
            slots: renderer.slots(0),
            apron: needs.bricks.apron,
            gradient_layers: needs.bricks.gradient_layers,
            host_bytes: options.host_memory_bytes.saturating_sub(needs.bricks.meshes.bytes()),
            contents: Vec::new(),
            // Each is used once.
            keeps_decoded: false,
            workers: options.threads as u32,
            planning: Planning::Inline,
            prefetch: false,
            uploads: None,
            fade: None,
        };
        Ok(Self { source, renderer, backend_line, config })
    }

    /// Description of the backend: the adapter and its driver.
    pub fn backend_line(&self) -> &str {
        &self.backend_line
    }

    /// The GPU renderer of the pictures.
    pub fn renderer(&self) -> &GpuRenderer {
        &self.renderer
    }

    /// Draws an exact picture of a scene, and adds to `stats`. `started` is the start of the whole run. A lost device
    /// is created anew and the picture starts again. The eyes of a stereo pair are drawn in turn, since they share
    /// neither slots nor order.
    ///
    /// # Errors
    /// If the scene is not a single layer in its own world, a part of it can be drawn from no level at all, the cells
    /// do not fit the host budget, `max_wait` passes, or the device fails.
    pub fn render(
        &mut self,
        scene: &ResolvedScene,
        max_wait: Duration,
        started: Instant,
        stats: &mut RenderStats,
    ) -> Result<Picture, ExactPictureError> {
        let begun = Instant::now();
        self.renderer.draw_until(begun.checked_add(max_wait));
        let mut losses = 0;
        let picture = loop {
            match self.try_scene(scene, begun, max_wait, stats) {
                Err(ExactPictureError::Backend(error)) if error.is_loss() && losses < MAX_LOSSES => {
                    losses += 1;
                    tracing::warn!("{error}; the device is opened again");
                    stats.device_losses += 1;
                    self.renderer.renew()?;
                    self.renderer.draw_until(begun.checked_add(max_wait));
                    self.config.slots = self.renderer.slots(0);
                }
                drawn => break drawn?,
            }
        };
        if stats.frames == 0 {
            (stats.first_image_ms, stats.settled_ms) = (ms(started), ms(started));
        }
        stats.frames += 1;
        Ok(picture)
    }

    fn try_scene(
        &mut self,
        scene: &ResolvedScene,
        begun: Instant,
        max_wait: Duration,
        stats: &mut RenderStats,
    ) -> Result<Picture, ExactPictureError> {
        if !scene.is_alone() {
            return Err(ExactPictureError::Mixed);
        }
        let layer = &scene.layers[0];
        self.config.contents = vec![slot_contents(&layer.frames[0].settings.encoding, layer.codes.as_ref())];
        scene.supersampled(|scene| {
            // Each sample has its own passes.
            stats.passes = Some(0);
            let layer = &scene.layers[0];
            scene.picture(|eye| {
                let view = if eye == 0 { layer.view.clone() } else { layer.view.from_other_eye() };
                self.try_render(&view, &layer.frames[eye].settings, begun, max_wait, stats)
            })
        })
    }

    fn try_render(
        &mut self,
        view: &View,
        frame: &FrameSettings,
        begun: Instant,
        max_wait: Duration,
        stats: &mut RenderStats,
    ) -> Result<Picture, ExactPictureError> {
        let pyramid = self.source.pyramid();
        let mut picture = self.renderer.passes(frame, pyramid)?;
        loop {
            let mut passes = ExactPasses::new(self.source.clone(), view, &self.config)?;
            let mut level_cells = vec![0; pyramid.levels().len()];
            let mut stand_ins = 0;
            loop {
                match passes.next(POLL)? {
                    Next::Upload(upload) => picture.upload(upload.slot, &upload.codes)?,
                    Next::Draw(list) => {
                        for cell in &list.cells {
                            level_cells[cell.brick.level.index()] += 1;
                            stand_ins += (cell.brick != cell.cell) as u64;
                        }
                        match picture.draw(&list) {
                            Err(GpuError::TooLong) => {}
                            drawn => drawn?,
                        }
                    }
                    Next::Wait => {}
                    Next::Done => break,
                }
                if begun.elapsed() > max_wait {
                    let (waited_s, drawn, cells) = (begun.elapsed().as_secs_f64(), passes.drawn(), passes.cells());
                    return Err(ExactPictureError::TooLong { waited_s, drawn, cells });
                }
            }
            record(stats, &passes, stand_ins);
            (stats.pixel_error, stats.level_cells) = (view.pixel_error, level_cells);
            // Between two layers of meshes all bricks are uploaded again: no pass keeps any for the next.
            if !picture.next_slab()? {
                break;
            }
        }
        let picture = picture.finish()?;
        stats.gpu_bytes_peak = stats.gpu_bytes_peak.max(self.renderer.gpu_bytes());
        Ok(picture)
    }
}

fn record(stats: &mut RenderStats, passes: &ExactPasses, stand_ins: u64) {
    let (memory, counters, cells) = (ProcessMemory::now(), passes.counters(), passes.cells() as u64);
    stats.passes = stats.passes.map(|before| before + passes.passes());
    stats.host_bytes_peak = stats.host_bytes_peak.max(passes.host_bytes_peak());
    stats.rss_peak = memory.resident_peak_bytes;
    stats.anonymous_peak = stats.anonymous_peak.max(memory.anonymous_bytes);
    let uploaded = stats.bricks.uploaded + counters.uploaded;
    stats.bricks = BrickCounts {
        wanted: cells,
        resident: cells - stand_ins,
        uploaded,
        reuploaded: 0,
        failed: stand_ins,
        unreadable: stats.bricks.unreadable + counters.failed,
    };
    stats.bytes = ByteCounts {
        read: stats.bytes.read + counters.bytes_read,
        decoded: stats.bytes.decoded + counters.bytes_decoded,
        uploaded: stats.bytes.uploaded + counters.bytes_uploaded,
    };
    stats.completeness = if cells == 0 { 1.0 } else { (cells - stand_ins) as f64 / cells as f64 };
    stats.effective_pixel_error = Some(passes.effective_error_px()).filter(|error| error.is_finite());
}
