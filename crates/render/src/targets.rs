//! The targets of pictures of one size, and their read-back.

use crate::adapter::DISPLAY_FORMAT;
use crate::atlas::texel_bytes;
use crate::buffers::{self, buffer};
use crate::mapping::Mapping;
use crate::memory::{pixel_bytes, read_back_row_bytes};
use crate::pipelines::gather_format;
use crate::{Compositor, Gpu, GpuError};
use brickyard_shaders::Gather;
use brickyard_volume::Picture;
use std::ops::Range;
use wgpu::{Extent3d, TextureUsages};

/// Targets of pictures of one size: gathered samples, display picture, read-back buffer.
#[derive(Debug)]
pub(crate) struct Targets {
    pub(crate) gather: Gather,
    pub(crate) width_px: u32,
    pub(crate) height_px: u32,
    pub(crate) gathered: wgpu::TextureView,
    /// The sums of joined projections: for layers that mix, colour times depth, and depth; and the light of additive
    /// layers. `None` if layers are not joined.
    pub(crate) sums: Option<[wgpu::TextureView; 2]>,
    pub(crate) display_view: wgpu::TextureView,
    pub(crate) display: wgpu::Texture,
    /// Padded rows of RGBA; `None` while in flight.
    read_back: Option<wgpu::Buffer>,
}

/// A picture on its way to the CPU.
#[derive(Debug)]
pub(crate) struct Reading {
    pub(crate) mapping: Mapping,
    width_px: u32,
    height_px: u32,
    /// The rows on their way; others are black.
    rows: Range<u32>,
}

impl Targets {
    /// Creates targets for pictures of a size. `has_sums`: whether projections of several layers are joined.
    pub(crate) fn new(
        gpu: &Gpu,
        gather: Gather,
        has_sums: bool,
        compositor: Compositor,
        (width_px, height_px): (u32, u32),
    ) -> Result<Self, GpuError> {
        let size = Extent3d { width: width_px, height: height_px, depth_or_array_layers: 1 };
        let texture = |device: &wgpu::Device, format, usage| {
            buffers::texture(device, "target", size, wgpu::TextureDimension::D2, format, usage)
        };
        let (formats, format) = (&gpu.report.formats, gather_format(gather, compositor, &gpu.report.formats));
        let pixels = width_px as u64 * height_px as u64;
        let rows_bytes = read_back_row_bytes(width_px) * height_px as u64;
        let bytes = pixels * pixel_bytes(texel_bytes(format), formats, has_sums) + rows_bytes;
        gpu.allocate("the picture's targets", bytes, |device| {
            let written = match compositor {
                Compositor::Sorted | Compositor::Raycast => TextureUsages::RENDER_ATTACHMENT,
                Compositor::Compute => TextureUsages::STORAGE_BINDING,
            };
            let gathered = texture(device, format, TextureUsages::TEXTURE_BINDING | written);
            let gathered = gathered.create_view(&Default::default());
            let sum = |_| {
                let usage = TextureUsages::TEXTURE_BINDING | TextureUsages::RENDER_ATTACHMENT;
                texture(device, formats.composite, usage).create_view(&Default::default())
            };
            let sums = has_sums.then(|| [0, 1].map(sum));
            let usage = TextureUsages::COPY_SRC | TextureUsages::RENDER_ATTACHMENT | TextureUsages::TEXTURE_BINDING;
            let display = texture(device, DISPLAY_FORMAT, usage);
            let display_view = display.create_view(&Default::default());
            let usage = wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ;
            let read_back = Some(buffer(device, "read-back", rows_bytes, usage));
            Self { gather, width_px, height_px, gathered, sums, display_view, display, read_back }
        })
    }

    pub(crate) fn suit(&self, gather: Gather, has_sums: bool, size_px: (u32, u32)) -> bool {
        (self.gather, self.sums.is_some(), self.width_px, self.height_px) == (gather, has_sums, size_px.0, size_px.1)
    }

    pub(crate) fn without_sums(self) -> Self {
        Self { sums: None, ..self }
    }

    /// Whether these targets are no larger than this size.
    pub(crate) fn fit(&self, (width_px, height_px): (u32, u32)) -> bool {
        self.width_px <= width_px && self.height_px <= height_px
    }

    /// Queues the copy of some rows of the display picture to a CPU-readable buffer, and returns the buffer. `None` while an earlier
    /// picture is on its way.
    pub(crate) fn copy_back(&mut self, encoder: &mut wgpu::CommandEncoder, rows: Range<u32>) -> Option<wgpu::Buffer> {
        let buffer = self.read_back.take()?;
        let layout = wgpu::TexelCopyBufferLayout {
            offset: 0,
            bytes_per_row: Some(read_back_row_bytes(self.width_px) as u32),
            rows_per_image: None,
        };
        let size = Extent3d { width: self.width_px, height: rows.end - rows.start, depth_or_array_layers: 1 };
        let destination = wgpu::TexelCopyBufferInfo { buffer: &buffer, layout };
        let origin = wgpu::Origin3d { y: rows.start, ..Default::default() };
        let source = wgpu::TexelCopyTextureInfo { origin, ..self.display.as_image_copy() };
        encoder.copy_texture_to_buffer(source, destination, size);
        Some(buffer)
    }

    /// Starts bringing a picture to the CPU. The last submission must be the one that copies the picture into `buffer`.
    pub(crate) fn reading(&self, buffer: wgpu::Buffer, rows: Range<u32>) -> Reading {
        Reading { mapping: Mapping::begin(buffer), width_px: self.width_px, height_px: self.height_px, rows }
    }

    /// Takes a picture that has reached the CPU, and keeps its buffer for the next one.
    ///
    /// # Errors
    /// If the picture has not arrived yet, or the device is lost.
    pub(crate) fn take(&mut self, gpu: &Gpu, reading: Reading) -> Result<Picture, GpuError> {
        let Reading { mapping, width_px, height_px, rows } = reading;
        let width = width_px as usize;
        let mut rgb = vec![[0; 3]; width * height_px as usize];
        let copied = &mut rgb[rows.start as usize * width..rows.end as usize * width];
        let ((), buffer) = mapping.read(gpu, |bytes| {
            let rows = bytes.chunks_exact(read_back_row_bytes(width_px) as usize);
            let pixels = rows.flat_map(|row| row[..width * 4].chunks_exact(4));
            copied.iter_mut().zip(pixels).for_each(|(to, p)| *to = [p[0], p[1], p[2]]);
        })?;
        if (width_px, height_px) == (self.width_px, self.height_px) {
            self.read_back = Some(buffer);
        }
        Ok(Picture { width: width_px, height: height_px, rgb })
    }
}
