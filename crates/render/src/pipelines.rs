//! Pipelines: for each way to gather samples, the compositor's march and the pass that makes display colours of it. Made when
//! first used.

use crate::adapter::{Gpu, GpuFormats};
use crate::compositor::Compositor;
use crate::frame::Framed;
use brickyard_shaders::{
    Curve, Gather, JointVariant, Light, Medium, Seen, Shown, Stage, Surfaces, Variant, bindings, raycast,
    raycast_joint, resolve, sorted, sorted_joint,
};
use brickyard_volume::{Filter, FrameSettings, Gradient, Lighting, LightingModel, Mode, sampling};
use std::collections::HashMap;
use wgpu::{
    BindingType, BlendComponent, BlendFactor, BlendOperation, ShaderStages, TextureFormat, TextureViewDimension,
};

/// Format of the finished picture. Colours are display-referred as they are: no sRGB conversion.
pub(crate) const DISPLAY_FORMAT: TextureFormat = TextureFormat::Rgba8Unorm;

/// How a frame gathers.
pub(crate) fn gather_of(frame: &FrameSettings) -> Gather {
    match frame.mode {
        Mode::Mip | Mode::MinIp => Gather::Project,
        Mode::Average => Gather::Average,
        Mode::Isosurface if frame.is_one_opaque_surface() => Gather::Isosurface,
        Mode::Dvr | Mode::Isosurface => Gather::Composite,
    }
}

/// How a composite's segments become media, where there are surfaces, and classes by value and gradient, or not.
pub(crate) fn medium_of(frame: &FrameSettings, has_surfaces: bool, has_grid: bool) -> Medium {
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
        _ if has_surfaces => Surfaces::InFog,
        _ => Surfaces::None,
    };
    // Where a gradient is asked for by nothing there is no variant of its own for each.
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
fn light_of(lighting: &Lighting) -> Light {
    match lighting.model {
        LightingModel::None => Light::Unlit,
        LightingModel::Phong => Light::Phong,
        LightingModel::BlinnPhong => Light::BlinnPhong,
        LightingModel::Tone => Light::Tone,
    }
}

/// How gradients are found; the same where none is asked for.
fn gradient_of(lighting: &Lighting, is_lit: bool) -> brickyard_shaders::Gradient {
    match lighting.gradient {
        Gradient::Sobel if is_lit => brickyard_shaders::Gradient::Sobel,
        Gradient::Stored if is_lit => brickyard_shaders::Gradient::Stored,
        _ => brickyard_shaders::Gradient::Central,
    }
}

/// The march that one layer needs by itself.
pub(crate) fn variant_of(framed: &Framed<'_>) -> Variant {
    let frame = framed.settings;
    let gather = gather_of(frame);
    let medium = match gather {
        Gather::Composite => medium_of(frame, !frame.surfaces.is_empty(), frame.grid().is_some()),
        Gather::Project | Gather::Average | Gather::Isosurface => Medium::PLAIN,
    };
    let is_cubic = frame.sampling.filter == Filter::Tricubic;
    let has_meshes = !frame.meshes.is_empty();
    let (has_invalid, is_placed) = (frame.encoding.has_invalid, !frame.placement.is_identity());
    Variant { gather, has_invalid, is_cubic, medium, has_meshes, is_placed }
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
    /// Of a march through one layer.
    pub(crate) march: wgpu::BindGroupLayout,
    /// Of a march through all of them.
    pub(crate) joint: wgpu::BindGroupLayout,
    pub(crate) resolve: wgpu::BindGroupLayout,
    pub(crate) joined: wgpu::BindGroupLayout,
}

/// The bind group layouts that marches and slabs need besides their own.
pub(crate) struct MeshLayouts<'a> {
    pub(crate) limits: &'a wgpu::BindGroupLayout,
    pub(crate) layer: &'a wgpu::BindGroupLayout,
}

/// What gathers: one layer's samples, or those of all.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub(crate) enum Shader {
    Single(Variant),
    Joint(JointVariant),
}

/// All pipelines made so far.
#[derive(Debug, Default)]
pub(crate) struct Pipelines {
    marches: HashMap<Shader, MarchPipeline>,
    resolves: HashMap<(Seen, Shown), wgpu::RenderPipeline>,
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
    /// Those of layers in so many pools, with stored gradients or without.
    pub(crate) fn new(gpu: &Gpu, compositor: Compositor, pools: usize, has_gradients: bool) -> Self {
        let fragment = ShaderStages::FRAGMENT;
        let gathered = (bindings::GATHERED, fragment, texture(TextureViewDimension::D2, false));
        let frames = (bindings::FRAMES, fragment, storage());
        let glow = (bindings::GLOW, fragment, texture(TextureViewDimension::D2, false));
        let resolve = [frames, (bindings::TABLE, fragment, storage()), gathered];
        Self {
            march: march_layout(gpu, compositor, 1, has_gradients),
            joint: march_layout(gpu, compositor, pools, has_gradients),
            resolve: bind_group_layout(gpu, "resolve", &resolve),
            joined: bind_group_layout(gpu, "joined", &[frames, gathered, glow]),
        }
    }
}

fn march_layout(gpu: &Gpu, compositor: Compositor, pools: usize, has_gradients: bool) -> wgpu::BindGroupLayout {
    let stage = match compositor {
        Compositor::Sorted | Compositor::Raycast => ShaderStages::FRAGMENT,
        Compositor::Compute => ShaderStages::COMPUTE,
    };
    let mut march = vec![
        (bindings::FRAMES, ShaderStages::VERTEX | stage, storage()),
        (bindings::ATLAS_SAMPLER, stage, BindingType::Sampler(wgpu::SamplerBindingType::Filtering)),
        (bindings::TABLE, stage, storage()),
    ];
    let gradients = (bindings::FIRST_GRADIENTS..).take(if has_gradients { pools } else { 0 });
    let textures = (bindings::FIRST_ATLAS..).take(pools).chain(gradients);
    march.extend(textures.map(|binding| (binding, stage, texture(TextureViewDimension::D3, true))));
    match compositor {
        Compositor::Sorted => march
            .extend([(bindings::CELLS, ShaderStages::VERTEX, storage()), (bindings::CELL_BRICKS, stage, storage())]),
        Compositor::Raycast | Compositor::Compute => {
            let read = [bindings::BRICKS, bindings::NODES, bindings::RANGES, bindings::OPAQUE_BEFORE];
            march.extend(read.map(|binding| (binding, stage, storage())));
            let written = buffer(wgpu::BufferBindingType::Storage { read_only: false });
            march.extend(gpu.report.feedback.then_some((bindings::MARKS, stage, written)));
        }
    }
    bind_group_layout(gpu, "march", &march)
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

/// The sum of what is there and what comes.
const SUM: wgpu::BlendState = {
    let component =
        BlendComponent { src_factor: BlendFactor::One, dst_factor: BlendFactor::One, operation: BlendOperation::Add };
    wgpu::BlendState { color: component, alpha: component }
};

fn write(format: TextureFormat, blend: Option<wgpu::BlendState>) -> wgpu::ColorTargetState {
    wgpu::ColorTargetState { format, blend, write_mask: wgpu::ColorWrites::ALL }
}

impl Pipelines {
    /// Makes a march, if it is not there. With `meshes`, for frames that have some.
    pub(crate) fn need_march(
        &mut self,
        gpu: &Gpu,
        layouts: &Layouts,
        meshes: Option<&MeshLayouts<'_>>,
        compositor: Compositor,
        shader: &Shader,
    ) {
        if !self.marches.contains_key(shader) {
            let limits = meshes.map(|meshes| meshes.limits);
            self.marches.insert(shader.clone(), MarchPipeline::new(gpu, layouts, limits, compositor, shader));
        }
    }

    /// Makes a resolving pass, if it is not there.
    pub(crate) fn need_resolve(
        &mut self,
        gpu: &Gpu,
        layouts: &Layouts,
        meshes: Option<&MeshLayouts<'_>>,
        (seen, shown): (Seen, Shown),
    ) {
        self.resolves.entry((seen, shown)).or_insert_with(|| {
            let own = if seen == Seen::Joined { &layouts.joined } else { &layouts.resolve };
            let slab = meshes.filter(|_| shown == Shown::Slab).map(|meshes| meshes.layer);
            let layouts: Vec<_> = [Some(own), slab].into_iter().flatten().collect();
            let composite = gpu.report.formats.composite;
            let targets = match shown {
                Shown::Picture => vec![DISPLAY_FORMAT.into()],
                Shown::Slab => vec![write(composite, Some(BEHIND))],
                Shown::Sums => vec![write(composite, Some(SUM)); 2],
            };
            let entries = ["fullscreen", "resolve"];
            pipeline(gpu, &resolve(seen, shown), &layouts, entries, Shape::default(), &targets)
        });
    }

    /// A march that was made.
    pub(crate) fn march(&self, shader: &Shader) -> Option<&MarchPipeline> {
        self.marches.get(shader)
    }

    /// A resolving pass that was made.
    pub(crate) fn resolve(&self, seen: Seen, shown: Shown) -> Option<&wgpu::RenderPipeline> {
        self.resolves.get(&(seen, shown))
    }
}

impl MarchPipeline {
    fn new(
        gpu: &Gpu,
        layouts: &Layouts,
        limits: Option<&wgpu::BindGroupLayout>,
        compositor: Compositor,
        shader: &Shader,
    ) -> Self {
        let (gather, own) = match shader {
            Shader::Single(variant) => (variant.gather, &layouts.march),
            Shader::Joint(_) => (Gather::Composite, &layouts.joint),
        };
        let format = gather_format(gather, compositor, &gpu.report.formats);
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
                Self::Fragment(pipeline(gpu, &source, &bindings, entries, boxes, &[target]))
            }
            Compositor::Compute => {
                let source = cast(Stage::Compute(texel_format(format)));
                Self::Compute(compute_pipeline(gpu, &source, own, limits, format))
            }
            Compositor::Raycast => {
                let entries = ["fullscreen", "raycast"];
                let source = cast(Stage::Fragment);
                Self::Fragment(pipeline(gpu, &source, &bindings, entries, Shape::default(), &[format.into()]))
            }
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
