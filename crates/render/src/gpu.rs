//! A device and its queue, ours or an application's: creation, refusals, waits and loss.
//!
//! Our own device gets the adapter's limits for textures and buffers, and the optional features for our formats.
//! Uncaught errors and the device's loss are recorded and returned as typed errors by the next call. An application's
//! device keeps its own handlers: there, every call runs in its own error scopes.

use crate::GpuError;
use crate::adapter::{self, AdapterReport, GpuPreference};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};
use wgpu::Features;

/// How long a device may take to report its loss after refusing something.
const LAST_WORDS: Duration = Duration::from_secs(2);

/// The last uncaught error, or the loss of the device, kept for the next call.
#[derive(Debug, Default)]
struct Fault(Mutex<Option<GpuError>>);

impl Fault {
    fn lock(&self) -> MutexGuard<'_, Option<GpuError>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn set(&self, error: GpuError) {
        let mut slot = self.lock();
        if !matches!(*slot, Some(GpuError::DeviceLost(_))) {
            *slot = Some(error);
        }
    }
}

/// A GPU device and its queue to draw on: opened by the renderer, or an application's own.
///
/// The renderer submits work to the queue from the calling thread, in submissions of its own. Pipelines can be compiled
/// on another thread. A clone is the same device.
///
/// ```no_run
/// use brickyard_render::{Gpu, wgpu};
///
/// # async fn device(adapter: wgpu::Adapter) -> Result<(), Box<dyn std::error::Error>> {
/// let mut wanted = Gpu::required(&adapter);
/// wanted.label = Some("the application");
/// let (device, queue) = adapter.request_device(&wanted).await?;
/// let gpu = Gpu::from_device(&adapter, device, queue)?;
/// # Ok(())
/// # }
/// ```
#[derive(Clone, Debug)]
pub struct Gpu {
    pub(crate) device: wgpu::Device,
    pub(crate) queue: wgpu::Queue,
    pub(crate) report: AdapterReport,
    fault: Arc<Fault>,
    /// Whether the device is an application's: its error handlers receive none of the renderer's errors, and
    /// [`GpuRenderer::show`](crate::GpuRenderer::show) does not wait for it.
    pub(crate) is_lent: bool,
    pub(crate) refuse_above_bytes: u64,
    longest_wait_us: Arc<AtomicU64>,
}

/// Most storage buffers seen by a shader; rays see the most.
const STORAGE_BUFFERS: u32 = 7;

impl Gpu {
    /// Returns a device descriptor for the renderer: its limits, and the adapter's features useful to it. An
    /// application adds its own needs. Without `TEXTURE_FORMAT_16BIT_NORM`, 16-bit codes become half floats of 11
    /// significant bits. Without `FLOAT32_BLENDABLE`, layers blend in half floats. Without `TIMESTAMP_QUERY`, the GPU
    /// time of a picture is unknown.
    pub fn required(adapter: &wgpu::Adapter) -> wgpu::DeviceDescriptor<'static> {
        let useful = Features::TEXTURE_FORMAT_16BIT_NORM | Features::FLOAT32_BLENDABLE | Features::TIMESTAMP_QUERY;
        let most = adapter.limits();
        let required_limits = wgpu::Limits {
            max_texture_dimension_2d: most.max_texture_dimension_2d,
            max_texture_dimension_3d: most.max_texture_dimension_3d,
            max_buffer_size: most.max_buffer_size,
            max_storage_buffer_binding_size: most.max_storage_buffer_binding_size,
            max_storage_buffers_per_shader_stage: most.max_storage_buffers_per_shader_stage.min(8),
            // An atlas for each of several volumes.
            max_sampled_textures_per_shader_stage: most.max_sampled_textures_per_shader_stage.min(64),
            ..wgpu::Limits::downlevel_defaults()
        };
        wgpu::DeviceDescriptor {
            label: Some("brickyard"),
            required_features: adapter.features() & useful,
            required_limits,
            ..Default::default()
        }
    }

    /// Wraps an application's device, which remains in the application's use, with its handlers for errors and loss.
    /// The renderer's calls return their own errors, and a lost device is not recreated.
    ///
    /// # Errors
    /// If the device has lower limits than the renderer's shaders need: see [`Gpu::required`].
    pub fn from_device(adapter: &wgpu::Adapter, device: wgpu::Device, queue: wgpu::Queue) -> Result<Self, GpuError> {
        let limits = device.limits();
        let report = AdapterReport::new(adapter, device.features(), &limits);
        let least = wgpu::Limits {
            max_storage_buffers_per_shader_stage: STORAGE_BUFFERS,
            ..wgpu::Limits::downlevel_defaults()
        };
        let mut lacking = Vec::new();
        least.check_limits_with_fail_fn(&limits, false, |name, least, given| {
            lacking.push(format!("{name} is {given}, at least {least} is needed"));
        });
        if !lacking.is_empty() {
            return Err(GpuError::Device { adapter: report.to_string(), reason: lacking.join("; ") });
        }
        let (fault, longest_wait_us) = Default::default();
        Ok(Self { device, queue, report, fault, is_lent: true, refuse_above_bytes: u64::MAX, longest_wait_us })
    }

    /// Opens a device on the best permitted adapter. Allocations above `refuse_above_bytes` are refused, for tests.
    ///
    /// # Errors
    /// If there is no such adapter, or it provides no device.
    pub(crate) fn open(preference: GpuPreference, refuse_above_bytes: u64) -> Result<Self, GpuError> {
        let adapter = adapter::best(preference)?;
        let wanted = Self::required(&adapter);
        let report = AdapterReport::new(&adapter, wanted.required_features, &wanted.required_limits);
        let (device, queue) = pollster::block_on(adapter.request_device(&wanted))
            .map_err(|e| GpuError::Device { adapter: report.to_string(), reason: e.to_string() })?;
        let (fault, longest_wait_us): (Arc<Fault>, _) = Default::default();
        let (uncaught, lost) = (fault.clone(), fault.clone());
        let gpu = Self { device, queue, report, fault, is_lent: false, refuse_above_bytes, longest_wait_us };
        gpu.device.on_uncaptured_error(Arc::new(move |error: wgpu::Error| {
            tracing::error!("GPU: {error}");
            uncaught.set(GpuError::Refused(error.to_string()));
        }));
        gpu.device.set_device_lost_callback(move |reason, message| {
            lost.set(GpuError::DeviceLost(format!("{reason:?} {message}").trim().to_string()));
        });
        Ok(gpu)
    }

    /// The report on the device's adapter.
    pub fn adapter(&self) -> &AdapterReport {
        &self.report
    }

    /// Returns the longest wait for the device in one call since the last query.
    pub fn take_longest_wait(&self) -> Duration {
        Duration::from_micros(self.longest_wait_us.swap(0, Ordering::Relaxed))
    }

    /// Returns the error since the last check, if any. A lost device is an error at every check.
    pub(crate) fn check(&self) -> Result<(), GpuError> {
        if matches!(*self.fault.lock(), Some(GpuError::Refused(_))) {
            // A lost device refuses various things before reporting its loss. Its report is fetched here and kept.
            let all = wgpu::PollType::Wait { submission_index: None, timeout: Some(LAST_WORDS) };
            let _ = self.poll(all);
        }
        let mut slot = self.fault.lock();
        match &*slot {
            None => Ok(()),
            Some(lost @ GpuError::DeviceLost(_)) => Err(lost.clone()),
            Some(_) => slot.take().map_or(Ok(()), Err),
        }
    }

    /// Creates a bind group.
    pub(crate) fn bind_group(
        &self,
        label: &str,
        layout: &wgpu::BindGroupLayout,
        entries: &[wgpu::BindGroupEntry<'_>],
    ) -> wgpu::BindGroup {
        self.device.create_bind_group(&wgpu::BindGroupDescriptor { label: Some(label), layout, entries })
    }

    /// Creates a sampler that filters linearly.
    pub(crate) fn linear_sampler(&self, label: &str) -> wgpu::Sampler {
        let (mag_filter, min_filter) = (wgpu::FilterMode::Linear, wgpu::FilterMode::Linear);
        let descriptor = wgpu::SamplerDescriptor { label: Some(label), mag_filter, min_filter, ..Default::default() };
        self.device.create_sampler(&descriptor)
    }

    /// Records commands and submits them.
    pub(crate) fn submit(&self, record: impl FnOnce(&mut wgpu::CommandEncoder)) -> wgpu::SubmissionIndex {
        let mut encoder = self.device.create_command_encoder(&Default::default());
        record(&mut encoder);
        self.queue.submit([encoder.finish()])
    }

    /// Allocates something of `requested_bytes` on the device.
    ///
    /// # Errors
    /// [`GpuError::OutOfMemory`] if there is no room for it, or the device's error since the last check.
    pub(crate) fn allocate<T>(
        &self,
        label: &str,
        requested_bytes: u64,
        make: impl FnOnce(&wgpu::Device) -> T,
    ) -> Result<T, GpuError> {
        let scope = self.device.push_error_scope(wgpu::ErrorFilter::OutOfMemory);
        let made = make(&self.device);
        match pollster::block_on(scope.pop()) {
            None if requested_bytes <= self.refuse_above_bytes => self.check().map(|()| made),
            _ => Err(GpuError::OutOfMemory { label: label.to_string(), requested_bytes }),
        }
    }

    /// Creates something of negligible memory, such as a pipeline, on any thread. Device errors meanwhile are returned
    /// and reach no handler.
    pub(crate) fn guarded<T>(&self, make: impl FnOnce() -> T) -> Result<T, GpuError> {
        let filters = [wgpu::ErrorFilter::Internal, wgpu::ErrorFilter::Validation, wgpu::ErrorFilter::OutOfMemory];
        let scopes = filters.map(|filter| self.device.push_error_scope(filter));
        // If this thread died, others would wait for it in vain.
        let made = catch_unwind(AssertUnwindSafe(make)).map_err(|_| "the driver gave up".to_string());
        let errors: Vec<_> = scopes.into_iter().rev().filter_map(|scope| pollster::block_on(scope.pop())).collect();
        match errors.first() {
            Some(error) => Err(GpuError::Refused(error.to_string())),
            None => made.map_err(GpuError::Refused),
        }
    }

    /// Runs calls on the device. Errors meanwhile are returned and do not reach an application's handler.
    pub(crate) fn scoped<T>(&self, calls: impl FnOnce() -> Result<T, GpuError>) -> Result<T, GpuError> {
        if !self.is_lent {
            return calls();
        }
        self.guarded(calls)?
    }

    /// Returns the loss of the device if it caused this error of [`Gpu::guarded`], else the error itself.
    pub(crate) fn reason(&self, error: GpuError) -> GpuError {
        self.fault.set(error.clone());
        self.check().err().unwrap_or(error)
    }

    /// Waits until a submission is done.
    ///
    /// # Errors
    /// If the device is lost or has reported an error.
    pub(crate) fn wait(&self, submission: wgpu::SubmissionIndex) -> Result<(), GpuError> {
        self.wait_for(Some(submission))
    }

    /// Waits until all submitted work is done and its resources are freed.
    pub(crate) fn wait_for_all(&self) -> Result<(), GpuError> {
        self.wait_for(None)
    }

    fn wait_for(&self, submission_index: Option<wgpu::SubmissionIndex>) -> Result<(), GpuError> {
        let begun = Instant::now();
        self.poll(wgpu::PollType::Wait { submission_index, timeout: None })?;
        self.longest_wait_us.fetch_max(begun.elapsed().as_micros() as u64, Ordering::Relaxed);
        self.check()
    }

    /// Polls the device for completed work, without waiting.
    pub(crate) fn look(&self) -> Result<(), GpuError> {
        self.poll(wgpu::PollType::Poll)?;
        self.check()
    }

    /// Returns the loss of the device, indicated by `sign`. The message is the device's own if reported; an
    /// application's device reports only to the application.
    pub(crate) fn lost(&self, sign: &dyn std::fmt::Display) -> GpuError {
        self.reason(GpuError::DeviceLost(sign.to_string()))
    }

    fn poll(&self, poll: wgpu::PollType) -> Result<(), GpuError> {
        // wgpu 30 panics, holding none of its locks, if the driver answers a wait with the loss of the device.
        let lost = match catch_unwind(AssertUnwindSafe(|| self.device.poll(poll))) {
            // A busy device is not lost.
            Ok(Ok(_) | Err(wgpu::PollError::Timeout)) => return Ok(()),
            Ok(Err(error)) => error.to_string(),
            Err(_) => "the driver gave up".to_string(),
        };
        let lost = GpuError::DeviceLost(lost);
        self.fault.set(lost.clone());
        Err(lost)
    }

    /// Destroys the device, freeing its memory. Queued work is finished first; from then on the device is lost.
    pub(crate) fn destroy(&self) {
        self.device.destroy();
        let all = wgpu::PollType::Wait { submission_index: None, timeout: Some(LAST_WORDS) };
        if let Err(error) = self.poll(all) {
            tracing::debug!(%error, "giving a device up");
        }
    }
}

#[cfg(test)]
#[path = "../../../tests/support/missing.rs"]
#[expect(unreachable_pub, reason = "the whole-system tests have it in a library")]
mod missing;

#[cfg(test)]
mod tests {
    use super::missing::leave_out;
    use super::*;
    use wgpu::TextureFormat;

    #[test]
    fn a_lost_device_is_a_typed_error() {
        let Ok(gpu) = Gpu::open(GpuPreference::Any, u64::MAX) else {
            return leave_out("gpu", "no device was lost or refused");
        };
        assert_eq!(gpu.check(), Ok(()));
        gpu.destroy();
        for _ in 0..2 {
            assert!(matches!(gpu.check(), Err(GpuError::DeviceLost(_))));
        }
    }

    #[test]
    fn an_impossible_texture_is_an_error_and_not_a_panic() {
        let Ok(gpu) = Gpu::open(GpuPreference::Any, u64::MAX) else {
            return leave_out("gpu", "no device was lost or refused");
        };
        let edge = gpu.report.max_texture_3d + 1;
        let made = gpu.allocate("test", 0, |device| {
            device.create_texture(&wgpu::TextureDescriptor {
                label: None,
                size: wgpu::Extent3d { width: edge, height: 1, depth_or_array_layers: 1 },
                mip_level_count: 1,
                sample_count: 1,
                dimension: wgpu::TextureDimension::D3,
                format: TextureFormat::R8Unorm,
                usage: wgpu::TextureUsages::COPY_DST,
                view_formats: &[],
            })
        });
        assert!(matches!(made, Err(GpuError::Refused(_))), "{made:?}");
        assert_eq!(gpu.check(), Ok(()), "a refused command does not outlive its report");
    }
}
