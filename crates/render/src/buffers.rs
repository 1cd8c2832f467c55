//! The buffers shared by all layers: those read by every march, and those only for rays.

use crate::{Gpu, GpuError};
use wgpu::{BindingResource, BufferUsages};

/// Bytes of a picture's two timestamps.
pub(crate) const TIMESTAMP_BYTES: u64 = 16;

/// The buffers of every march: frames, transfer tables and timestamps.
#[derive(Debug)]
pub(crate) struct SharedBuffers {
    pub(crate) frame: wgpu::Buffer,
    pub(crate) table: wgpu::Buffer,
    /// The timestamp query set and its resolve buffer; `None` without timestamps.
    pub(crate) timestamps: Option<(wgpu::QuerySet, wgpu::Buffer)>,
    /// Whether marches see stored gradients.
    pub(crate) has_gradients: bool,
}

impl SharedBuffers {
    pub(crate) fn new(gpu: &Gpu, frame_bytes: u64, table_bytes: u64, has_gradients: bool) -> Result<Self, GpuError> {
        gpu.allocate("the transfer table", table_bytes, |device| {
            let timestamps = gpu.report.timestamps.then(|| {
                let descriptor = wgpu::QuerySetDescriptor { label: None, ty: wgpu::QueryType::Timestamp, count: 2 };
                let usage = BufferUsages::QUERY_RESOLVE | BufferUsages::COPY_SRC;
                (device.create_query_set(&descriptor), buffer(device, "timestamps", TIMESTAMP_BYTES, usage))
            });
            let storage = BufferUsages::STORAGE | BufferUsages::COPY_DST;
            Self {
                frame: buffer(device, "frames", frame_bytes, storage),
                table: buffer(device, "transfer tables", table_bytes, storage),
                timestamps,
                has_gradients,
            }
        })
    }
}

/// The additional buffers for rays: octrees, bricks, macro-cells and marks.
#[derive(Debug)]
pub(crate) struct RayBuffers {
    pub(crate) nodes: wgpu::Buffer,
    pub(crate) bricks: wgpu::Buffer,
    pub(crate) ranges: wgpu::Buffer,
    pub(crate) opaque_before: wgpu::Buffer,
    /// The cells' marks: the light left when rays entered them. All zero between frames.
    pub(crate) marks: wgpu::Buffer,
}

pub(crate) fn entry(binding: u32, resource: BindingResource<'_>) -> wgpu::BindGroupEntry<'_> {
    wgpu::BindGroupEntry { binding, resource }
}

/// Creates a texture, of one level and of one sample a texel.
pub(crate) fn texture(
    device: &wgpu::Device,
    label: &str,
    size: wgpu::Extent3d,
    dimension: wgpu::TextureDimension,
    format: wgpu::TextureFormat,
    usage: wgpu::TextureUsages,
) -> wgpu::Texture {
    device.create_texture(&wgpu::TextureDescriptor {
        label: Some(label),
        size,
        mip_level_count: 1,
        sample_count: 1,
        dimension,
        format,
        usage,
        view_formats: &[],
    })
}

pub(crate) fn buffer(device: &wgpu::Device, label: &str, size: u64, usage: BufferUsages) -> wgpu::Buffer {
    device.create_buffer(&wgpu::BufferDescriptor { label: Some(label), size, usage, mapped_at_creation: false })
}
