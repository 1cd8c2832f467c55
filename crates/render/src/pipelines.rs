//! Pipelines: for each way to gather samples, the compositor's march and the pass that makes display colours of it. Made when
//! first used.

use crate::adapter::{Gpu, GpuFormats};
use crate::compositor::Compositor;
use brickyard_shaders::{
    Curve, ExpressionShader, FIRST_ATLAS, FIRST_GRADIENTS, Gather, Light, Medium, Stage, Surfaces, Variant,
    VolumeShader, raycast, raycast_together, resolve, sorted,
};
use brickyard_volume::{Filter, FrameSettings, Gradient, Lighting, LightingModel, Mode, sampling};
use wgpu::{
    BindingType, BlendComponent, BlendFactor, BlendOperation, ShaderStages, TextureFormat, TextureViewDimension,
};

/// Format of the finished picture. Colours are display-referred as they are: no sRGB conversion.
pub(crate) const DISPLAY_FORMAT: TextureFormat = TextureFormat::Rgba8Unorm;

/// How a frame gathers.
fn gather_of(frame: &FrameSettings) -> Gather {
    match frame.mode {
        Mode::Mip | Mode::MinIp => Gather::Project,
        Mode::Average => Gather::Average,
        Mode::Isosurface if frame.is_one_opaque_surface() => Gather::Isosurface,
        Mode::Dvr | Mode::Isosurface => Gather::Composite,
    }
}

/// How a composite's segments become media.
fn medium_of(frame: &FrameSettings) -> Medium {
    let method = frame.sampling.method;
    let curve = match method.curve() {
        sampling::Curve::Middle => Curve::Middle,
        sampling::Curve::Line => Curve::Line,
        sampling::Curve::Cubic => Curve::Cubic,
        sampling::Curve::Field => Curve::Field,
    };
    let light = light_of(&frame.lighting);
    let surfaces = match frame.mode {
        Mode::Isosurface => Surfaces::Alone,
        _ if frame.surfaces.is_empty() => Surfaces::None,
        _ => Surfaces::InFog,
    };
    // Where a gradient is asked for by nothing there is no variant of its own for each.
    let has_grid = frame.grid().is_some();
    let has_gradients = light != Light::Unlit || surfaces != Surfaces::None || has_grid;
    let gradient = gradient_of(&frame.lighting, has_gradients);
    if surfaces == Surfaces::Alone {
        // Nor a method without fog.
        return Medium { light, gradient, surfaces, ..Medium::PLAIN };
    }
    let (parts, is_pre_integrated) = (frame.sampling.parts(0.0) as u32, method.is_pre_integrated());
    Medium { curve, parts, is_pre_integrated, light, gradient, surfaces, has_grid }
}

/// How colours become lit ones.
pub(crate) fn light_of(lighting: &Lighting) -> Light {
    match lighting.model {
        LightingModel::None => Light::Unlit,
        LightingModel::Phong => Light::Phong,
        LightingModel::BlinnPhong => Light::BlinnPhong,
        LightingModel::Tone => Light::Tone,
    }
}

/// How gradients are found; the same where none is asked for.
pub(crate) fn gradient_of(lighting: &Lighting, is_lit: bool) -> brickyard_shaders::Gradient {
    match lighting.gradient {
        Gradient::Sobel if is_lit => brickyard_shaders::Gradient::Sobel,
        Gradient::Stored if is_lit => brickyard_shaders::Gradient::Stored,
        _ => brickyard_shaders::Gradient::Central,
    }
}

/// The march that a frame needs.
pub(crate) fn variant_of(frame: &FrameSettings) -> Variant {
    let gather = gather_of(frame);
    let medium = match gather {
        Gather::Composite => medium_of(frame),
        Gather::Project | Gather::Average | Gather::Isosurface => Medium::PLAIN,
    };
    let is_cubic = frame.sampling.filter == Filter::Tricubic;
    let has_meshes = !frame.meshes.is_empty();
    Variant { gather, has_invalid: frame.encoding.has_invalid, is_cubic, medium, has_meshes }
}

/// The format that a gathering needs.
pub(crate) fn gather_format(gather: Gather, compositor: Compositor, formats: &GpuFormats) -> TextureFormat {
    match (gather, compositor) {
        (Gather::Composite | Gather::Isosurface, _) => formats.composite,
        // What no compute shader need be able to write.
        (_, Compositor::Compute) if formats.project == TextureFormat::Rg16Float => TextureFormat::Rgba16Float,
        (Gather::Project | Gather::Average, _) => formats.project,
    }
}

/// What WGSL calls a format that is gathered into.
fn texel_format(format: TextureFormat) -> &'static str {
    match format {
        TextureFormat::Rgba32Float => "rgba32float",
        TextureFormat::Rg32Float => "rg32float",
        _ => "rgba16float",
    }
}

/// Where compute shaders find the texture that they write.
pub(crate) const TEXELS_GROUP: u32 = 2;

/// The pipeline of a march.
#[derive(Debug)]
pub(crate) enum MarchPipeline {
    Fragment(wgpu::RenderPipeline),
    Compute(wgpu::ComputePipeline),
}

/// The bind group layouts that all variants share.
#[derive(Debug)]
pub(crate) struct Layouts {
    pub(crate) march: wgpu::BindGroupLayout,
    pub(crate) resolve: wgpu::BindGroupLayout,
}

/// The bind group layouts that marches and slabs need besides their own.
pub(crate) struct MeshLayouts<'a> {
    pub(crate) limits: &'a wgpu::BindGroupLayout,
    pub(crate) layer: &'a wgpu::BindGroupLayout,
}

/// The two pipelines of one way to gather.
#[derive(Debug)]
pub(crate) struct Pipelines {
    pub(crate) march: MarchPipeline,
    pub(crate) resolve: wgpu::RenderPipeline,
}

fn buffer(ty: wgpu::BufferBindingType) -> BindingType {
    BindingType::Buffer { ty, has_dynamic_offset: false, min_binding_size: None }
}

/// A buffer that shaders read.
pub(crate) fn storage() -> BindingType {
    buffer(wgpu::BufferBindingType::Storage { read_only: true })
}

pub(crate) fn texture(view_dimension: TextureViewDimension, filterable: bool) -> BindingType {
    let sample_type = wgpu::TextureSampleType::Float { filterable };
    BindingType::Texture { sample_type, view_dimension, multisampled: false }
}

/// A flat texture of what is no colour.
pub(crate) fn texture_of(sample_type: wgpu::TextureSampleType) -> BindingType {
    BindingType::Texture { sample_type, view_dimension: TextureViewDimension::D2, multisampled: false }
}

pub(crate) fn bind_group_layout(
    gpu: &Gpu,
    label: &str,
    entries: &[(u32, ShaderStages, BindingType)],
) -> wgpu::BindGroupLayout {
    let entry = |&(binding, visibility, ty): &(u32, ShaderStages, BindingType)| wgpu::BindGroupLayoutEntry {
        binding,
        visibility,
        ty,
        count: None,
    };
    let entries: Vec<_> = entries.iter().map(entry).collect();
    let descriptor = wgpu::BindGroupLayoutDescriptor { label: Some(label), entries: &entries };
    gpu.device.create_bind_group_layout(&descriptor)
}

impl Layouts {
    /// Those of one volume, with stored gradients or without.
    pub(crate) fn new(gpu: &Gpu, compositor: Compositor, has_gradients: bool) -> Self {
        let stage = match compositor {
            Compositor::Sorted | Compositor::Raycast => ShaderStages::FRAGMENT,
            Compositor::Compute => ShaderStages::COMPUTE,
        };
        let mut march = vec![
            (0, ShaderStages::VERTEX | stage, storage()),
            (2, stage, texture(TextureViewDimension::D3, true)),
            (3, stage, BindingType::Sampler(wgpu::SamplerBindingType::Filtering)),
            (4, stage, storage()),
        ];
        march.extend(has_gradients.then_some((10, stage, texture(TextureViewDimension::D3, true))));
        match compositor {
            Compositor::Sorted => march.push((1, ShaderStages::VERTEX, storage())),
            Compositor::Raycast | Compositor::Compute => {
                march.extend([1, 6, 7, 8].map(|binding| (binding, stage, storage())));
                let written = buffer(wgpu::BufferBindingType::Storage { read_only: false });
                march.extend(gpu.report.feedback.then_some((9, stage, written)));
            }
        }
        Self::of(gpu, &march)
    }

    /// Those of several volumes, whose atlases begin at [`FIRST_ATLAS`], with stored gradients from [`FIRST_GRADIENTS`] on or without.
    pub(crate) fn together(gpu: &Gpu, volumes: usize, has_gradients: bool) -> Self {
        let fragment = ShaderStages::FRAGMENT;
        let mut march: Vec<_> = [0, 1, 4, 6, 7, 8].map(|binding| (binding, fragment, storage())).into();
        march.push((3, fragment, BindingType::Sampler(wgpu::SamplerBindingType::Filtering)));
        let gradients = (FIRST_GRADIENTS..).take(if has_gradients { volumes } else { 0 });
        let textures = (FIRST_ATLAS..).take(volumes).chain(gradients);
        march.extend(textures.map(|binding| (binding, fragment, texture(TextureViewDimension::D3, true))));
        Self::of(gpu, &march)
    }

    fn of(gpu: &Gpu, march: &[(u32, ShaderStages, BindingType)]) -> Self {
        let fragment = ShaderStages::FRAGMENT;
        let gathered = (5, fragment, texture(TextureViewDimension::D2, false));
        let resolve = [(0, fragment, storage()), (4, fragment, storage()), gathered];
        Self { march: bind_group_layout(gpu, "march", march), resolve: bind_group_layout(gpu, "resolve", &resolve) }
    }
}

/// How cells meet: *over* from back to front, the greater, or the sum.
fn blend(gather: Gather) -> wgpu::BlendState {
    let (dst_factor, operation) = match gather {
        Gather::Composite | Gather::Isosurface => (BlendFactor::OneMinusSrcAlpha, BlendOperation::Add),
        Gather::Project => (BlendFactor::One, BlendOperation::Max),
        Gather::Average => (BlendFactor::One, BlendOperation::Add),
    };
    let component = BlendComponent { src_factor: BlendFactor::One, dst_factor, operation };
    wgpu::BlendState { color: component, alpha: component }
}

/// What is behind what is there, premultiplied.
const BEHIND: wgpu::BlendState = {
    let component = BlendComponent {
        src_factor: BlendFactor::OneMinusDstAlpha,
        dst_factor: BlendFactor::One,
        operation: BlendOperation::Add,
    };
    wgpu::BlendState { color: component, alpha: component }
};

/// What a pipeline makes of its vertices.
#[derive(Clone, Default)]
pub(crate) struct Shape {
    pub(crate) primitive: wgpu::PrimitiveState,
    pub(crate) depth_stencil: Option<wgpu::DepthStencilState>,
}

impl Pipelines {
    /// With `meshes`, for frames that have some.
    pub(crate) fn new(
        gpu: &Gpu,
        layouts: &Layouts,
        meshes: Option<&MeshLayouts<'_>>,
        compositor: Compositor,
        variant: &Variant,
    ) -> Self {
        let gather = variant.gather;
        let format = gather_format(gather, compositor, &gpu.report.formats);
        let boxes = wgpu::PrimitiveState {
            topology: wgpu::PrimitiveTopology::TriangleStrip,
            cull_mode: Some(wgpu::Face::Front),
            ..Default::default()
        };
        let boxes = Shape { primitive: boxes, ..Shape::default() };
        let with = |own, other| [Some(own), other].into_iter().flatten().collect::<Vec<_>>();
        let bindings = with(&layouts.march, meshes.map(|meshes| meshes.limits));
        let write = |format, blend| wgpu::ColorTargetState { format, blend, write_mask: wgpu::ColorWrites::ALL };
        let march = match compositor {
            Compositor::Sorted => {
                let target = write(format, Some(blend(gather)));
                let entries = ["proxy", "march"];
                MarchPipeline::Fragment(pipeline(gpu, &sorted(variant), &bindings, entries, boxes, &[target]))
            }
            Compositor::Raycast => {
                let source = raycast(variant, Stage::Fragment, gpu.report.feedback);
                let (entries, shape) = (["fullscreen", "raycast"], Shape::default());
                MarchPipeline::Fragment(pipeline(gpu, &source, &bindings, entries, shape, &[format.into()]))
            }
            Compositor::Compute => {
                let source = raycast(variant, Stage::Compute(texel_format(format)), gpu.report.feedback);
                let limits = meshes.map(|meshes| meshes.limits);
                MarchPipeline::Compute(compute_pipeline(gpu, &source, &layouts.march, limits, format))
            }
        };
        let target = match meshes {
            None => DISPLAY_FORMAT.into(),
            Some(_) => write(gpu.report.formats.composite, Some(BEHIND)),
        };
        let bindings = with(&layouts.resolve, meshes.map(|meshes| meshes.layer));
        let (source, entries) = (resolve(gather, variant.has_meshes), ["fullscreen", "resolve"]);
        Self { march, resolve: pipeline(gpu, &source, &bindings, entries, Shape::default(), &[target]) }
    }

    /// Those of several volumes.
    pub(crate) fn together(
        gpu: &Gpu,
        layouts: &Layouts,
        volumes: &[VolumeShader],
        expression: Option<&ExpressionShader>,
    ) -> Self {
        let format = gather_format(Gather::Composite, Compositor::Raycast, &gpu.report.formats);
        let make = |source: &str, bindings: &wgpu::BindGroupLayout, fragment: &'static str, target: TextureFormat| {
            pipeline(gpu, source, &[bindings], ["fullscreen", fragment], Shape::default(), &[target.into()])
        };
        Self {
            march: MarchPipeline::Fragment(make(
                &raycast_together(volumes, expression),
                &layouts.march,
                "raycast",
                format,
            )),
            resolve: make(&resolve(Gather::Composite, false), &layouts.resolve, "resolve", DISPLAY_FORMAT),
        }
    }
}

/// A compute shader that writes texels of a format; with what limits it, where there are meshes.
fn compute_pipeline(
    gpu: &Gpu,
    source: &str,
    march: &wgpu::BindGroupLayout,
    limits: Option<&wgpu::BindGroupLayout>,
    format: TextureFormat,
) -> wgpu::ComputePipeline {
    let access = wgpu::StorageTextureAccess::WriteOnly;
    let written = BindingType::StorageTexture { access, format, view_dimension: TextureViewDimension::D2 };
    let texels = bind_group_layout(gpu, "texels", &[(0, ShaderStages::COMPUTE, written)]);
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
