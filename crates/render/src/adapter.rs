//! Adapters: which there are, which one is used, and the device made from it.
//!
//! `WGPU_BACKEND` and `WGPU_ADAPTER_NAME` narrow the choice as wgpu's users expect. A device gets the adapter's own limits
//! for textures and buffers, and those optional features that the formats below need. Errors that no scope catches and the
//! loss of the device are remembered and turned into typed errors by the next call.

use crate::error::GpuError;
use brickyard_volume::SlotFormat;
use std::fmt;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;
use wgpu::{Backends, DeviceType, DownlevelFlags, Features, TextureFormat, TextureFormatFeatureFlags};

/// Which adapters may be used.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum GpuPreference {
    /// The fastest; a software rasteriser only if there is nothing else.
    #[default]
    Any,
    /// The fastest, but no software rasteriser.
    Hardware,
    /// A software rasteriser.
    Software,
}

/// The texture formats that an adapter gets.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct GpuFormats {
    /// Atlas of 8-bit codes.
    pub atlas_u8: TextureFormat,
    /// Atlas of 16-bit codes.
    pub atlas_u16: TextureFormat,
    /// Target of direct volume rendering.
    pub composite: TextureFormat,
    /// Target of projections.
    pub project: TextureFormat,
}

impl GpuFormats {
    /// llvmpipe filters 8-bit textures in 8-bit fixed point, so software rasterisers hold 8-bit codes in 16 bits. Without
    /// 16-bit norm formats 16-bit codes become half floats of 11 significant bits. Blending in 32-bit floats costs little
    /// beside the march and keeps dozens of layers exact; without it targets are half floats: about 1/2048 a layer.
    fn new(adapter: &wgpu::Adapter) -> Self {
        let filters = |format| {
            let wanted = TextureFormatFeatureFlags::FILTERABLE;
            let features = format_features(format);
            adapter.features().contains(features) && adapter.get_texture_format_features(format).flags.contains(wanted)
        };
        let atlas_u16 =
            if filters(TextureFormat::R16Unorm) { TextureFormat::R16Unorm } else { TextureFormat::R16Float };
        let widen = is_software(adapter) && atlas_u16 == TextureFormat::R16Unorm;
        let blends32 = adapter.features().contains(Features::FLOAT32_BLENDABLE);
        Self {
            atlas_u8: if widen { atlas_u16 } else { TextureFormat::R8Unorm },
            atlas_u16,
            composite: if blends32 { TextureFormat::Rgba32Float } else { TextureFormat::Rgba16Float },
            project: if blends32 { TextureFormat::Rg32Float } else { TextureFormat::Rg16Float },
        }
    }

    /// The atlas format for these codes.
    pub fn atlas(&self, codes: SlotFormat) -> TextureFormat {
        match codes {
            SlotFormat::U8 => self.atlas_u8,
            SlotFormat::U16 => self.atlas_u16,
        }
    }
}

/// The optional features that a format needs.
fn format_features(format: TextureFormat) -> Features {
    if format == TextureFormat::R16Unorm { Features::TEXTURE_FORMAT_16BIT_NORM } else { Features::empty() }
}

/// What is known of an adapter.
#[derive(Clone, Debug, PartialEq)]
pub struct AdapterReport {
    /// Its name.
    pub name: String,
    /// The graphics API: `vulkan`, `metal`, `dx12`.
    pub backend: String,
    /// `discrete GPU`, `integrated GPU`, `virtual GPU`, `software`, `other`.
    pub kind: &'static str,
    /// Driver name and version.
    pub driver: String,
    /// Greatest edge of a 3D texture, texels.
    pub max_texture_3d: u32,
    /// Greatest edge of a picture, pixels.
    pub max_texture_2d: u32,
    /// Greatest buffer.
    pub max_buffer_bytes: u64,
    /// Whether GPU time can be measured.
    pub timestamps: bool,
    /// Whether shaders that make a picture can also say what they saw.
    pub feedback: bool,
    /// The formats it gets.
    pub formats: GpuFormats,
}

impl fmt::Display for AdapterReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} ({}, {}, {})", self.name, self.kind, self.backend, self.driver)
    }
}

impl AdapterReport {
    fn new(adapter: &wgpu::Adapter) -> Self {
        let (info, limits) = (adapter.get_info(), adapter.limits());
        Self {
            name: info.name,
            backend: info.backend.to_string(),
            kind: kind(info.device_type),
            driver: format!("{} {}", info.driver, info.driver_info).trim().to_string(),
            max_texture_3d: limits.max_texture_dimension_3d,
            max_texture_2d: limits.max_texture_dimension_2d,
            max_buffer_bytes: limits.max_buffer_size,
            feedback: adapter.get_downlevel_capabilities().flags.contains(DownlevelFlags::FRAGMENT_WRITABLE_STORAGE),
            timestamps: adapter.features().contains(Features::TIMESTAMP_QUERY),
            formats: GpuFormats::new(adapter),
        }
    }
}

fn kind(device_type: DeviceType) -> &'static str {
    match device_type {
        DeviceType::DiscreteGpu => "discrete GPU",
        DeviceType::IntegratedGpu => "integrated GPU",
        DeviceType::VirtualGpu => "virtual GPU",
        DeviceType::Cpu => "software",
        DeviceType::Other => "other",
    }
}

fn is_software(adapter: &wgpu::Adapter) -> bool {
    adapter.get_info().device_type == DeviceType::Cpu
}

/// All adapters, the one that [`GpuPreference::Any`] takes first. Costs about 30 ms.
pub fn adapters() -> Vec<AdapterReport> {
    ranked_adapters().iter().map(AdapterReport::new).collect()
}

fn ranked_adapters() -> Vec<wgpu::Adapter> {
    let mut descriptor = wgpu::InstanceDescriptor::new_without_display_handle_from_env();
    // Drivers that page instead of failing would otherwise take more than there is.
    descriptor.memory_budget_thresholds.for_resource_creation.get_or_insert(90);
    let mut found = pollster::block_on(wgpu::Instance::new(descriptor).enumerate_adapters(Backends::all()));
    if let Ok(name) = std::env::var("WGPU_ADAPTER_NAME") {
        found.retain(|a| a.get_info().name.to_lowercase().contains(&name.to_lowercase()));
    }
    found.sort_by_key(|a| match a.get_info().device_type {
        DeviceType::DiscreteGpu => 0,
        DeviceType::IntegratedGpu => 1,
        DeviceType::VirtualGpu => 2,
        DeviceType::Other => 3,
        DeviceType::Cpu => 4,
    });
    found
}

/// How long a device that has refused something may take to say whether it is lost.
const LAST_WORDS: Duration = Duration::from_secs(2);

/// The error that no scope caught, or the loss of the device, kept for the next call.
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

/// A device, its queue, and what is known of it. All calls come from one thread, but those that are [guarded](Gpu::guarded).
#[derive(Clone, Debug)]
pub(crate) struct Gpu {
    pub(crate) device: wgpu::Device,
    pub(crate) queue: wgpu::Queue,
    pub(crate) report: AdapterReport,
    fault: Arc<Fault>,
    refuse_above_bytes: u64,
}

impl Gpu {
    /// The best adapter's device. Allocations of more than `refuse_above_bytes` will be refused whatever it says.
    pub(crate) fn open(preference: GpuPreference, refuse_above_bytes: u64) -> Result<Self, GpuError> {
        let all = ranked_adapters();
        let (wanted, allowed): (_, fn(&wgpu::Adapter) -> bool) = match preference {
            GpuPreference::Any => ("graphics adapter", |_| true),
            GpuPreference::Hardware => ("hardware GPU", |a| !is_software(a)),
            GpuPreference::Software => ("software rasteriser", is_software),
        };
        let Some(adapter) = all.iter().find(|a| allowed(a)) else {
            let names: Vec<_> = all.iter().map(|a| AdapterReport::new(a).to_string()).collect();
            let seen = if names.is_empty() { String::new() } else { format!(" (only {})", names.join(", ")) };
            return Err(GpuError::NoAdapter { wanted, seen });
        };
        Self::new(adapter, refuse_above_bytes)
    }

    fn new(adapter: &wgpu::Adapter, refuse_above_bytes: u64) -> Result<Self, GpuError> {
        let report = AdapterReport::new(adapter);
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
        let descriptor = wgpu::DeviceDescriptor {
            label: Some("brickyard"),
            required_features: adapter.features() & useful,
            required_limits,
            ..Default::default()
        };
        let (device, queue) = pollster::block_on(adapter.request_device(&descriptor))
            .map_err(|e| GpuError::Device { adapter: report.to_string(), reason: e.to_string() })?;
        let fault = Arc::new(Fault::default());
        let uncaught = fault.clone();
        device.on_uncaptured_error(Arc::new(move |error: wgpu::Error| {
            tracing::error!("GPU: {error}");
            uncaught.set(GpuError::Refused(error.to_string()));
        }));
        let lost = fault.clone();
        device.set_device_lost_callback(move |reason, message| {
            lost.set(GpuError::DeviceLost(format!("{reason:?} {message}").trim().to_string()));
        });
        Ok(Self { device, queue, report, fault, refuse_above_bytes })
    }

    /// The error that has come up since the last check, if any. A lost device stays lost.
    pub(crate) fn check(&self) -> Result<(), GpuError> {
        if matches!(*self.fault.lock(), Some(GpuError::Refused(_))) {
            // A lost device refuses all kinds of things before it says why. Its answer is asked for here, and kept.
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

    /// Makes something of `requested_bytes`, with running out of memory as a typed error.
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

    /// Makes something that is not of memory, on any thread. What the device has against it is this call's own error, and no other's.
    pub(crate) fn guarded<T>(&self, make: impl FnOnce() -> T) -> Result<T, GpuError> {
        let filters = [wgpu::ErrorFilter::Internal, wgpu::ErrorFilter::Validation, wgpu::ErrorFilter::OutOfMemory];
        let scopes = filters.map(|filter| self.device.push_error_scope(filter));
        // A thread that ends here would leave those who wait for it without a word.
        let made = catch_unwind(AssertUnwindSafe(make)).map_err(|_| "the driver gave it up".to_string());
        let errors: Vec<_> = scopes.into_iter().rev().filter_map(|scope| pollster::block_on(scope.pop())).collect();
        match errors.first() {
            Some(error) => Err(GpuError::Refused(error.to_string())),
            None => made.map_err(GpuError::Refused),
        }
    }

    /// What is behind an error of something guarded: the loss of the device, if that is it.
    pub(crate) fn reason(&self, error: GpuError) -> GpuError {
        self.fault.set(error.clone());
        self.check().err().unwrap_or(error)
    }

    /// Waits until a submission is done.
    pub(crate) fn wait(&self, submission: wgpu::SubmissionIndex) -> Result<(), GpuError> {
        self.poll(wgpu::PollType::Wait { submission_index: Some(submission), timeout: None })?;
        self.check()
    }

    /// Lets the device report what is done, and its loss.
    fn poll(&self, poll: wgpu::PollType) -> Result<(), GpuError> {
        // wgpu 30 panics, with none of its locks held, where the driver's answer to a wait is that the device is gone.
        let lost = match catch_unwind(AssertUnwindSafe(|| self.device.poll(poll))) {
            // A device that is still at work is not lost.
            Ok(Ok(_) | Err(wgpu::PollError::Timeout)) => return Ok(()),
            Ok(Err(error)) => error.to_string(),
            Err(_) => "the driver gave it up".to_string(),
        };
        let lost = GpuError::DeviceLost(lost);
        self.fault.set(lost.clone());
        Err(lost)
    }

    /// Gives the device up, which frees what it holds. Queued work is finished first; from then on it is lost.
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
