//! The pictures of a window: the scene's, and the slices beside it in some layouts. Each has its own session; together they stay within the window's
//! memory limits.

use crate::canvas::{Canvas, FrameTimes, STREAMING_STEP};
use crate::device::Device;
use crate::state::{Layout, WindowState};
use brickyard::backend::BackendChoice;
use brickyard::session::{SessionError, SessionOptions, VolumeSource};
use std::time::Duration;

/// Share of the window's memory for each of three slices, in percent: a slice meets few bricks.
const PLANE_PERCENT: u64 = 12;

/// The pictures of a window.
pub(crate) struct Views {
    volumes: Vec<VolumeSource>,
    options: SessionOptions,
    /// The window's device; `None` before it is opened.
    device: Option<Device>,
    /// The scene's own picture.
    pub(crate) main: Canvas,
    /// The slices across the voxels' x, y and z axis; empty in other layouts.
    pub(crate) planes: Vec<Canvas>,
}

impl Views {
    /// Creates the pictures of a window to be opened.
    ///
    /// # Errors
    /// If there is no session for them.
    pub(crate) fn new(volumes: Vec<VolumeSource>, options: SessionOptions) -> Result<Self, SessionError> {
        let main = Canvas::new(volumes.clone(), &options, None)?;
        Ok(Self { volumes, options, device: None, main, planes: Vec::new() })
    }

    /// Moves to another device; `is_on_cpu` leaves the volumes to the CPU from now on.
    ///
    /// # Errors
    /// If the device is unfit for the engine.
    pub(crate) fn set_device(&mut self, device: Device, is_on_cpu: bool) -> Result<(), SessionError> {
        if is_on_cpu {
            self.options.backend = BackendChoice::Cpu;
        }
        let options = SessionOptions { ..self.options };
        self.all_mut().try_for_each(|canvas| canvas.set_device(&options, &device))?;
        self.device = Some(device);
        Ok(())
    }

    pub(crate) fn device(&self) -> Option<&Device> {
        self.device.as_ref()
    }

    pub(crate) fn volumes(&self) -> &[VolumeSource] {
        &self.volumes
    }

    /// Shows other volumes. The old pictures stay until there are new ones.
    ///
    /// # Errors
    /// If the device is not available any more.
    pub(crate) fn set_volumes(&mut self, volumes: Vec<VolumeSource>) -> Result<(), SessionError> {
        let (options, device) = (SessionOptions { ..self.options }, self.device.clone());
        self.all_mut().try_for_each(|canvas| canvas.begin_anew(volumes.clone(), &options, device.as_ref()))?;
        self.volumes = volumes;
        Ok(())
    }

    /// Switches to later states of the volumes, such as stores with more time steps. The pictures stay until there are new ones, and playback
    /// continues.
    pub(crate) fn follow_volumes(&mut self, volumes: Vec<VolumeSource>) {
        self.all_mut().for_each(|canvas| canvas.set_volumes(volumes.clone()));
        self.volumes = volumes;
    }

    /// Memory limits of all pictures together, in bytes: for slots, tables and targets, and for decoded bricks, including previews'.
    pub(crate) fn budgets_bytes(&self, window: &WindowState) -> (u64, u64) {
        let SessionOptions { gpu_memory_bytes, cpu_memory_bytes, host_memory_bytes, .. } = self.options;
        let backend_bytes = if self.main.draws_on_cpu() { cpu_memory_bytes } else { gpu_memory_bytes };
        window.budgets_mib.map_or((backend_bytes, host_memory_bytes), |budgets| {
            (u64::from(budgets.gpu) << 20, u64::from(budgets.host) << 20)
        })
    }

    /// Memory held by volumes outside the pictures' budgets, in bytes.
    pub(crate) fn held_bytes(&self) -> u64 {
        self.volumes.iter().map(VolumeSource::held_bytes).sum()
    }

    /// Bytes of slots, tables and targets, and of host memory, in use by all pictures or reserved for previews.
    pub(crate) fn memory_bytes(&self) -> (u64, u64) {
        let of_pictures = self.all().map(Canvas::memory_bytes);
        of_pictures.fold((0, self.held_bytes()), |sum, of| (sum.0 + of.0, sum.1 + of.1))
    }

    /// Adapts the pictures to a window's settings: their number, motion and memory. `between` is the window's own work per frame.
    ///
    /// # Errors
    /// If the device is unfit for the engine.
    pub(crate) fn suit(&mut self, window: &WindowState, between: Duration) -> Result<(), SessionError> {
        let count = if window.layout == Layout::Planes { 3 } else { 0 };
        self.planes.truncate(count);
        let (gpu, host) = self.budgets_bytes(window);
        // Previews take their memory once, however many pictures show them.
        let budgets = (gpu, host.saturating_sub(self.held_bytes()));
        let share = |percent: u64| (budgets.0 / 100 * percent, budgets.1 / 100 * percent);
        let of_plane = share(PLANE_PERCENT);
        // The scene gets the memory that slices leave.
        let (gpu, host) = (budgets.0 - count as u64 * of_plane.0, budgets.1 - count as u64 * of_plane.1);
        self.main.set_budgets(gpu, host);
        while self.planes.len() < count {
            let (gpu_memory_bytes, host_memory_bytes) = of_plane;
            let cpu_memory_bytes = gpu_memory_bytes;
            let options = SessionOptions { gpu_memory_bytes, cpu_memory_bytes, host_memory_bytes, ..self.options };
            self.planes.push(Canvas::new(self.volumes.clone(), &options, self.device.as_ref())?);
        }
        self.planes.iter_mut().for_each(|plane| plane.set_budgets(of_plane.0, of_plane.1));
        let goal = Duration::try_from_secs_f64(window.motion.frame_goal_ms / 1e3).unwrap_or(Duration::from_millis(50));
        self.main.set_frame_goal(goal, between);
        self.planes.iter_mut().for_each(|plane| plane.set_frame_goal(goal / 3, between / 3));
        for canvas in self.all_mut() {
            canvas.is_adaptive = window.motion.adaptive;
        }
        self.main.is_patient = window.motion.adaptive && self.device.as_ref().is_some_and(Device::is_software);
        // Slices follow the scene's own picture.
        self.main.play(window.play.playback());
        Ok(())
    }

    /// All pictures, the scene's own first.
    pub(crate) fn all(&self) -> impl Iterator<Item = &Canvas> {
        std::iter::once(&self.main).chain(&self.planes)
    }

    /// Takes the time spent since the last call.
    pub(crate) fn take_spent(&mut self) -> FrameTimes {
        let spent = self.all_mut().map(|canvas| std::mem::take(&mut canvas.spent));
        spent.fold(FrameTimes::default(), FrameTimes::and)
    }

    fn all_mut(&mut self) -> impl Iterator<Item = &mut Canvas> {
        std::iter::once(&mut self.main).chain(&mut self.planes)
    }

    /// Delay until the next check on unfinished pictures.
    pub(crate) fn look_after(&self) -> Duration {
        let open = self.all().filter(|canvas| !canvas.is_final());
        open.map(Canvas::look_after).min().unwrap_or(STREAMING_STEP)
    }

    pub(crate) fn are_failing(&self) -> bool {
        self.all().any(Canvas::is_failing)
    }

    /// Whether all pictures are complete until something changes.
    pub(crate) fn are_final(&self) -> bool {
        self.all().all(Canvas::is_final) && !self.main.is_capturing()
    }
}
