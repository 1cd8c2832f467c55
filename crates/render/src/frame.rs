//! Frame settings and draw cells in shader form. All f64 work is done here, once per frame or cell.

use crate::atlas::{Atlas, AtlasPlan, texel_placement};
use crate::leaf_octree::{root_size, splits};
use crate::transfer_table::last_place;
use brickyard_pager::{DrawCell, Layer, PixelShare};
use brickyard_shaders::{CellBrick, CellInstance, FrameUniform};
use brickyard_volume::lighting::MAX_LIGHTS;
use brickyard_volume::macrocells::per_axis;
use brickyard_volume::surface::MAX_SURFACES;
use brickyard_volume::{
    Blend, Clip, ClipPlane, Extreme, Filter, FrameSettings, Gradient, Jitter, Level, LightingModel, MAX_PLANES,
    Pyramid, VoxelBox,
};
use glam::{DMat3, DVec2, DVec3};

/// A frame's transfer table in the buffer.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct TableInUse {
    /// The value of 1 in the low word of a running integral.
    pub(crate) sum_unit: f32,
    /// Number of opacity counts from one code to the next.
    pub(crate) counts_per_code: u32,
    /// Start of the jitter mask, in places of 8 bytes.
    pub(crate) mask_at: u32,
    /// Start of the entries over values and gradients, in places of 8 bytes.
    pub(crate) grid_at: u32,
}

/// A layer in a frame.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Framed<'a> {
    /// Index among the renderer's layers.
    pub(crate) number: usize,
    pub(crate) settings: &'a FrameSettings,
    pub(crate) pyramid: &'a Pyramid,
    pub(crate) blend: Blend,
    /// The layer's opacity in projections.
    pub(crate) opacity: f64,
    /// Number of the draw list's cut; layers with the same number share a cut.
    pub(crate) cut: u32,
    /// Whether draw lists may have bricks of coarse levels.
    pub(crate) has_coarse: bool,
}

impl<'a> Framed<'a> {
    pub(crate) fn of(layer: &Layer<'a>) -> Self {
        let Layer { volume: number, frame, pyramid, draw, cut, .. } = *layer;
        let has_coarse = draw.cells.iter().any(|cell| cell.brick.level > Level(0));
        Self { number, settings: &frame.settings, pyramid, blend: frame.blend, opacity: frame.opacity, cut, has_coarse }
    }

    /// Whether both layers have the same cells in the same order.
    pub(crate) fn shares_cells_with(&self, other: &Self) -> bool {
        let place = |framed: &Self| (framed.cut, framed.settings.placement);
        place(self) == place(other)
            && self.settings.geometry == other.settings.geometry
            && self.pyramid == other.pyramid
    }

    /// Upper bound of a ray's texture reads: samples, by the edges of the layer's box, times reads per sample.
    pub(crate) fn most_reads(&self) -> f64 {
        self.most_samples() * self.reads_per_sample()
    }

    fn reads_per_sample(&self) -> f64 {
        let settings = self.settings;
        let by_value = match settings.sampling.filter {
            Filter::Nearest | Filter::Trilinear => 1.0,
            Filter::Tricubic => 8.0,
        };
        let by_voxel = if settings.encoding.has_whole_table() { 1.0 } else { 8.0 };
        let of_gradient = match settings.lighting.gradient {
            _ if !self.is_lit() && settings.grid().is_none() => 0.0,
            Gradient::Central => 6.0,
            Gradient::Sobel => 26.0,
            Gradient::Stored => 1.0,
        };
        by_value * by_voxel * (1.0 + of_gradient)
    }

    fn most_samples(&self) -> f64 {
        let FrameSettings { geometry, placement, lattice, .. } = self.settings;
        let (low, high) = self.settings.shown_box(self.pyramid.levels()[0].extent);
        let edges = DMat3::from_diagonal((high - low).max(DVec3::ZERO) * geometry.spacing);
        let length = |edge: DVec3| placement.world_vector(edge).length();
        (length(edges.x_axis) + length(edges.y_axis) + length(edges.z_axis)) / lattice.step
    }

    /// Whether colours are lit; never those of additive layers.
    pub(crate) fn is_lit(&self) -> bool {
        self.blend != Blend::Add && self.settings.lighting.model != LightingModel::None
    }
}

/// Builds a layer's frame uniform, for bricks in `atlas` with aprons of `apron` voxels. `most_depth` limits the optical
/// depth of a projection's opacity.
pub(crate) fn frame_uniform(
    framed: &Framed<'_>,
    atlas: &Atlas,
    apron: u32,
    table: TableInUse,
    most_depth: f64,
) -> FrameUniform {
    let Framed { settings: frame, pyramid, blend, opacity, .. } = *framed;
    let rays = &frame.rays;
    let spacing = frame.geometry.spacing;
    let extent = DVec3::from_array(pyramid.levels()[0].extent.to_array().map(f64::from));
    // The map from the world to voxels is affine: it maps a step along a ray the same way everywhere.
    let own_eye = frame.placement.volume_from_world(rays.eye);
    let eye = frame.geometry.voxel_from_world(own_eye);
    let voxels = |vector: DVec3| frame.placement.volume_vector(vector) / spacing;
    let (shown_low, shown_high) = frame.shown_box(pyramid.levels()[0].extent);
    let single = |v: DVec3| v.as_vec3().to_array();
    // For parallel rays; in perspective, the shader adds the lean to each of its different rays.
    let (forward, lean) = if rays.orthographic { (rays.middle(), DVec2::ZERO) } else { (rays.forward, rays.lean) };
    let (thresholds, surfaces) = surfaces(frame);
    let axes = [DVec3::X, DVec3::Y, DVec3::Z];
    let slopes = axes.map(|axis| frame.placement.world_gradient(axis / spacing));
    let world = |offset: DVec3| frame.placement.volume_normal(offset) * spacing;
    let steepest = slopes.iter().map(|slope| slope.length()).fold(0.0, f64::max);
    // Including fractional codes.
    let code_of = |value: f64| (frame.encoding.code(value) + frame.encoding.first_code()) as f32;
    let (jitter, jitter_seed) = match frame.sampling.jitter {
        Jitter::None => (0, 0),
        Jitter::White(seed) => (1, seed),
        Jitter::Blue => (2, table.mask_at),
    };
    FrameUniform {
        eye: single(eye),
        step: frame.lattice.step as f32,
        forward: single(voxels(forward)),
        slack: frame.geometry.rounding_voxels(own_eye, pyramid.levels()[0].extent) as f32,
        right: single(voxels(rays.right)),
        half_width: rays.right.length() as f32,
        up: single(voxels(rays.up)),
        half_height: rays.up.length() as f32,
        clip_x: single(world(rays.right / rays.right.length_squared() - rays.forward * rays.lean.x)),
        near: (1e-3 * frame.lattice.step) as f32,
        clip_y: single(world(rays.up / rays.up.length_squared() - rays.forward * rays.lean.y)),
        pixel_share: (rays.pixel_size(1.0) / 8.0) as f32,
        clip_w: single(world(rays.forward)),
        per_unit_distance: 1.0 / frame.table.unit_distance,
        extent: single(extent),
        last_code: frame.encoding.span_codes() as f32,
        spacing: single(spacing),
        orthographic: rays.orthographic as u32,
        texel: atlas.plan.size().map(|n| (1.0 / n as f64) as f32),
        // Shaders then flip values within their range: the least becomes the greatest.
        invert: f32::from(frame.mode.extreme() == Some(Extreme::Least)),
        background: frame.background,
        tree_depth: splits(pyramid).len() as u32,
        size_px: [rays.width as f32, rays.height as f32],
        last_place: last_place(&frame.table, frame.encoding.format) as f32,
        sum_unit: table.sum_unit,
        root_size: root_size(pyramid).map(|n| n as f32),
        macro_cells: per_axis(pyramid.edge() as usize) as u32,
        shown_low: single(shown_low),
        slot_edge: atlas.plan.slot_edge as f32,
        shown_high: single(shown_high),
        lights: frame.lighting.lights.len() as u32,
        surface_color: [0, 1, 2].map(|channel| surfaces[0][channel]),
        threshold: thresholds[0][0],
        lean: lean.as_vec2().to_array(),
        jitter,
        jitter_seed,
        thresholds,
        surfaces,
        gradient_edge: atlas.nodes.along() as f32,
        first_gradient: apron as f32 + atlas.nodes.first(),
        grid_at: table.grid_at,
        adaptive_step: frame.table.adaptive_step() as f32,
        adds: f32::from(blend == Blend::Add),
        opacity: opacity as f32,
        reach: slopes.map(|slope| slope.length() as f32),
        flat_depth: (-(1.0 - opacity).log2()).min(most_depth) as f32,
        grid: grid(frame),
        light_places: light_places(frame),
        axes: axes.map(|axis| frame.placement.world_vector(axis * spacing).extend(0.0).as_vec4().to_array()),
        slopes: slopes.map(|slope| (slope / steepest).extend(steepest * frame.lattice.step).as_vec4().to_array()),
        zone_starts: frame.lattice.zone_starts,
        planes: planes(frame),
        flat: (frame.encoding.flat_codes() / frame.encoding.span_codes()) as f32,
        first_slot: frame.encoding.first_slot(),
        per_slot: (frame.encoding.codes_per_slot() / frame.encoding.span_codes()) as f32,
        farthest_slots: frame.encoding.farthest_slots(),
        gradient_scale: (frame.encoding.gradient_scale() / frame.encoding.span_codes()) as f32,
        plane_count: clip_planes(frame).len() as u32,
        jitter_phase: frame.lattice.phase.into(),
        slot_codes: frame.encoding.format.max_code() as f32,
        first_code: frame.encoding.first_code() as f32,
        last_entry: frame.table.last_entry() as f32,
        counts_per_code: table.counts_per_code,
        caps: frame.caps as u32,
        threshold_code: frame.surfaces.first().map_or(1e30, |first| code_of(first.threshold)),
        // Set by the meshes, by marches and by their layers.
        ..FrameUniform::default()
    }
}

/// Each surface's threshold as a place in the table, and its colour and opacity.
fn surfaces(frame: &FrameSettings) -> ([[f32; 4]; 2], [[f32; 4]; MAX_SURFACES]) {
    // Unused thresholds lie beyond every code.
    let (mut thresholds, mut looks) = ([[1e30; 4]; 2], [[0.0; 4]; MAX_SURFACES]);
    for (i, surface) in frame.surfaces.iter().enumerate().take(MAX_SURFACES) {
        let [r, g, b] = surface.color;
        thresholds[i / 4][i % 4] = frame.encoding.place(surface.threshold) as f32;
        looks[i] = [r, g, b, surface.opacity];
    }
    (thresholds, looks)
}

/// Maps values and gradients to the table over both.
fn grid(frame: &FrameSettings) -> [f32; 4] {
    let Some(grid) = frame.grid() else { return [0.0; 4] };
    // Differences span two voxels; 1 is the whole table.
    let gradient = 0.5 * frame.encoding.code_width() * frame.encoding.span_codes();
    let columns = (grid.columns_per_gradient as f64 * gradient) as f32;
    [grid.first_code, grid.rows_per_code, columns, (grid.rows() - 1) as f32]
}

/// The lights' positions relative to the volume's corner, in the scene's world.
fn light_places(frame: &FrameSettings) -> [[f32; 4]; MAX_LIGHTS] {
    let mut places = [[0.0; 4]; MAX_LIGHTS];
    for (place, &light) in places.iter_mut().zip(&frame.lighting.lights) {
        let voxel = frame.geometry.voxel_from_world(frame.placement.volume_from_world(light));
        let from_corner = frame.placement.world_vector(voxel * frame.geometry.spacing);
        *place = from_corner.extend(0.0).as_vec4().to_array();
    }
    places
}

fn clip_planes(frame: &FrameSettings) -> &[ClipPlane] {
    frame.clip.as_ref().map_or(&[], Clip::planes)
}

/// The clip planes relative to the eye: f64 takes the differences of large numbers here.
fn planes(frame: &FrameSettings) -> [[f32; 4]; MAX_PLANES] {
    let mut planes = [[0.0; 4]; MAX_PLANES];
    for (plane, ClipPlane { normal, point }) in planes.iter_mut().zip(clip_planes(frame)) {
        let height = normal.dot(frame.placement.volume_from_world(frame.rays.eye) - point);
        *plane = (normal * frame.geometry.spacing).extend(height).as_vec4().to_array();
    }
    planes
}

pub(crate) fn cell_instance(region: &VoxelBox, pixels: PixelShare) -> CellInstance {
    CellInstance {
        region_min: region.min.to_array().map(|v| v as f32),
        pixels_from: pixels.from as u32,
        region_max: region.max.to_array().map(|v| v as f32),
        pixels_to: pixels.to as u32,
    }
}

pub(crate) fn cell_brick(cell: &DrawCell, pyramid: &Pyramid, atlas: &AtlasPlan, apron: u32) -> CellBrick {
    let (texel_scale, texel_offset) = texel_placement(cell, pyramid, atlas, apron);
    CellBrick { texel_scale, is_there: 1, texel_offset, ..CellBrick::default() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use brickyard_pager::Slot;
    use brickyard_volume::{BrickId, BrickIndex, Extent, Level};

    #[test]
    fn a_voxel_centre_meets_its_texel_centre() {
        let pyramid = Pyramid::new(Extent::new(300, 200, 100), [1.0; 3], 32);
        let atlas = AtlasPlan::new(34, 34 * 34 * 34 * 2, 40 * 34 * 34 * 34 * 2, 256, u32::MAX).unwrap();
        let id = |level, x, y, z| BrickId { time: 0, channel: 0, level: Level(level), index: BrickIndex::new(x, y, z) };
        let brick = id(1, 4, 2, 1);
        let region = VoxelBox::new([256, 128, 64], [300, 192, 100]);
        let cell = DrawCell { cell: brick, region, pixels: PixelShare::ALL, brick, slot: Slot(17), rank: 0 };
        let instance = cell_brick(&cell, &pyramid, &atlas, 1);
        // Voxel (5, 0, 31) of the brick, level 1: its centre in level-0 voxels.
        let voxel = [4 * 32 + 5, 2 * 32, 32 + 31].map(|v| (v as f32 + 0.5) * 2.0);
        let origin = atlas.origin(Slot(17));
        for (a, inner) in [5, 0, 31].into_iter().enumerate() {
            let texel = voxel[a] * instance.texel_scale[a] + instance.texel_offset[a];
            assert_eq!(texel, (origin[a] + 1 + inner) as f32 + 0.5);
        }
    }
}
