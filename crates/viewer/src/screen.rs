//! The visible texture of a picture on the window's device: drawn there, or filled from the CPU. It has a pass of its own instead of egui's images,
//! whose shader is made for letters and panels: on a software device that took three times as long.

use crate::device::Device;
use brickyard::render::wgpu;
use brickyard::volume::{Picture, PictureSum, PixelSamples};
use eframe::egui::{PaintCallbackInfo, Painter, Rect};
use eframe::egui_wgpu::{Callback, CallbackResources, CallbackTrait};

/// Format of the texture: the window blends in display-referred codes.
pub(crate) const FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba8Unorm;

/// Format of a sum of samples.
const SUM_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba16Float;

/// A texture, and its pass into the window.
pub(crate) struct Screen {
    pub(crate) device: Device,
    pass: Pass,
    texture: Option<Texture>,
    /// Textures of a supersampled picture on a GPU.
    samples: Option<Samples>,
    /// The sum of samples drawn by the CPU.
    sum: PictureSum,
    /// Whether the mean of samples is visible instead of the texture.
    shows_mean: bool,
}

/// A supersampled picture in progress.
struct Samples {
    /// The last drawn sample.
    last: Texture,
    /// The sum of the samples, each weighted by its share. 16-bit floats below 1 are at least eight times finer than codes.
    mean: Texture,
}

struct Texture {
    texture: wgpu::Texture,
    view: wgpu::TextureView,
    size_px: (u32, u32),
    /// Bindings to show it pixel by pixel, and smoothed.
    nearest: wgpu::BindGroup,
    linear: wgpu::BindGroup,
    /// Bindings to add it to a sum.
    adding: wgpu::BindGroup,
    is_smoothed: bool,
}

/// The pass that puts pictures over parts of a window.
#[derive(Clone)]
struct Pass {
    pipeline: wgpu::RenderPipeline,
    /// Adds a picture, weighted by a share, to the mean.
    adding: wgpu::RenderPipeline,
    nearest: wgpu::Sampler,
    linear: wgpu::Sampler,
}

/// A picture for a part of the window.
struct Shown {
    pipeline: wgpu::RenderPipeline,
    bindings: wgpu::BindGroup,
}

impl Screen {
    pub(crate) fn new(device: &Device) -> Self {
        let state = &device.state;
        let mut renderer = state.renderer.write();
        let pass = renderer.callback_resources.entry().or_insert_with(|| Pass::new(&state.device, state.target_format));
        Self {
            device: device.clone(),
            pass: pass.clone(),
            texture: None,
            samples: None,
            sum: PictureSum::default(),
            shows_mean: false,
        }
    }

    /// The texture to draw into, recreated if its size differs.
    pub(crate) fn sized(&mut self, size_px: (u32, u32)) -> &wgpu::TextureView {
        self.shows_mean = false;
        let texture = self.of_size(size_px);
        texture.is_smoothed = false;
        &texture.view
    }

    /// Shows a picture from the CPU: pixel by pixel, or smoothed if it has fewer pixels than the view.
    pub(crate) fn put(&mut self, picture: &Picture, is_smoothed: bool) {
        let size_px = (picture.width, picture.height);
        let rgba = picture.rgba();
        let queue = self.device.state.queue.clone();
        self.shows_mean = false;
        let texture = self.of_size(size_px);
        texture.is_smoothed = is_smoothed;
        let layout =
            wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(4 * size_px.0), rows_per_image: None };
        queue.write_texture(texture.texture.as_image_copy(), &rgba, layout, texture.texture.size());
    }

    /// Puts the picture, if any, over a part of the window.
    pub(crate) fn paint(&self, painter: &Painter, area: Rect) {
        let mean = self.samples.as_ref().map(|samples| &samples.mean).filter(|_| self.shows_mean);
        if let Some(texture) = mean.or(self.texture.as_ref()) {
            let bindings = if texture.is_smoothed { &texture.linear } else { &texture.nearest }.clone();
            let shown = Shown { pipeline: self.pass.pipeline.clone(), bindings };
            painter.add(Callback::new_paint_callback(area, shown));
        }
    }

    fn of_size(&mut self, size_px: (u32, u32)) -> &mut Texture {
        let Self { device, pass, texture, .. } = self;
        if texture.as_ref().is_none_or(|texture| texture.size_px != size_px) {
            *texture = None;
        }
        texture.get_or_insert_with(|| Texture::new(&device.state.device, pass, size_px, FORMAT))
    }

    /// Adds a sample from the CPU to the mean; the first one restarts it.
    pub(crate) fn add(&mut self, picture: &Picture, is_first: bool) {
        if is_first {
            self.sum = PictureSum::default();
        }
        self.sum.add(picture);
    }

    /// The texture for a sample of this size.
    pub(crate) fn sample(&mut self, size_px: (u32, u32)) -> &wgpu::TextureView {
        let Self { device, pass, samples, .. } = self;
        if samples.as_ref().is_none_or(|samples| samples.last.size_px != size_px) {
            *samples = None;
        }
        let of = |format| Texture::new(&device.state.device, pass, size_px, format);
        &samples.get_or_insert_with(|| Samples { last: of(FORMAT), mean: of(SUM_FORMAT) }).last.view
    }

    /// Adds the last drawn sample to the mean of `count`; the first one restarts it.
    pub(crate) fn add_sample(&mut self, encoder: &mut wgpu::CommandEncoder, is_first: bool, count: PixelSamples) {
        let Some(Samples { last, mean }) = &self.samples else { return };
        let load = if is_first { wgpu::LoadOp::Clear(wgpu::Color::BLACK) } else { wgpu::LoadOp::Load };
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("sample of a picture"),
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view: &mean.view,
                depth_slice: None,
                resolve_target: None,
                ops: wgpu::Operations { load, store: wgpu::StoreOp::Store },
            })],
            ..Default::default()
        });
        let share = 1.0 / count.count() as f64;
        pass.set_pipeline(&self.pass.adding);
        pass.set_bind_group(0, &last.adding, &[]);
        pass.set_blend_constant(wgpu::Color { r: share, g: share, b: share, a: share });
        pass.draw(0..3, 0..1);
    }

    /// Shows the mean of the samples from now on.
    pub(crate) fn show_mean(&mut self) {
        let picture = self.sum.mean();
        match picture.rgb.is_empty() {
            true => self.shows_mean = true,
            false => self.put(&picture, false),
        }
    }
}

impl Texture {
    fn new(device: &wgpu::Device, pass: &Pass, size_px: (u32, u32), format: wgpu::TextureFormat) -> Self {
        let texture = device.create_texture(&wgpu::TextureDescriptor {
            label: Some("volume"),
            size: wgpu::Extent3d { width: size_px.0, height: size_px.1, depth_or_array_layers: 1 },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format,
            usage: wgpu::TextureUsages::RENDER_ATTACHMENT
                | wgpu::TextureUsages::TEXTURE_BINDING
                | wgpu::TextureUsages::COPY_DST,
            view_formats: &[],
        });
        let view = texture.create_view(&Default::default());
        let [nearest, linear, adding] =
            [(&pass.pipeline, &pass.nearest), (&pass.pipeline, &pass.linear), (&pass.adding, &pass.nearest)].map(
                |(pipeline, sampler)| {
                    let entry = |binding, resource| wgpu::BindGroupEntry { binding, resource };
                    device.create_bind_group(&wgpu::BindGroupDescriptor {
                        label: Some("picture in the window"),
                        layout: &pipeline.get_bind_group_layout(0),
                        entries: &[
                            entry(0, wgpu::BindingResource::TextureView(&view)),
                            entry(1, wgpu::BindingResource::Sampler(sampler)),
                        ],
                    })
                },
            );
        Self { texture, view, size_px, nearest, linear, adding, is_smoothed: false }
    }
}

impl Pass {
    fn new(device: &wgpu::Device, format: wgpu::TextureFormat) -> Self {
        let source = wgpu::ShaderSource::Wgsl(include_str!("screen.wgsl").into());
        let module =
            device.create_shader_module(wgpu::ShaderModuleDescriptor { label: Some("picture in the window"), source });
        let pipeline = |entry_point, target: wgpu::ColorTargetState| {
            device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
                label: Some("picture in the window"),
                layout: None,
                vertex: wgpu::VertexState {
                    module: &module,
                    entry_point: Some("corner"),
                    compilation_options: Default::default(),
                    buffers: &[],
                },
                fragment: Some(wgpu::FragmentState {
                    module: &module,
                    entry_point: Some(entry_point),
                    compilation_options: Default::default(),
                    targets: &[Some(target)],
                }),
                primitive: Default::default(),
                depth_stencil: None,
                multisample: Default::default(),
                multiview_mask: None,
                cache: None,
            })
        };
        let by_share = wgpu::BlendComponent {
            src_factor: wgpu::BlendFactor::Constant,
            dst_factor: wgpu::BlendFactor::One,
            operation: wgpu::BlendOperation::Add,
        };
        let blend = Some(wgpu::BlendState { color: by_share, alpha: by_share });
        let sum = wgpu::ColorTargetState { format: SUM_FORMAT, blend, write_mask: wgpu::ColorWrites::ALL };
        let adding = pipeline("codes", sum);
        let pipeline = pipeline(if format.is_srgb() { "light" } else { "codes" }, format.into());
        let sampler = |filter| {
            device.create_sampler(&wgpu::SamplerDescriptor {
                mag_filter: filter,
                min_filter: filter,
                ..Default::default()
            })
        };
        Self {
            pipeline,
            adding,
            nearest: sampler(wgpu::FilterMode::Nearest),
            linear: sampler(wgpu::FilterMode::Linear),
        }
    }
}

impl CallbackTrait for Shown {
    fn paint(&self, _: PaintCallbackInfo, pass: &mut wgpu::RenderPass<'static>, _: &CallbackResources) {
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, &self.bindings, &[]);
        pass.draw(0..3, 0..1);
    }
}
