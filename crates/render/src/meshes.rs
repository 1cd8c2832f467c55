//! Meshes on the GPU: the picture is drawn slab by slab, from the eye, between layers of triangles peeled off one by
//! one.
//!
//! To find a layer, all triangles are rasterised: those not behind the previous layer are discarded, and the nearest of
//! the others wins the depth test. Then the compositor gathers the volume in between, and slab and layer are blended
//! behind the picture in front of them. If all meshes are opaque the first layer is the last. Otherwise a query counts
//! a layer's fragments, and an empty layer ends the picture: each layer costs one pass over the triangles and one wait.
//! Without waiting, a picture draws as many layers as recent answers suggest, and is drawn again if it lacked some.
//!
//! Triangles are sent when the meshes change, colours and opacities with every frame. Buffers and pipelines are created
//! at the start if pictures will have meshes, and recreated with the device.

use crate::adapter::DISPLAY_FORMAT;
use crate::buffer_parts::Part;
use crate::buffers::{self, SharedBuffers, buffer, entry};
use crate::layouts::{MeshLayouts, bind_group_layout, storage, texture, texture_of};
use crate::mapping::Mapping;
use crate::march::{attachment, color_pass, draw_over_all};
use crate::memory::{COLOR_FORMAT, COUNTS_BYTES, DEPTH_FORMAT, MOST_LAYERS, NUMBER_FORMAT, geometry_bytes, mesh_bytes};
use crate::pipelines::{Shape, pipeline};
use crate::{Gpu, GpuError};
use brickyard_shaders::{MeshLook, MeshVertex, Seen, Shown, bindings, peel, resolve};
use brickyard_volume::{FrameSettings, Geometry, Mesh, MeshCapacity, ShownMesh, ViewRays};
use glam::DVec3;
use std::ops::Range;
use std::sync::Arc;
use wgpu::{BindingResource, BufferUsages, Color, LoadOp, ShaderStages, TextureFormat, TextureUsages};

/// Vertices or triangles prepared for the GPU at once.
const CHUNK: usize = 1 << 16;
const COUNT_BYTES: u64 = 8;
/// Expected layers of the first picture drawn without waiting.
const FIRST_EXPECTED: u32 = 4;

/// Meshes on the GPU, and the pipelines that peel their layers.
#[derive(Debug)]
pub(crate) struct Meshes {
    vertices: wgpu::Buffer,
    corners: wgpu::Buffer,
    looks: wgpu::Buffer,
    bindings: wgpu::BindGroup,
    peel: wgpu::RenderPipeline,
    /// Shows the picture composed of all slabs ([`Peeled::all`]) as display colours.
    pub(crate) show: wgpu::RenderPipeline,
    before: wgpu::BindGroupLayout,
    pub(crate) layouts: MeshLayouts,
    gathered: wgpu::BindGroupLayout,
    /// A query for each counted layer, and their results.
    query: wgpu::QuerySet,
    counted: wgpu::Buffer,
    /// The read-back buffer for one count; taken while a caller waits for it.
    answer: Option<wgpu::Buffer>,
    /// Expected layers of a picture, including the empty last one.
    expected: u32,
    /// Whether the last picture lacked layers, as far as known, and its number while its answer is pending.
    is_short: bool,
    asked: Option<u64>,
    /// The view of `is_short`: its rays, and the meshes' opacities.
    view: Option<(ViewRays, Vec<f64>)>,
    room: MeshCapacity,
    /// The meshes' frame in the frames' buffer.
    pub(crate) frame: Part,
    /// Contents of the buffers, and the volume's geometry at that time.
    held: Vec<Held>,
    geometry: Option<Geometry>,
}

/// A mesh in the buffers.
#[derive(Debug)]
struct Held {
    mesh: Arc<Mesh>,
    /// The mesh's box in the world: its least and greatest corner.
    corners: [DVec3; 2],
    /// The range of the mesh's corners in the buffer.
    range: Range<u32>,
}

impl Meshes {
    /// Creates the buffers and pipelines for meshes within `room`. `frame` is their frame, in the scene's world.
    pub(crate) fn new(gpu: &Gpu, shared: &SharedBuffers, frame: Part, room: MeshCapacity) -> Result<Self, GpuError> {
        let fragment = ShaderStages::FRAGMENT;
        let depth = texture_of(wgpu::TextureSampleType::Depth);
        let both = ShaderStages::VERTEX_FRAGMENT;
        let of_meshes = [
            (bindings::FRAMES, both, storage()),
            (bindings::VERTICES, both, storage()),
            (bindings::CORNERS, both, storage()),
            (bindings::LOOKS, fragment, storage()),
        ];
        let own = bind_group_layout(gpu, "meshes", &of_meshes);
        let number = texture_of(wgpu::TextureSampleType::Uint);
        let flat = texture(wgpu::TextureViewDimension::D2, false);
        let of_peeling = [(bindings::NEAR_LAYER, depth), (bindings::NEAR_NUMBER, number), (bindings::FRONT, flat)];
        let of_peeling = of_peeling.map(|(binding, ty)| (binding, fragment, ty));
        let before = bind_group_layout(gpu, "before", &of_peeling);
        let of_marches = [(bindings::NEAR_LAYER, depth), (bindings::FAR_LAYER, depth), (bindings::FRONT, flat)];
        let of_marches = of_marches.map(|(binding, ty)| (binding, fragment | ShaderStages::COMPUTE, ty));
        let limits = bind_group_layout(gpu, "limits", &of_marches);
        let layer = bind_group_layout(gpu, "layer", &[(bindings::LAYER_COLOR, fragment, flat)]);
        let of_slabs = [(bindings::FRAMES, fragment, storage()), (bindings::GATHERED, fragment, flat)];
        let gathered = bind_group_layout(gpu, "slabs", &of_slabs);
        let [vertices_bytes, corners_bytes, looks_bytes] = geometry_bytes(room);
        let total = vertices_bytes + corners_bytes + looks_bytes;
        let [vertices, corners, looks] = gpu.allocate("the meshes", total, |device| {
            let make = |label, bytes| buffer(device, label, bytes, BufferUsages::STORAGE | BufferUsages::COPY_DST);
            [make("vertices", vertices_bytes), make("corners", corners_bytes), make("looks", looks_bytes)]
        })?;
        let entries = [
            entry(bindings::FRAMES, frame.of(&shared.frame)),
            entry(bindings::VERTICES, vertices.as_entire_binding()),
            entry(bindings::CORNERS, corners.as_entire_binding()),
            entry(bindings::LOOKS, looks.as_entire_binding()),
        ];
        let bindings = gpu.bind_group("meshes", &own, &entries);
        let descriptor =
            wgpu::QuerySetDescriptor { label: Some("layer"), ty: wgpu::QueryType::Occlusion, count: MOST_LAYERS };
        let query = gpu.device.create_query_set(&descriptor);
        let counted = buffer(&gpu.device, "count", COUNTS_BYTES, BufferUsages::QUERY_RESOLVE | BufferUsages::COPY_SRC);
        let usage = BufferUsages::MAP_READ | BufferUsages::COPY_DST;
        let answer = Some(buffer(&gpu.device, "answer", COUNT_BYTES, usage));
        let nearest = wgpu::DepthStencilState {
            format: DEPTH_FORMAT,
            depth_write_enabled: Some(true),
            depth_compare: Some(wgpu::CompareFunction::Less),
            stencil: Default::default(),
            bias: Default::default(),
        };
        let shape = Shape { depth_stencil: Some(nearest), ..Shape::default() };
        let targets = [COLOR_FORMAT.into(), NUMBER_FORMAT.into()];
        let peel = pipeline(gpu, &peel(), &[&own, &before], ["corner", "peel"], shape, &targets);
        let (source, entries) = (resolve(Seen::Slabs, Shown::Picture), ["fullscreen", "resolve"]);
        let show = pipeline(gpu, &source, &[&gathered], entries, Shape::default(), &[DISPLAY_FORMAT.into()]);
        Ok(Self {
            vertices,
            corners,
            looks,
            bindings,
            peel,
            show,
            before,
            layouts: MeshLayouts { limits, layer },
            gathered,
            query,
            counted,
            answer,
            expected: FIRST_EXPECTED,
            is_short: false,
            asked: None,
            view: None,
            room,
            frame,
            held: Vec::new(),
            geometry: None,
        })
    }

    /// Sends a frame's meshes to the GPU if they have changed, and their colours and opacities.
    ///
    /// # Errors
    /// If the meshes exceed their room.
    pub(crate) fn set(&mut self, gpu: &Gpu, frame: &FrameSettings) -> Result<(), GpuError> {
        let (asked, room) = (frame.needs().meshes, self.room);
        if !room.holds(&asked) {
            return Err(GpuError::Mismatch(format!("meshes of {asked:?}: this renderer was made for {room:?}")));
        }
        let is_same = self.held.len() == frame.meshes.len()
            && self.held.iter().zip(&frame.meshes).all(|(held, shown)| Arc::ptr_eq(&held.mesh, &shown.mesh));
        if !is_same || self.geometry.as_ref() != Some(&frame.geometry) {
            self.view = None;
            self.send(gpu, frame);
        }
        let looks: Vec<MeshLook> = frame.meshes.iter().map(look).collect();
        gpu.queue.write_buffer(&self.looks, 0, bytemuck::cast_slice(&looks));
        Ok(())
    }

    fn send(&mut self, gpu: &Gpu, frame: &FrameSettings) {
        self.held.clear();
        self.geometry = Some(frame.geometry.clone());
        let (mut vertices, mut triangles) = (0u32, 0u32);
        for ShownMesh { mesh, .. } in &frame.meshes {
            let chunks = (0..mesh.positions().len()).step_by(CHUNK);
            for first in chunks {
                let past = mesh.positions().len().min(first + CHUNK);
                let chunk: Vec<MeshVertex> = (first..past).map(|i| vertex(mesh, i, &frame.geometry)).collect();
                let offset = (vertices as u64 + first as u64) * size_of::<MeshVertex>() as u64;
                gpu.queue.write_buffer(&self.vertices, offset, bytemuck::cast_slice(&chunk));
            }
            for (i, chunk) in mesh.triangles().chunks(CHUNK).enumerate() {
                let moved: Vec<[u32; 3]> = chunk.iter().map(|corners| corners.map(|c| c + vertices)).collect();
                let offset = (triangles as u64 + (i * CHUNK) as u64) * size_of::<[u32; 3]>() as u64;
                gpu.queue.write_buffer(&self.corners, offset, bytemuck::cast_slice(&moved));
            }
            let range = 3 * triangles..3 * (triangles + mesh.triangles().len() as u32);
            self.held.push(Held { mesh: mesh.clone(), corners: bounds(mesh), range });
            vertices += mesh.positions().len() as u32;
            triangles += mesh.triangles().len() as u32;
        }
    }

    /// Returns a distance from the eye beyond every mesh of the frame.
    pub(crate) fn far(&self, frame: &FrameSettings) -> f64 {
        let rays = &frame.rays;
        let corner = |held: &Held, i: usize| {
            DVec3::from_array(std::array::from_fn(|a| held.corners[i >> a & 1][a])).distance(rays.eye)
        };
        let distances = self.held.iter().flat_map(|held| (0..8).map(move |i| corner(held, i)));
        let aside = if rays.orthographic { rays.right.length() + rays.up.length() } else { 0.0 };
        // A thousandth more than rounding can add.
        (distances.fold(0.0, f64::max) + aside).max(f32::MIN_POSITIVE as f64) * 1.001
    }

    /// Peels the next layer of meshes behind those found so far. `number` counts layers from 0. Returns whether another
    /// may lie behind it: if `waits`, by waiting for this layer's count, else by the expected number of layers.
    ///
    /// # Errors
    /// If the device fails.
    pub(crate) fn peel(
        &mut self,
        gpu: &Gpu,
        frame: &FrameSettings,
        layers: &Peeled,
        number: u32,
        waits: bool,
    ) -> Result<bool, GpuError> {
        let is_counted = is_counted(frame);
        let query = if waits { 0 } else { number.min(MOST_LAYERS - 1) };
        let clear = LoadOp::Clear(Color::TRANSPARENT);
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        {
            let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
                label: Some("peel"),
                color_attachments: &[attachment(&layers.color, clear), attachment(&layers.numbers[layers.far], clear)],
                depth_stencil_attachment: Some(depth_attachment(&layers.depths[layers.far], 1.0)),
                occlusion_query_set: is_counted.then_some(&self.query),
                ..Default::default()
            });
            pass.set_pipeline(&self.peel);
            pass.set_bind_group(0, &self.bindings, &[]);
            pass.set_bind_group(1, &layers.before[layers.far], &[]);
            if is_counted {
                pass.begin_occlusion_query(query);
            }
            for (i, held) in self.held.iter().enumerate() {
                pass.draw(held.range.clone(), i as u32..i as u32 + 1);
            }
            if is_counted {
                pass.end_occlusion_query();
            }
        }
        let answer = self.answer.take_if(|_| is_counted && waits);
        if let Some(answer) = &answer {
            encoder.resolve_query_set(&self.query, 0..1, &self.counted, 0);
            encoder.copy_buffer_to_buffer(&self.counted, 0, answer, 0, COUNT_BYTES);
        }
        let submitted = gpu.queue.submit([encoder.finish()]);
        let Some(answer) = answer else {
            return Ok(is_counted && number + 1 < self.expected);
        };
        let answer = Mapping::begin(answer);
        gpu.wait(submitted)?;
        let (found, answer) = answer.read(gpu, |count| count.iter().any(|&byte| byte != 0))?;
        self.answer = Some(answer);
        Ok(found)
    }

    /// Queues the copy of the first `layers` counts to a buffer, from a byte on.
    pub(crate) fn take_counts(&self, encoder: &mut wgpu::CommandEncoder, layers: u32, to: &wgpu::Buffer, at: u64) {
        if layers > 0 {
            encoder.resolve_query_set(&self.query, 0..layers, &self.counted, 0);
            encoder.copy_buffer_to_buffer(&self.counted, 0, to, at, layers as u64 * COUNT_BYTES);
        }
    }

    /// Records that a picture was drawn with the expected number of layers. `picture` is its number if its counts will
    /// be answered. Results of earlier pictures of the same view stay valid unless they lacked layers.
    pub(crate) fn ask(&mut self, picture: Option<u64>, frame: &FrameSettings) {
        let view = Some((frame.rays, frame.meshes.iter().map(|shown| shown.opacity).collect()));
        if self.is_short || self.view != view {
            (self.asked, self.is_short, self.view) = (picture, picture.is_none(), view);
        }
    }

    /// Whether the last picture drawn without waiting lacked layers and must be drawn again. `None` while unknown.
    pub(crate) fn is_short(&self) -> Option<bool> {
        self.asked.is_none().then_some(self.is_short)
    }

    /// Updates the expected number of layers from a picture's counts.
    pub(crate) fn learn(&mut self, picture: u64, counts: &[u64]) {
        if self.asked.is_some_and(|asked| picture < asked) {
            return;
        }
        self.asked = None;
        let found = counts.iter().take_while(|&&count| count > 0).count() as u32;
        self.is_short = found == counts.len() as u32 && found < MOST_LAYERS;
        let expected = if self.is_short { 2 * found } else { found + 1 };
        self.expected = expected.clamp(1, MOST_LAYERS);
    }
}

/// Whether a frame has translucent meshes, so that there may be layers behind the first.
pub(crate) fn is_counted(frame: &FrameSettings) -> bool {
    frame.meshes.iter().any(|shown| shown.opacity < 1.0)
}

fn vertex(mesh: &Mesh, i: usize, geometry: &Geometry) -> MeshVertex {
    let world = DVec3::from_array(mesh.positions()[i].map(f64::from));
    let [r, g, b] = mesh.colors().get(i).copied().unwrap_or_default().map(u32::from);
    MeshVertex {
        place: (geometry.voxel_from_world(world) * geometry.spacing).as_vec3().to_array(),
        color: r | g << 8 | b << 16,
        normal: mesh.normals().get(i).copied().unwrap_or_default(),
        spare: 0.0,
    }
}

fn look(shown: &ShownMesh) -> MeshLook {
    let ShownMesh { mesh, color, opacity, lit } = shown;
    let flag = |is_set: bool, flag: u32| if is_set { flag } else { 0 };
    MeshLook {
        color: color.unwrap_or_default().map(|c| c as f32),
        opacity: *opacity as f32,
        flags: flag(color.is_some(), MeshLook::HAS_COLOR)
            | flag(!mesh.colors().is_empty(), MeshLook::HAS_COLORS)
            | flag(!mesh.normals().is_empty(), MeshLook::HAS_NORMALS)
            | flag(*lit, MeshLook::IS_LIT),
        spare: [0; 3],
    }
}

fn bounds(mesh: &Mesh) -> [DVec3; 2] {
    let all = mesh.positions().iter().map(|p| DVec3::from_array(p.map(f64::from)));
    all.fold([DVec3::INFINITY, DVec3::NEG_INFINITY], |[low, high], p| [low.min(p), high.max(p)])
}

fn depth_attachment(view: &wgpu::TextureView, clear: f32) -> wgpu::RenderPassDepthStencilAttachment<'_> {
    let depth_ops = Some(wgpu::Operations { load: LoadOp::Clear(clear), store: wgpu::StoreOp::Store });
    wgpu::RenderPassDepthStencilAttachment { view, depth_ops, stencil_ops: None }
}

/// The additional targets of pictures with meshes, of one size: two layers, and the picture in front of them.
#[derive(Debug)]
pub(crate) struct Peeled {
    size_px: (u32, u32),
    /// Distances of the layers before and behind the slab, in turns.
    depths: [wgpu::TextureView; 2],
    numbers: [wgpu::TextureView; 2],
    /// Index of the layer behind the slab.
    far: usize,
    /// The layer's colour, premultiplied.
    color: wgpu::TextureView,
    /// The picture in front of the slab, premultiplied.
    front: wgpu::TextureView,
    /// Bind groups for peeling and for marching, by the index of the layer behind.
    before: [wgpu::BindGroup; 2],
    limits: [wgpu::BindGroup; 2],
    layer: wgpu::BindGroup,
    pub(crate) all: wgpu::BindGroup,
}

impl Peeled {
    pub(crate) fn new(
        gpu: &Gpu,
        meshes: &Meshes,
        shared: &SharedBuffers,
        size_px: (u32, u32),
    ) -> Result<Self, GpuError> {
        let front_format = gpu.report.formats.composite;
        let pixels = size_px.0 as u64 * size_px.1 as u64;
        let size = wgpu::Extent3d { width: size_px.0, height: size_px.1, depth_or_array_layers: 1 };
        let usage = TextureUsages::RENDER_ATTACHMENT | TextureUsages::TEXTURE_BINDING;
        let target = |device: &wgpu::Device, format: TextureFormat| {
            buffers::texture(device, "layer", size, wgpu::TextureDimension::D2, format, usage)
                .create_view(&Default::default())
        };
        let all_bytes = mesh_bytes(MeshCapacity { triangles: 1, ..MeshCapacity::NONE }, pixels, front_format);
        let (depths, numbers, color, front) = gpu.allocate("the meshes' layers", all_bytes, |device| {
            let two = |format| [target(device, format), target(device, format)];
            (two(DEPTH_FORMAT), two(NUMBER_FORMAT), target(device, COLOR_FORMAT), target(device, front_format))
        })?;
        let view = |binding, view| entry(binding, BindingResource::TextureView(view));
        let group = |layout, entries: &[wgpu::BindGroupEntry<'_>]| gpu.bind_group("layer", layout, entries);
        let of = |far: usize| (&depths[1 - far], &depths[far], &numbers[1 - far]);
        let before = [0, 1].map(|far| {
            let (near, _, number) = of(far);
            let near = view(bindings::NEAR_LAYER, near);
            group(&meshes.before, &[near, view(bindings::NEAR_NUMBER, number), view(bindings::FRONT, &front)])
        });
        let limits = [0, 1].map(|i| {
            let (near, far, _) = of(i);
            let (near, far) = (view(bindings::NEAR_LAYER, near), view(bindings::FAR_LAYER, far));
            group(&meshes.layouts.limits, &[near, far, view(bindings::FRONT, &front)])
        });
        let layer = group(&meshes.layouts.layer, &[view(bindings::LAYER_COLOR, &color)]);
        let frame = entry(bindings::FRAMES, meshes.frame.of(&shared.frame));
        let all = group(&meshes.gathered, &[frame, view(bindings::GATHERED, &front)]);
        Ok(Self { size_px, depths, numbers, far: 0, color, front, before, limits, layer, all })
    }

    pub(crate) fn suit(&self, size_px: (u32, u32)) -> bool {
        self.size_px == size_px
    }

    /// Begins a picture: clears the picture in front, and the layer before.
    pub(crate) fn clear(&mut self, gpu: &Gpu) {
        self.far = 0;
        let clear = LoadOp::Clear(Color::TRANSPARENT);
        let descriptor = wgpu::RenderPassDescriptor {
            label: Some("no layer"),
            color_attachments: &[attachment(&self.front, clear), attachment(&self.numbers[1], clear)],
            depth_stencil_attachment: Some(depth_attachment(&self.depths[1], 0.0)),
            ..Default::default()
        };
        gpu.submit(|encoder| drop(encoder.begin_render_pass(&descriptor)));
    }

    /// Advances to the next slab: the layer behind the last one becomes the layer before it.
    pub(crate) fn turn(&mut self) {
        self.far = 1 - self.far;
    }

    pub(crate) fn limits(&self) -> &wgpu::BindGroup {
        &self.limits[self.far]
    }

    /// Blends the slab and the layer behind it behind the picture in front.
    pub(crate) fn compose(&self, gpu: &Gpu, pipeline: &wgpu::RenderPipeline, resolve: &wgpu::BindGroup) {
        gpu.submit(|encoder| {
            let mut pass = color_pass(encoder, "slab", &[attachment(&self.front, LoadOp::Load)], None);
            pass.set_bind_group(1, &self.layer, &[]);
            draw_over_all(&mut pass, pipeline, resolve);
        });
    }
}
