//! The picture in the window: a live session draws the scene into a texture, on the window's own device or on the CPU, at the quality that the hand's
//! pace allows. At rest it is drawn once more, exactly, and then not again. Costs one step and at most one drawing for each frame of the window.

use brickyard::backend::BackendChoice;
use brickyard::frame_governor::{Change, Quality, QualityControl};
use brickyard::pager::Status;
use brickyard::render::{Gpu, Target, wgpu};
use brickyard::session::{Frame, Session, SessionError, SessionOptions, VolumeSource};
use brickyard::stats::RenderStats;
use brickyard::volume::{Picture, Scene, SceneError};
use eframe::egui::{self, ColorImage, TextureHandle, TextureId, TextureOptions};
use eframe::egui_wgpu::RenderState;
use std::time::{Duration, Instant};

/// How long a frame may take while the view moves.
const FRAME_GOAL: Duration = Duration::from_millis(50);

/// The format of the texture: egui blends in display-referred codes.
const FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba8Unorm;

/// A session and the texture that shows its picture.
pub(crate) struct Canvas {
    session: Session,
    screen: Screen,
    control: QualityControl,
    /// Whether the picture is drawn coarser while the view moves.
    pub(crate) is_adaptive: bool,
    shown: Option<Shown>,
}

/// Where the picture is.
enum Screen {
    /// In a texture of the window's device.
    Gpu { state: RenderState, texture: Option<GpuTexture> },
    /// In a texture that egui fills with pixels from the CPU.
    Cpu { texture: Option<TextureHandle> },
}

struct GpuTexture {
    view: wgpu::TextureView,
    id: TextureId,
    size_px: (u32, u32),
}

/// What the texture shows.
struct Shown {
    scene: Scene,
    size_px: (u32, u32),
    frame: Frame,
    quality: Quality,
    /// Whether the picture is as it will stay: all bricks, every pixel.
    is_final: bool,
}

impl Canvas {
    /// Makes a session of volumes, on the window's device unless the options say the CPU, or leave the choice and the device is a software one.
    ///
    /// # Errors
    /// If the device lacks what the engine needs.
    pub(crate) fn new(
        volumes: Vec<VolumeSource>,
        options: &SessionOptions,
        state: &RenderState,
    ) -> Result<Self, SessionError> {
        let is_software = state.adapter.get_info().device_type == wgpu::DeviceType::Cpu;
        let is_on_cpu = match options.backend {
            BackendChoice::Cpu => true,
            BackendChoice::Auto => is_software,
            BackendChoice::Gpu => false,
        };
        let options = SessionOptions { live: true, ..*options };
        let (session, screen) = if is_on_cpu {
            let options = SessionOptions { backend: BackendChoice::Cpu, ..options };
            (Session::new(volumes, options), Screen::Cpu { texture: None })
        } else {
            let gpu = Gpu::from_device(&state.adapter, state.device.clone(), state.queue.clone())
                .map_err(brickyard::backend::BackendError::from)?;
            (Session::on_gpu(volumes, options, gpu), Screen::Gpu { state: state.clone(), texture: None })
        };
        Ok(Self { session, screen, control: QualityControl::new(FRAME_GOAL), is_adaptive: true, shown: None })
    }

    /// Brings the texture nearer to a scene's picture of a size: streams a step, and draws unless what is shown still stands.
    ///
    /// # Errors
    /// If the scene cannot be drawn, or the device fails. The texture keeps what it shows.
    pub(crate) fn show(
        &mut self,
        egui: &egui::Context,
        scene: &Scene,
        size_px: (u32, u32),
    ) -> Result<(), SessionError> {
        let is_same = |shown: &Shown| shown.scene == *scene && shown.size_px == size_px;
        if self.shown.as_ref().is_some_and(|shown| is_same(shown) && shown.is_final) {
            return Ok(());
        }
        let frame = self.session.step(scene, size_px)?;
        // What still streams is drawn as a moving view is: the exact picture comes once, when all is there.
        let moved = !(self.shown.as_ref().is_some_and(is_same) && frame.status.settled);
        let quality = self.control.next(Change { moved, refined: true }).unwrap_or(Quality::EXACT);
        let quality = if self.is_adaptive { quality } else { Quality::EXACT };
        let drawn = quality.frame(&frame);
        let is_whole = match &mut self.screen {
            Screen::Gpu { state, texture } => {
                let texture = sized(texture, state, size_px);
                let target = Target { view: &texture.view, format: FORMAT, area_px: None };
                let mut encoder = state.device.create_command_encoder(&Default::default());
                let is_this = self.session.draw_to(&drawn, &target, &mut encoder)?;
                state.queue.submit([encoder.finish()]);
                self.session.gpu_time().into_iter().for_each(|time| self.control.took(time));
                is_this
            }
            Screen::Cpu { texture } => {
                let begun = Instant::now();
                let picture = self.session.draw(&drawn)?;
                self.control.took(begun.elapsed());
                put(texture, egui, &picture, (picture.width, picture.height) == size_px);
                true
            }
        };
        let is_final = is_whole && frame.status.settled && quality == Quality::EXACT;
        self.shown = Some(Shown { scene: scene.clone(), size_px, frame, quality, is_final });
        Ok(())
    }

    /// The texture with the picture; `None` before the first one.
    pub(crate) fn texture(&self) -> Option<TextureId> {
        match &self.screen {
            Screen::Gpu { texture, .. } => texture.as_ref().map(|texture| texture.id),
            Screen::Cpu { texture } => texture.as_ref().map(TextureHandle::id),
        }
    }

    /// Whether the picture is as it will stay until the scene changes.
    pub(crate) fn is_final(&self) -> bool {
        self.shown.as_ref().is_some_and(|shown| shown.is_final)
    }

    /// How far the view is; `None` before the first picture.
    pub(crate) fn status(&self) -> Option<&Status> {
        self.shown.as_ref().map(|shown| &shown.frame.status)
    }

    /// The share of the exact picture's work that was done for the one that is shown.
    pub(crate) fn quality(&self) -> f64 {
        self.shown.as_ref().map_or(0.0, |shown| shown.quality.share())
    }

    /// A line that says where the picture is drawn.
    pub(crate) fn backend_line(&self) -> &str {
        self.session.backend_line()
    }

    /// Bytes of the backend's memory, and of host memory, in use.
    pub(crate) fn memory_bytes(&self) -> (u64, u64) {
        (self.session.backend_bytes(), self.status().map_or(0, |status| status.host_bytes))
    }

    /// Whether a scene can be shown.
    ///
    /// # Errors
    /// If not: the reason.
    pub(crate) fn check(&self, scene: &Scene) -> Result<(), SceneError> {
        self.session.check(scene)
    }

    /// The pixels of the picture that is shown, with its scene, in which nothing is left open, and how many bricks it has. `None` before the first picture.
    ///
    /// # Errors
    /// If the picture cannot be drawn.
    pub(crate) fn picture(&mut self) -> Result<Option<(Picture, Scene, RenderStats)>, SessionError> {
        let Some(shown) = &mut self.shown else { return Ok(None) };
        let picture = self.session.draw(&shown.frame)?;
        // It was drawn where the texture's picture comes from.
        shown.is_final = false;
        let mut stats = RenderStats::default();
        stats.record(&shown.frame.status, self.session.backend_bytes());
        Ok(Some((picture, shown.frame.scene.shown(&shown.scene), stats)))
    }
}

/// The texture in the size that is wanted, made anew if it has another one.
fn sized<'a>(texture: &'a mut Option<GpuTexture>, state: &RenderState, size_px: (u32, u32)) -> &'a GpuTexture {
    let made = || {
        let texture = state.device.create_texture(&wgpu::TextureDescriptor {
            label: Some("volume"),
            size: wgpu::Extent3d { width: size_px.0, height: size_px.1, depth_or_array_layers: 1 },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: FORMAT,
            usage: wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::TEXTURE_BINDING,
            view_formats: &[],
        });
        texture.create_view(&Default::default())
    };
    let nearest = wgpu::FilterMode::Nearest;
    let mut renderer = state.renderer.write();
    match texture {
        Some(known) if known.size_px == size_px => {}
        Some(known) => {
            (known.view, known.size_px) = (made(), size_px);
            renderer.update_egui_texture_from_wgpu_texture(&state.device, &known.view, nearest, known.id);
        }
        None => {
            let view = made();
            let id = renderer.register_native_texture(&state.device, &view, nearest);
            *texture = Some(GpuTexture { view, id, size_px });
        }
    }
    texture.get_or_insert_with(|| unreachable!("it has just been made"))
}

/// Puts a picture from the CPU into the texture: pixel by pixel if it has the size that is shown, else smoothed.
fn put(texture: &mut Option<TextureHandle>, egui: &egui::Context, picture: &Picture, is_sized: bool) {
    let size = [picture.width as usize, picture.height as usize];
    let image = ColorImage::from_rgb(size, picture.rgb.as_flattened());
    let options = if is_sized { TextureOptions::NEAREST } else { TextureOptions::LINEAR };
    match texture {
        Some(texture) => texture.set(image, options),
        None => *texture = Some(egui.load_texture("volume", image, options)),
    }
}
