//! The blit of a finished picture onto an application's texture: one pass in the application's encoder, reading only
//! the renderer's own picture.

use crate::adapter::DISPLAY_FORMAT;
use crate::atlas::texel_bytes;
use crate::buffers::{self, entry};
use crate::layouts::{bind_group_layout, texture};
use crate::march::{attachment, color_pass, draw_over_all};
use crate::pipelines::{Shape, pipeline};
use crate::targets::{Reading, Targets};
use crate::{Gpu, GpuError};
use brickyard_shaders::{bindings, blit};
use brickyard_volume::StereoLayout;
use std::collections::HashMap;
use wgpu::{BindingResource, BindingType, SamplerBindingType, ShaderStages, TextureFormat};

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
    pipelines: HashMap<(TextureFormat, Option<StereoLayout>), wgpu::RenderPipeline>,
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
        let layout = bind_group_layout(gpu, "picture", &layout);
        Self { layout, sampler: gpu.linear_sampler("picture"), pipelines: HashMap::new(), left: None }
    }

    /// Keeps the last drawn picture as the left eye's.
    ///
    /// # Errors
    /// If the device has no room for it.
    pub(crate) fn keep_left(&mut self, gpu: &Gpu, targets: &Targets) -> Result<(), GpuError> {
        let size = targets.display.size();
        if self.left.as_ref().is_none_or(|left| left.size() != size) {
            self.left = None;
            let (label, bytes) = ("the left eye", size.width as u64 * size.height as u64 * texel_bytes(DISPLAY_FORMAT));
            let usage = wgpu::TextureUsages::COPY_DST | wgpu::TextureUsages::TEXTURE_BINDING;
            let make = |device: &wgpu::Device| {
                buffers::texture(device, label, size, wgpu::TextureDimension::D2, DISPLAY_FORMAT, usage)
            };
            self.left = Some(gpu.allocate(label, bytes, make)?);
        }
        if let Some(left) = &self.left {
            let (from, to) = (targets.display.as_image_copy(), left.as_image_copy());
            gpu.submit(|encoder| encoder.copy_texture_to_texture(from, to, size));
        }
        Ok(())
    }

    /// Creates a target's pipeline unless it exists.
    fn make_ready(&mut self, gpu: &Gpu, format: TextureFormat, stereo: Option<StereoLayout>) -> Result<(), GpuError> {
        if !self.pipelines.contains_key(&(format, stereo)) {
            let (source, entries) = (blit(stereo, format.is_srgb()), ["stretched", "blit"]);
            let make = || pipeline(gpu, &source, &[&self.layout], entries, Shape::default(), &[format.into()]);
            let made = gpu.guarded(make)?;
            self.pipelines.insert((format, stereo), made);
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
        targets: &Targets,
        stereo: Option<StereoLayout>,
        target: &Target<'_>,
        encoder: &mut wgpu::CommandEncoder,
    ) -> Result<(), GpuError> {
        self.make_ready(gpu, target.format, stereo)?;
        let left = self.left.as_ref().filter(|_| stereo.is_some()).unwrap_or(&targets.display);
        let left = left.create_view(&Default::default());
        let entries = [
            entry(bindings::LEFT_PICTURE, BindingResource::TextureView(&left)),
            entry(bindings::RIGHT_PICTURE, BindingResource::TextureView(&targets.display_view)),
            entry(bindings::PICTURE_SAMPLER, BindingResource::Sampler(&self.sampler)),
        ];
        let bindings = gpu.bind_group("picture", &self.layout, &entries);
        let attachment = attachment(target.view, wgpu::LoadOp::Load);
        let mut pass = color_pass(encoder, "brickyard's picture", &[attachment], None);
        if let Some([x, y, width, height]) = target.area_px {
            pass.set_viewport(x as f32, y as f32, width as f32, height as f32, 0.0, 1.0);
        }
        draw_over_all(&mut pass, &self.pipelines[&(target.format, stereo)], &bindings);
        Ok(())
    }
}
