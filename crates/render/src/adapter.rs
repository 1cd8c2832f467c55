//! Adapters: enumeration, ranking, and the texture formats used on each.
//!
//! `WGPU_BACKEND` and `WGPU_ADAPTER_NAME` narrow the choice, as usual with wgpu.

use crate::GpuError;
use brickyard_volume::{SlotEncoding, SlotFormat};
use std::fmt;
use std::sync::LazyLock;
use wgpu::{Backends, DeviceType, DownlevelFlags, Features, Limits, TextureFormat, TextureFormatFeatureFlags};

/// Which adapters may be used.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum GpuPreference {
    /// The fastest kind of adapter; a software rasteriser only as a last resort.
    #[default]
    Any,
    /// The fastest kind of adapter, but no software rasteriser.
    Hardware,
    /// A software rasteriser.
    Software,
}

/// Format of the finished picture. Colours are display-referred already: no sRGB conversion.
pub(crate) const DISPLAY_FORMAT: TextureFormat = TextureFormat::Rgba8Unorm;

/// The texture formats used on an adapter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct GpuFormats {
    /// Format of an atlas of 8-bit codes.
    pub atlas_u8: TextureFormat,
    /// Format of an atlas of 16-bit codes.
    pub atlas_u16: TextureFormat,
    /// Format of the target of direct volume rendering.
    pub composite: TextureFormat,
    /// Format of the target of projections.
    pub project: TextureFormat,
}

impl GpuFormats {
    /// Chooses the formats. llvmpipe filters 8-bit textures in 8-bit fixed point, so software rasterisers hold 8-bit
    /// codes in 16 bits. Without 16-bit norm formats, 16-bit codes become half floats of 11 significant bits. Blending
    /// in 32-bit floats costs little beside the march and keeps dozens of layers exact; half floats are off by about
    /// 1/2048 per layer.
    fn new(adapter: &wgpu::Adapter, enabled: Features) -> Self {
        let found = adapter.get_texture_format_features(TextureFormat::R16Unorm).flags;
        let has_norm = enabled.contains(Features::TEXTURE_FORMAT_16BIT_NORM);
        let filters_norm = has_norm && found.contains(TextureFormatFeatureFlags::FILTERABLE);
        let atlas_u16 = if filters_norm { TextureFormat::R16Unorm } else { TextureFormat::R16Float };
        let widen = is_software(adapter) && atlas_u16 == TextureFormat::R16Unorm;
        let blends32 = enabled.contains(Features::FLOAT32_BLENDABLE);
        Self {
            atlas_u8: if widen { atlas_u16 } else { TextureFormat::R8Unorm },
            atlas_u16,
            composite: if blends32 { TextureFormat::Rgba32Float } else { TextureFormat::Rgba16Float },
            project: if blends32 { TextureFormat::Rg32Float } else { TextureFormat::Rg16Float },
        }
    }

    /// Whether an atlas keeps codes distinct as needed: the 11 bits of half floats do for measurements, not for labels.
    pub(crate) fn tells_apart(&self, encoding: &SlotEncoding) -> bool {
        let is_rounded = encoding.format == SlotFormat::U16 && self.atlas_u16 == TextureFormat::R16Float;
        !(is_rounded && encoding.is_labels)
    }

    /// Returns the atlas format for slots of this format. Shaders filter 32-bit floats themselves, so every adapter
    /// supports them.
    pub fn atlas(&self, codes: SlotFormat) -> TextureFormat {
        match codes {
            SlotFormat::U8 => self.atlas_u8,
            SlotFormat::U16 => self.atlas_u16,
            SlotFormat::F32 => TextureFormat::R32Float,
        }
    }
}

/// A graphics adapter's identity and capabilities.
#[derive(Clone, Debug, PartialEq)]
pub struct AdapterReport {
    /// The adapter's name.
    pub name: String,
    /// The graphics API: `vulkan`, `metal`, `dx12` or `gl`.
    pub backend: String,
    /// The kind of adapter: `discrete GPU`, `integrated GPU`, `virtual GPU`, `software` or `other`.
    pub kind: &'static str,
    /// Driver name and version.
    pub driver: String,
    /// Greatest edge of a 3D texture, texels.
    pub max_texture_3d: u32,
    /// Greatest edge of a picture, pixels.
    pub max_texture_2d: u32,
    /// Size of the largest buffer, bytes.
    pub max_buffer_bytes: u64,
    /// Whether GPU time can be measured.
    pub timestamps: bool,
    /// Whether fragment shaders can write to buffers, and so report how much light entered each brick (visibility
    /// feedback).
    pub feedback: bool,
    /// The texture formats used on the adapter.
    pub formats: GpuFormats,
}

impl fmt::Display for AdapterReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} ({}, {}, {})", self.name, self.kind, self.backend, self.driver)
    }
}

impl AdapterReport {
    /// Whether the adapter is a software rasteriser.
    pub fn is_software(&self) -> bool {
        self.kind == rank(DeviceType::Cpu).1
    }

    /// Reports on an adapter without a device.
    fn of(adapter: &wgpu::Adapter) -> Self {
        Self::new(adapter, adapter.features(), &adapter.limits())
    }

    /// Reports on an adapter with the features and limits of its device.
    pub(crate) fn new(adapter: &wgpu::Adapter, enabled: Features, limits: &Limits) -> Self {
        let info = adapter.get_info();
        Self {
            name: info.name,
            backend: info.backend.to_string(),
            kind: rank(info.device_type).1,
            driver: format!("{} {}", info.driver, info.driver_info).trim().to_string(),
            max_texture_3d: limits.max_texture_dimension_3d,
            max_texture_2d: limits.max_texture_dimension_2d,
            max_buffer_bytes: limits.max_buffer_size,
            feedback: adapter.get_downlevel_capabilities().flags.contains(DownlevelFlags::FRAGMENT_WRITABLE_STORAGE),
            timestamps: enabled.contains(Features::TIMESTAMP_QUERY),
            formats: GpuFormats::new(adapter, enabled),
        }
    }
}

/// The rank of a kind of adapter, the best first, and its name.
fn rank(device_type: DeviceType) -> (u8, &'static str) {
    match device_type {
        DeviceType::DiscreteGpu => (0, "discrete GPU"),
        DeviceType::IntegratedGpu => (1, "integrated GPU"),
        DeviceType::VirtualGpu => (2, "virtual GPU"),
        DeviceType::Other => (3, "other"),
        DeviceType::Cpu => (4, "software"),
    }
}

fn is_software(adapter: &wgpu::Adapter) -> bool {
    adapter.get_info().device_type == DeviceType::Cpu
}

/// Lists all adapters, [`GpuPreference::Any`]'s choice first. The first call costs about 40 ms for loading the drivers,
/// later ones 4 (lavapipe).
pub fn adapters() -> Vec<AdapterReport> {
    ranked_adapters().iter().map(AdapterReport::of).collect()
}

/// Never dropped: it keeps drivers loaded, whose threads may outlive the last device.
static DRIVERS: LazyLock<wgpu::Instance> = LazyLock::new(instance);

fn instance() -> wgpu::Instance {
    let mut descriptor = wgpu::InstanceDescriptor::new_without_display_handle_from_env();
    // Without a budget, drivers that page instead of failing take more memory than the GPU has.
    descriptor.memory_budget_thresholds.for_resource_creation.get_or_insert(90);
    wgpu::Instance::new(descriptor)
}

/// All adapters, best first, from a new instance: devices of one instance share Mesa's software rasteriser, which
/// inspects their drawing (`llvmpipe_flush_resource`) without waiting for its thread.
fn ranked_adapters() -> Vec<wgpu::Adapter> {
    LazyLock::force(&DRIVERS);
    let mut found = pollster::block_on(instance().enumerate_adapters(Backends::all()));
    if let Ok(name) = std::env::var("WGPU_ADAPTER_NAME") {
        found.retain(|a| a.get_info().name.to_lowercase().contains(&name.to_lowercase()));
    }
    found.sort_by_key(|adapter| rank(adapter.get_info().device_type));
    found
}

/// Returns the best permitted adapter.
///
/// # Errors
/// If there is none.
pub(crate) fn best(preference: GpuPreference) -> Result<wgpu::Adapter, GpuError> {
    let mut all = ranked_adapters();
    let (wanted, allowed): (_, fn(&wgpu::Adapter) -> bool) = match preference {
        GpuPreference::Any => ("graphics adapter", |_| true),
        GpuPreference::Hardware => ("hardware GPU", |a| !is_software(a)),
        GpuPreference::Software => ("software rasteriser", is_software),
    };
    match all.iter().position(allowed) {
        Some(i) => Ok(all.swap_remove(i)),
        None => {
            let names: Vec<_> = all.iter().map(|a| AdapterReport::of(a).to_string()).collect();
            let seen = if names.is_empty() { String::new() } else { format!(" (only {})", names.join(", ")) };
            Err(GpuError::NoAdapter { wanted, seen })
        }
    }
}
