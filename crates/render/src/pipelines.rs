//! The creation of pipelines: the compositor's march for each way of gathering, and the resolve passes. It is
//! independent of frames, and works on any thread (`pipeline_cache`).

use crate::adapter::{DISPLAY_FORMAT, GpuFormats};
use crate::layouts::{Layouts, MeshLayouts, bind_group_layout};
use crate::variant::Shader;
use crate::{Compositor, Gpu, GpuError};
use brickyard_shaders::{Gather, Seen, Shown, Stage, bindings, raycast, raycast_joint, resolve, sorted, sorted_joint};
use wgpu::{
    BindingType, BlendComponent, BlendFactor, BlendOperation, ShaderStages, TextureFormat, TextureViewDimension,
};

/// Returns the format of the target of gathered samples.
pub(crate) fn gather_format(gather: Gather, compositor: Compositor, formats: &GpuFormats) -> TextureFormat {
    match (gather, compositor) {
        (Gather::Composite | Gather::Isosurface, _) => formats.composite,
        // A format that compute shaders need not be able to write.
        (_, Compositor::Compute) if formats.project == TextureFormat::Rg16Float => TextureFormat::Rgba16Float,
        (Gather::Project | Gather::Average, _) => formats.project,
    }
}

/// The WGSL name of a gathered format.
fn texel_format(format: TextureFormat) -> &'static str {
    match format {
        TextureFormat::Rgba32Float => "rgba32float",
        TextureFormat::Rg32Float => "rg32float",
        _ => "rgba16float",
    }
}

/// The bind group with the texture written by compute shaders.
pub(crate) const TEXELS_GROUP: u32 = 2;

/// A pipeline needed by a picture.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub(crate) enum Wanted {
    /// A march, which gathers samples.
    March(Shader),
    /// A pass that resolves gathered samples to colours.
    Resolve(Seen, Shown),
}

/// A compiled pipeline.
#[derive(Debug)]
pub(crate) enum Pipeline {
    Render(wgpu::RenderPipeline),
    Compute(wgpu::ComputePipeline),
}

/// The blending of cells: *over* from back to front, the greater, or the sum.
fn blend(gather: Gather) -> wgpu::BlendState {
    match gather {
        Gather::Composite | Gather::Isosurface => OVER,
        Gather::Project => alike(BlendFactor::One, BlendOperation::Max),
        Gather::Average => SUM,
    }
}

/// Blends colours and opacity alike: a share of the source with all of the target.
const fn alike(src_factor: BlendFactor, operation: BlendOperation) -> wgpu::BlendState {
    let component = BlendComponent { src_factor, dst_factor: BlendFactor::One, operation };
    wgpu::BlendState { color: component, alpha: component }
}

/// Blends behind the target, premultiplied.
const BEHIND: wgpu::BlendState = alike(BlendFactor::OneMinusDstAlpha, BlendOperation::Add);

/// How a render pipeline assembles primitives, and its depth test.
#[derive(Clone, Default)]
pub(crate) struct Shape {
    pub(crate) primitive: wgpu::PrimitiveState,
    pub(crate) depth_stencil: Option<wgpu::DepthStencilState>,
}

/// Adds to the target.
const SUM: wgpu::BlendState = alike(BlendFactor::One, BlendOperation::Add);

/// Blends over the target, premultiplied.
const OVER: wgpu::BlendState = wgpu::BlendState::PREMULTIPLIED_ALPHA_BLENDING;

fn write(format: TextureFormat, blend: Option<wgpu::BlendState>) -> wgpu::ColorTargetState {
    wgpu::ColorTargetState { format, blend, write_mask: wgpu::ColorWrites::ALL }
}

/// A factory for a renderer's pipelines, usable on any thread.
#[derive(Debug)]
pub(crate) struct Maker {
    pub(crate) gpu: Gpu,
    pub(crate) compositor: Compositor,
    pub(crate) layouts: Layouts,
    /// The layouts of meshes; `None` if pictures never have meshes.
    pub(crate) meshes: Option<MeshLayouts>,
}

impl Maker {
    /// Whether this maker's pipelines can replace another's. wgpu treats layouts with equal entries as the same.
    pub(crate) fn makes_the_same(&self, other: &Self) -> bool {
        self.gpu.device == other.gpu.device
            && self.compositor == other.compositor
            && self.layouts.of == other.layouts.of
            && self.meshes.is_some() == other.meshes.is_some()
    }

    /// Creates a pipeline. On a GPU this compiles its shader; some software rasterisers leave most of that to the first
    /// draw.
    ///
    /// # Errors
    /// If the device cannot create it.
    pub(crate) fn make(&self, wanted: &Wanted) -> Result<Pipeline, GpuError> {
        self.gpu.guarded(|| match wanted {
            Wanted::March(shader) => self.march(shader),
            Wanted::Resolve(seen, shown) => self.resolve(*seen, *shown),
        })
    }

    fn march(&self, shader: &Shader) -> Pipeline {
        let Self { gpu, compositor, layouts, meshes } = self;
        let (gather, own) = match shader {
            Shader::Single(variant) => (variant.gather, layouts.march(variant.voxels.is_float)),
            Shader::Joint(_) => (Gather::Composite, &layouts.joint),
        };
        let limits = meshes.as_ref().filter(|_| shader.has_meshes()).map(|meshes| &meshes.limits);
        let format = gather_format(gather, *compositor, &gpu.report.formats);
        let bindings: Vec<_> = [Some(own), limits].into_iter().flatten().collect();
        let cast = |stage| match shader {
            Shader::Single(variant) => raycast(variant, stage, gpu.report.feedback),
            Shader::Joint(variant) => raycast_joint(variant, stage, gpu.report.feedback),
        };
        match compositor {
            Compositor::Sorted => {
                let source = match shader {
                    Shader::Single(variant) => sorted(variant),
                    Shader::Joint(variant) => sorted_joint(variant),
                };
                let primitive = wgpu::PrimitiveState {
                    topology: wgpu::PrimitiveTopology::TriangleStrip,
                    cull_mode: Some(wgpu::Face::Front),
                    ..Default::default()
                };
                let boxes = Shape { primitive, ..Shape::default() };
                let (target, entries) = (write(format, Some(blend(gather))), ["proxy", "march"]);
                Pipeline::Render(pipeline(gpu, &source, &bindings, entries, boxes, &[target]))
            }
            Compositor::Compute => {
                let source = cast(Stage::Compute(texel_format(format)));
                Pipeline::Compute(compute_pipeline(gpu, &source, own, limits, format))
            }
            Compositor::Raycast => {
                let (source, entries) = (cast(Stage::Fragment), ["fullscreen", "raycast"]);
                Pipeline::Render(pipeline(gpu, &source, &bindings, entries, Shape::default(), &[format.into()]))
            }
        }
    }

    fn resolve(&self, seen: Seen, shown: Shown) -> Pipeline {
        let own = if seen == Seen::Joined { &self.layouts.joined } else { &self.layouts.resolve };
        let slab = self.meshes.as_ref().filter(|_| shown == Shown::Slab).map(|meshes| &meshes.layer);
        let layouts: Vec<_> = [Some(own), slab].into_iter().flatten().collect();
        let composite = self.gpu.report.formats.composite;
        let targets = match shown {
            Shown::Picture => vec![DISPLAY_FORMAT.into()],
            Shown::Slab => vec![write(composite, Some(BEHIND))],
            // Additive layers have no opacity.
            Shown::Sums | Shown::Over => vec![write(composite, Some(SUM)), write(composite, Some(OVER))],
        };
        let (source, entries) = (resolve(seen, shown), ["fullscreen", "resolve"]);
        Pipeline::Render(pipeline(&self.gpu, &source, &layouts, entries, Shape::default(), &targets))
    }
}

/// A compute pipeline that writes texels of a format, limited to slabs if there are meshes.
fn compute_pipeline(
    gpu: &Gpu,
    source: &str,
    march: &wgpu::BindGroupLayout,
    limits: Option<&wgpu::BindGroupLayout>,
    format: TextureFormat,
) -> wgpu::ComputePipeline {
    let access = wgpu::StorageTextureAccess::WriteOnly;
    let written = BindingType::StorageTexture { access, format, view_dimension: TextureViewDimension::D2 };
    let texels = bind_group_layout(gpu, "texels", &[(bindings::TEXELS, ShaderStages::COMPUTE, written)]);
    let (module, layout) = shader(&gpu.device, "raycast", source, &[Some(march), limits, Some(&texels)]);
    gpu.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: Some("raycast"),
        layout: Some(&layout),
        module: &module,
        entry_point: Some("raycast"),
        compilation_options: Default::default(),
        cache: None,
    })
}

fn shader(
    device: &wgpu::Device,
    label: &str,
    source: &str,
    bindings: &[Option<&wgpu::BindGroupLayout>],
) -> (wgpu::ShaderModule, wgpu::PipelineLayout) {
    let source = wgpu::ShaderSource::Wgsl(source.into());
    let module = device.create_shader_module(wgpu::ShaderModuleDescriptor { label: Some(label), source });
    let layout = wgpu::PipelineLayoutDescriptor { label: Some(label), bind_group_layouts: bindings, immediate_size: 0 };
    (module, device.create_pipeline_layout(&layout))
}

pub(crate) fn pipeline(
    gpu: &Gpu,
    source: &str,
    bindings: &[&wgpu::BindGroupLayout],
    [vertex, fragment]: [&str; 2],
    shape: Shape,
    targets: &[wgpu::ColorTargetState],
) -> wgpu::RenderPipeline {
    let device = &gpu.device;
    let bindings: Vec<_> = bindings.iter().map(|&layout| Some(layout)).collect();
    let (module, layout) = shader(device, fragment, source, &bindings);
    let targets: Vec<_> = targets.iter().cloned().map(Some).collect();
    device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some(fragment),
        layout: Some(&layout),
        vertex: wgpu::VertexState {
            module: &module,
            entry_point: Some(vertex),
            compilation_options: Default::default(),
            buffers: &[],
        },
        primitive: shape.primitive,
        depth_stencil: shape.depth_stencil,
        multisample: Default::default(),
        fragment: Some(wgpu::FragmentState {
            module: &module,
            entry_point: Some(fragment),
            compilation_options: Default::default(),
            targets: &targets,
        }),
        multiview_mask: None,
        cache: None,
    })
}
