//! A session inside an application that draws with wgpu itself: on the application's device, from one thread, and without waiting.
//!
//! Each frame the application calls [`Session::step`], then [`Session::draw_to`] with an encoder of its own, and submits that. Uploads and
//! drawing are submitted by the session, before, on the same queue: into a texture of the session's own, from which `draw_to` records a
//! single pass. What rays have seen comes back by itself, some frames later, and says of which frame it is.

use crate::session::device::Device;
use crate::session::frame::{Drawn, Frame};
use crate::session::renderer::BackendError;
use crate::session::resolve::ResolvedScene;
use crate::session::shown_picture::ShownPicture;
use crate::session::{Session, SessionError, SessionOptions, VolumeSource};
use brickyard_render::wgpu::CommandEncoder;
use brickyard_render::{Compositor, Gpu, GpuRenderer, Target};
use brickyard_volume::Picture;
use std::ops::Range;
use std::time::Duration;

impl Session {
    /// A session of several volumes that draws on an application's device, whichever backend the options choose. Nothing is read or made
    /// before the first step.
    ///
    /// ```no_run
    /// use brickyard::render::{Gpu, Target, wgpu};
    /// use brickyard::{Scene, Session, SessionOptions, VolumeSource};
    ///
    /// fn draw(gpu: Gpu, device: &wgpu::Device, queue: &wgpu::Queue, texture: &wgpu::Texture) -> Result<(), Box<dyn std::error::Error>> {
    ///     let options = SessionOptions { live: true, ..SessionOptions::default() };
    ///     let mut session = Session::on_gpu(vec![VolumeSource::open("head-ct.zarr")?], options, gpu);
    ///     let view = texture.create_view(&Default::default());
    ///     loop {
    ///         let frame = session.step(&Scene::default(), (texture.width(), texture.height()))?;
    ///         let mut encoder = device.create_command_encoder(&Default::default());
    ///         let target = Target { view: &view, format: texture.format(), area_px: None };
    ///         let is_this_frame = session.draw_to(&frame, &target, &mut encoder)?;
    ///         // The application's own passes follow here.
    ///         queue.submit([encoder.finish()]);
    ///         if is_this_frame && frame.status.settled {
    ///             return Ok(());
    ///         }
    ///         session.wait(std::time::Duration::from_millis(10));
    ///     }
    /// }
    /// ```
    pub fn on_gpu(volumes: Vec<VolumeSource>, options: SessionOptions, gpu: Gpu) -> Self {
        let mut session = Self::new(volumes, options);
        session.move_to(Device::lent(gpu));
        session
    }

    /// Goes on with another device of the application's, for example after the one before was lost. Slots are filled
    /// anew from the bricks that are decoded.
    pub fn set_gpu(&mut self, gpu: Gpu) {
        self.move_to(Device::lent(gpu));
    }

    /// Puts a frame on an application's texture: submits what draws it, unless the session's own texture shows it already, and records one
    /// pass in the application's encoder. Nothing is waited for. Submit the encoder before the next call.
    ///
    /// Returns whether the target shows this frame, and all of it. While a thread compiles the shaders of a new kind of
    /// picture, and where [`Session::shows_before`] says so, the target shows the picture before; if there is none it stays as it was. While it is not known how
    /// many layers translucent meshes have, some layers may be missing.
    ///
    /// A view that has [settled](brickyard_pager::Status::settled) need not be stepped again before the scene changes.
    /// The same frame can be put on any texture, and is not drawn again.
    ///
    /// # Errors
    /// If the session does not draw on an application's device, the frame is an earlier step's, nothing can be drawn in
    /// the target's format, or the device is lost or out of memory.
    pub fn draw_to(
        &mut self,
        frame: &Frame,
        target: &Target<'_>,
        encoder: &mut CommandEncoder,
    ) -> Result<bool, SessionError> {
        let is_this = self.show(frame, None)? == Drawn::Whole;
        if let Some(shown) = self.on_texture() {
            let stereo = shown.scene.stereo;
            self.renderer()?.draw_to(stereo, target, encoder).map_err(BackendError::from)?;
        }
        Ok(is_this)
    }

    /// Draws some of a frame's [rows](crate::session::resolve::ResolvedScene::rows) into the session's own texture, from row 0 on, and nothing on an
    /// application's: for devices that take long for a whole picture, on whose queue an application's own work waits meanwhile. The right eye's rows
    /// follow the left eye's. Once the last row is drawn, [`Session::draw_to`] finds the frame there. There must be no other step before it. A picture
    /// with meshes is drawn as a whole with its last row.
    ///
    /// # Errors
    /// As [`Session::draw_to`].
    pub fn draw_rows(&mut self, frame: &Frame, rows: Range<u32>) -> Result<Drawn, SessionError> {
        let has_meshes = !frame.scene.layers[0].frames[0].settings.meshes.is_empty();
        match (has_meshes, rows.end >= frame.scene.rows()) {
            (false, _) => self.show(frame, Some(rows)),
            (true, true) => self.show(frame, None),
            (true, false) => Ok(Drawn::Partly),
        }
    }

    /// Has the session's own texture show a frame, or draws some rows of it.
    fn show(&mut self, frame: &Frame, rows: Option<Range<u32>>) -> Result<Drawn, SessionError> {
        self.renderer()?;
        let Some(fit) = self.fit.as_mut().filter(|_| frame.step == self.steps) else {
            return Err(SessionError::Superseded);
        };
        fit.hear()?;
        if rows.as_ref().is_none_or(|rows| rows.start == 0) {
            self.choose_compositor(&frame.scene);
        }
        let Some(fit) = &mut self.fit else { return Err(SessionError::Superseded) };
        let lacks_layers = fit.lacks_layers();
        let is_prepared = fit.is_prepared(&frame.scene);
        if !is_prepared {
            fit.prepare(&frame.scene);
        }
        if self.shows_before(frame) {
            return Ok(Drawn::Nothing);
        }
        let is_whole = |lacks_layers| if lacks_layers == Some(false) { Drawn::Whole } else { Drawn::Partly };
        if self.on_texture().is_some_and(|shown| shown.is_copy_of(frame)) && lacks_layers != Some(true) {
            return Ok(is_whole(lacks_layers));
        }
        if !is_prepared {
            return Ok(Drawn::Nothing);
        }
        self.shown = None;
        let compares = rows.is_none() && self.is_to_be_compared(frame);
        let Some(fit) = &mut self.fit else { return Err(SessionError::Superseded) };
        if compares && let Some(picture) = fit.show_by(Compositor::Raycast, &frame.scene)? {
            self.device.trial.ask(picture);
        }
        // Where `sorted` draws, which tells nothing, the pagers would wait for what `raycast` told of a scene before.
        let may_sort = self.device.trial.winner() != Some(Compositor::Raycast);
        let tells = self.options.live && !(may_sort && fit.backend.as_gpu().is_some_and(|gpu| gpu.switches()));
        if !fit.show(&frame.scene, rows, tells)? {
            return Ok(Drawn::Partly);
        }
        let lacks_layers = fit.lacks_layers();
        self.shown = Some(ShownPicture { frame: frame.clone(), pixels: None });
        Ok(is_whole(lacks_layers))
    }

    /// Takes the times of pictures into the device's trial, and has a renderer with two compositors draw a scene by the
    /// faster one: by `sorted` while that is unknown, and by `raycast` if `sorted` has no order for the scene.
    fn choose_compositor(&mut self, scene: &ResolvedScene) {
        let Self { fit: Some(fit), device: Device { trial, .. }, .. } = self else { return };
        let times_ms = std::mem::take(&mut fit.shown.times_ms);
        if fit.backend.as_gpu().is_none_or(|gpu| !gpu.switches()) {
            return;
        }
        let was_open = trial.winner().is_none();
        times_ms.into_iter().for_each(|(picture, ms)| trial.hear(picture, ms));
        if was_open {
            fit.backend_line.push_str(&trial.outcome());
        }
        let winner = trial.winner().unwrap_or(Compositor::Sorted);
        let compositor = if self.has_order(scene) { winner } else { Compositor::Raycast };
        self.fit.iter_mut().filter_map(|fit| fit.backend.as_gpu()).for_each(|gpu| _ = gpu.set_compositor(compositor));
    }

    /// Whether both compositors shall draw a frame: its bricks are all there, and the device's trial goes on.
    fn is_to_be_compared(&mut self, Frame { scene, status, .. }: &Frame) -> bool {
        let is_plain = scene.stereo.is_none() && scene.layers[0].frames[0].settings.meshes.is_empty();
        let is_open = self.device.trial.winner().is_none();
        let gpu = self.fit.as_mut().and_then(|fit| fit.backend.as_gpu());
        let is_sorted = gpu.is_some_and(|gpu| gpu.switches() && gpu.compositor() == Compositor::Sorted);
        is_plain && is_open && is_sorted && status.resident == status.wanted
    }

    /// Tries compositors on a software rasteriser, too: for tests.
    #[doc(hidden)]
    pub fn try_compositors(&mut self) {
        self.device.trial.takes_software = true;
    }

    /// The frame that the session's own texture shows; `None` while it shows nothing.
    fn on_texture(&self) -> Option<&Frame> {
        self.shown.as_ref().filter(|shown| shown.is_on_device()).map(|shown| &shown.frame)
    }

    /// Asks for the pixels of the picture that the session's own texture shows, without waiting; [`Session::picture`]
    /// returns them once they are there. Returns false, and does nothing, while the pixels of an earlier picture are on
    /// their way or if nothing has been drawn.
    ///
    /// # Errors
    /// If the session does not draw on an application's device, the device is lost, or there has been no step yet.
    pub fn read_back(&mut self) -> Result<bool, SessionError> {
        Ok(self.renderer()?.read_back().map_err(BackendError::from)?)
    }

    /// Returns the picture whose pixels [`Session::read_back`] has asked for; `None` while they are on their way, or if
    /// none was asked for. In stereo it is the right eye's picture.
    ///
    /// # Errors
    /// As [`Session::read_back`].
    pub fn picture(&mut self) -> Result<Option<Picture>, SessionError> {
        Ok(self.renderer()?.picture().map_err(BackendError::from)?)
    }

    /// Returns how long a picture took on the GPU, the last one of which that is known. `None` before there is one, or
    /// if the device has no timestamps.
    pub fn gpu_time(&self) -> Option<Duration> {
        let ms = self.fit.as_ref()?.shown.gpu_ms?;
        Some(Duration::from_secs_f64(ms.max(0.0) / 1e3))
    }

    /// Returns the longest time that the session has waited for the device since this method was last called. The first
    /// step waits, and a scene that asks for more than those before it, because slots and tables are made.
    /// [`Session::render`] and [`Session::draw`] wait for their pixels. Nothing else waits.
    ///
    /// # Errors
    /// If the session does not draw on an application's device, or there has been no step yet.
    pub fn take_longest_gpu_wait(&mut self) -> Result<Duration, SessionError> {
        Ok(self.renderer()?.gpu().take_longest_wait())
    }

    /// Holds back answers about pictures for a number of steps: for tests.
    #[doc(hidden)]
    pub fn answer_late(&mut self, steps: usize) {
        self.fit.iter_mut().for_each(|fit| fit.shown.late_steps = steps);
    }

    /// The renderer on the application's device. Before a step there is none, and no frame of its.
    fn renderer(&mut self) -> Result<&mut GpuRenderer, SessionError> {
        let renderer = self.fit.as_mut().and_then(|fit| fit.backend.as_gpu());
        let missing = if self.device.is_lent() { SessionError::Superseded } else { SessionError::NoDevice };
        renderer.filter(|renderer| renderer.never_waits()).ok_or(missing)
    }
}
