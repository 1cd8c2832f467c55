//! The blit of a finished picture onto an application's texture: one pass in the application's encoder, reading only
//! the renderer's own picture.

use crate::buffers::entry;
use crate::error::GpuError;
use crate::gpu::Gpu;
use crate::layouts::{bind_group_layout, texture};
use crate::pipelines::{DISPLAY_FORMAT, Shape, pipeline};
use crate::targets::{Reading, Targets};
use brickyard_shaders::{Eyes, bindings, blit};
use brickyard_volume::StereoLayout;
use std::collections::HashMap;
use wgpu::{BindingResource, BindingType, FilterMode, SamplerBindingType, ShaderStages, TextureFormat};

/// An application's texture, or a part of it, to receive a picture.
#[derive(Clone, Copy, Debug)]
pub struct Target<'a> {
    /// A view of a renderable colour texture without multisampling.
    pub view: &'a wgpu::TextureView,
    /// The view's format. The texture receives the picture's sRGB codes unchanged, whether or not its format is an sRGB
    /// format.
    pub format: TextureFormat,
    /// The area to stretch the picture over, in pixels from the upper left corner: x, y, width, height. The rest stays
    /// unchanged. `None` is the whole texture.
    pub area_px: Option<[u32; 4]>,
}

/// Puts pictures on an application's textures: pipelines, and the left eye's picture.
#[derive(Debug)]
pub(crate) struct Blit {
    layout: wgpu::BindGroupLayout,
    sampler: wgpu::Sampler,
    pipelines: HashMap<(TextureFormat, Eyes), wgpu::RenderPipeline>,
    /// The left eye's picture, kept while the right eye's is drawn and afterwards.
    left: Option<wgpu::Texture>,
}

/// A renderer's last shown picture, on its way to another renderer.
#[derive(Debug)]
pub(crate) struct LastPicture {
    pub(crate) targets: Targets,
    pub(crate) blit: Blit,
    pub(crate) reading: Option<Reading>,
}

impl Blit {
    pub(crate) fn new(gpu: &Gpu) -> Self {
        let fragment = ShaderStages::FRAGMENT;
        let picture = texture(wgpu::TextureViewDimension::D2, true);
        let layout = [
            (bindings::LEFT_PICTURE, fragment, picture),
            (bindings::RIGHT_PICTURE, fragment, picture),
            (bindings::PICTURE_SAMPLER, fragment, BindingType::Sampler(SamplerBindingType::Filtering)),
        ];
        let sampler = gpu.device.create_sampler(&wgpu::SamplerDescriptor {
            label: Some("picture"),
            mag_filter: FilterMode::Linear,
            min_filter: FilterMode::Linear,
            ..Default::default()
        });
        let layout = bind_group_layout(gpu, "picture", &layout);
        Self { layout, sampler, pipelines: HashMap::new(), left: None }
    }

    /// Keeps the last drawn picture as the left eye's.
    ///
    /// # Errors
    /// If the device has no room for it.
    pub(crate) fn keep_left(&mut self, gpu: &Gpu, targets: &Targets) -> Result<(), GpuError> {
        let size = targets.display.size();
        if self.left.as_ref().is_none_or(|left| left.size() != size) {
            self.left = None;
            let bytes = size.width as u64 * size.height as u64 * 4;
            let descriptor = wgpu::TextureDescriptor {
                label: Some("the left eye"),
                size,
                mip_level_count: 1,
                sample_count: 1,
                dimension: wgpu::TextureDimension::D2,
                format: DISPLAY_FORMAT,
                usage: wgpu::TextureUsages::COPY_DST | wgpu::TextureUsages::TEXTURE_BINDING,
                view_formats: &[],
            };
            self.left = Some(gpu.allocate("the left eye", bytes, |device| device.create_texture(&descriptor))?);
        }
        if let Some(left) = &self.left {
            let mut encoder = gpu.device.create_command_encoder(&Default::default());
            encoder.copy_texture_to_texture(targets.display.as_image_copy(), left.as_image_copy(), size);
            gpu.queue.submit([encoder.finish()]);
        }
        Ok(())
    }

    /// Creates a target's pipeline unless it exists.
    fn make_ready(&mut self, gpu: &Gpu, wanted: (TextureFormat, Eyes)) -> Result<(), GpuError> {
        if !self.pipelines.contains_key(&wanted) {
            let (format, eyes) = wanted;
            let (source, entries) = (blit(eyes, format.is_srgb()), ["stretched", "blit"]);
            let make = || pipeline(gpu, &source, &[&self.layout], entries, Shape::default(), &[format.into()]);
            let made = gpu.guarded(make)?;
            self.pipelines.insert(wanted, made);
        }
        Ok(())
    }

    /// Records the pass that puts the last drawn picture, or those of two eyes, on a target.
    ///
    /// # Errors
    /// If the target's format cannot be drawn into.
    pub(crate) fn record(
        &mut self,
        gpu: &Gpu,
        (targets, stereo): (&Targets, Option<StereoLayout>),
        target: &Target<'_>,
        encoder: &mut wgpu::CommandEncoder,
    ) -> Result<(), GpuError> {
        let wanted = (target.format, stereo.map_or(Eyes::One, eyes));
        self.make_ready(gpu, wanted)?;
        let left = self.left.as_ref().filter(|_| stereo.is_some()).unwrap_or(&targets.display);
        let left = left.create_view(&Default::default());
        let bindings = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("picture"),
            layout: &self.layout,
            entries: &[
                entry(bindings::LEFT_PICTURE, BindingResource::TextureView(&left)),
                entry(bindings::RIGHT_PICTURE, BindingResource::TextureView(&targets.display_view)),
                entry(bindings::PICTURE_SAMPLER, BindingResource::Sampler(&self.sampler)),
            ],
        });
        let ops = wgpu::Operations { load: wgpu::LoadOp::Load, store: wgpu::StoreOp::Store };
        let attachment =
            wgpu::RenderPassColorAttachment { view: target.view, depth_slice: None, resolve_target: None, ops };
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("brickyard's picture"),
            color_attachments: &[Some(attachment)],
            ..Default::default()
        });
        if let Some([x, y, width, height]) = target.area_px {
            pass.set_viewport(x as f32, y as f32, width as f32, height as f32, 0.0, 1.0);
        }
        pass.set_pipeline(&self.pipelines[&wanted]);
        pass.set_bind_group(0, &bindings, &[]);
        pass.draw(0..3, 0..1);
        Ok(())
    }
}

fn eyes(layout: StereoLayout) -> Eyes {
    match layout {
        StereoLayout::SideBySide => Eyes::SideBySide,
        StereoLayout::TopBottom => Eyes::TopBottom,
        StereoLayout::Anaglyph => Eyes::Anaglyph,
        StereoLayout::Interlaced => Eyes::Interlaced,
    }
}
