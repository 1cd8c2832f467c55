//! What a picture of one size is drawn into and read back from.

use crate::adapter::Gpu;
use crate::compositor::Compositor;
use crate::error::GpuError;
use crate::memory::{TIMESTAMP_BYTES, read_back_row_bytes};
use crate::pipelines::{DISPLAY_FORMAT, gather_format};
use brickyard_shaders::Gather;
use brickyard_volume::Picture;
use wgpu::{Extent3d, TextureFormat, TextureUsages};

/// The gathered samples, the display picture, and the buffer that brings it to the CPU.
#[derive(Debug)]
pub(crate) struct Targets {
    pub(crate) gather: Gather,
    pub(crate) width_px: u32,
    pub(crate) height_px: u32,
    pub(crate) gathered: wgpu::TextureView,
    /// Of joined projections: colour times depth, and depth, of what mixes; and what adds.
    pub(crate) sums: Option<[wgpu::TextureView; 2]>,
    pub(crate) display_view: wgpu::TextureView,
    display: wgpu::Texture,
    /// Padded rows of RGBA, two timestamps, and bricks' marks.
    pub(crate) read_back: wgpu::Buffer,
}

/// What comes back of a frame.
#[derive(Debug)]
pub(crate) struct Found {
    pub(crate) picture: Picture,
    pub(crate) ticks: [u64; 2],
    pub(crate) marks: Vec<u32>,
}

impl Targets {
    /// Targets for pictures of this size, with sums or without, and with room for `marks_bytes` of marks.
    pub(crate) fn new(
        gpu: &Gpu,
        (gather, has_sums): (Gather, bool),
        compositor: Compositor,
        (width_px, height_px): (u32, u32),
        marks_bytes: u64,
    ) -> Result<Self, GpuError> {
        let size = Extent3d { width: width_px, height: height_px, depth_or_array_layers: 1 };
        let texture = |device: &wgpu::Device, format: TextureFormat, usage| {
            device.create_texture(&wgpu::TextureDescriptor {
                label: Some("target"),
                size,
                mip_level_count: 1,
                sample_count: 1,
                dimension: wgpu::TextureDimension::D2,
                format,
                usage,
                view_formats: &[],
            })
        };
        let pixels = width_px as u64 * height_px as u64;
        let rows_bytes = read_back_row_bytes(width_px) * height_px as u64;
        let texel_bytes = if has_sums { 52 } else { 20 };
        gpu.allocate("the picture's targets", pixels * texel_bytes + rows_bytes + marks_bytes, |device| {
            let format = gather_format(gather, compositor, &gpu.report.formats);
            let written = match compositor {
                Compositor::Sorted | Compositor::Raycast => TextureUsages::RENDER_ATTACHMENT,
                Compositor::Compute => TextureUsages::STORAGE_BINDING,
            };
            let gathered = texture(device, format, TextureUsages::TEXTURE_BINDING | written);
            let gathered = gathered.create_view(&Default::default());
            let sum = |_| {
                let usage = TextureUsages::TEXTURE_BINDING | TextureUsages::RENDER_ATTACHMENT;
                texture(device, gpu.report.formats.composite, usage).create_view(&Default::default())
            };
            let sums = has_sums.then(|| [0, 1].map(sum));
            let display = texture(device, DISPLAY_FORMAT, TextureUsages::COPY_SRC | TextureUsages::RENDER_ATTACHMENT);
            let display_view = display.create_view(&Default::default());
            let read_back = device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("read-back"),
                size: rows_bytes + TIMESTAMP_BYTES + marks_bytes,
                usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
                mapped_at_creation: false,
            });
            Self { gather, width_px, height_px, gathered, sums, display_view, display, read_back }
        })
    }

    /// Whether they are for such pictures.
    pub(crate) fn suit(&self, (gather, has_sums): (Gather, bool), size_px: (u32, u32)) -> bool {
        (self.gather, self.sums.is_some(), self.width_px, self.height_px) == (gather, has_sums, size_px.0, size_px.1)
    }

    /// Where the timestamps lie in the read-back buffer.
    pub(crate) fn timestamps_offset(&self) -> u64 {
        read_back_row_bytes(self.width_px) * self.height_px as u64
    }

    /// Where the marks lie in it.
    pub(crate) fn marks_offset(&self) -> u64 {
        self.timestamps_offset() + TIMESTAMP_BYTES
    }

    /// Queues the copy of the display picture into the read-back buffer.
    pub(crate) fn copy_back(&self, encoder: &mut wgpu::CommandEncoder) {
        let layout = wgpu::TexelCopyBufferLayout {
            offset: 0,
            bytes_per_row: Some(read_back_row_bytes(self.width_px) as u32),
            rows_per_image: None,
        };
        let size = Extent3d { width: self.width_px, height: self.height_px, depth_or_array_layers: 1 };
        let destination = wgpu::TexelCopyBufferInfo { buffer: &self.read_back, layout };
        encoder.copy_texture_to_buffer(self.display.as_image_copy(), destination, size);
    }

    /// Waits for the submission that copied, and takes the picture, the two timestamps and so many marks.
    pub(crate) fn read(&self, gpu: &Gpu, copied: wgpu::SubmissionIndex, marks: usize) -> Result<Found, GpuError> {
        let (send, receive) = std::sync::mpsc::channel();
        self.read_back.map_async(wgpu::MapMode::Read, .., move |mapped| {
            // The receiver lives until the end of this function; if it is gone, no one waits for the answer.
            let _ = send.send(mapped);
        });
        gpu.wait(copied)?;
        let refused = |e: &dyn std::fmt::Display| GpuError::Refused(format!("reading the picture back: {e}"));
        receive.try_recv().map_err(|e| refused(&e))?.map_err(|e| refused(&e))?;
        let bytes = self.read_back.get_mapped_range(..).map_err(|e| refused(&e))?;
        let (rows, rest) = bytes.split_at(self.timestamps_offset() as usize);
        let (timestamps, rest) = rest.split_at(TIMESTAMP_BYTES as usize);
        let rgb = rows
            .chunks_exact(read_back_row_bytes(self.width_px) as usize)
            .flat_map(|row| row[..self.width_px as usize * 4].chunks_exact(4).map(|p| [p[0], p[1], p[2]]))
            .collect();
        let tick = |i: usize| bytemuck::pod_read_unaligned(&timestamps[i * 8..i * 8 + 8]);
        let ticks = [tick(0), tick(1)];
        let marks = bytemuck::pod_collect_to_vec(&rest[..marks * size_of::<u32>()]);
        drop(bytes);
        self.read_back.unmap();
        Ok(Found { picture: Picture { width: self.width_px, height: self.height_px, rgb }, ticks, marks })
    }
}
