//! The Rust twins of the WGSL structs. A test compares names, offsets and sizes with what naga reflects.

use bytemuck::{Pod, Zeroable};

/// What is the same for all of a frame; `Frame` in WGSL. Directions and positions are in voxel space: one world
/// unit along a direction is `1 / spacing` voxels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct FrameUniform {
    /// The eye, voxel space.
    pub eye: [f32; 3],
    /// Finest lattice step, world units.
    pub step: f32,
    /// View direction, voxels per world unit.
    pub forward: [f32; 3],
    /// How far f32 rounding can move a point, voxels.
    pub slack: f32,
    /// From the picture's centre to its right edge (at world distance 1 in perspective), voxels.
    pub right: [f32; 3],
    /// World length of `right`.
    pub half_width: f32,
    /// From the picture's centre to its top edge, likewise.
    pub up: [f32; 3],
    /// World length of `up`.
    pub half_height: f32,
    /// Clip x of a voxel-space offset from the eye.
    pub clip_x: [f32; 3],
    /// Clip distance before the eye, world units; far below half a step.
    pub near: f32,
    /// Clip y of such an offset.
    pub clip_y: [f32; 3],
    /// An eighth of a pixel in world units: at distance 1 in perspective.
    pub pixel_share: f32,
    /// World distance along the view direction of such an offset.
    pub clip_w: [f32; 3],
    /// One over the table's unit distance, per world unit.
    pub per_unit_distance: f32,
    /// Level-0 voxels of the volume.
    pub extent: [f32; 3],
    /// The greatest code.
    pub last_code: f32,
    /// World units per voxel.
    pub spacing: [f32; 3],
    /// 1 if rays are parallel.
    pub orthographic: u32,
    /// One over the atlas's size in texels.
    pub texel: [f32; 3],
    /// 1 for minimum intensity, else 0.
    pub invert: f32,
    /// Colour behind the volume.
    pub background: [f32; 3],
    /// Nodes between the octree's root and a leaf, at most; the root counts.
    pub tree_depth: u32,
    /// Picture width and height, pixels.
    pub size_px: [f32; 2],
    /// Index of the transfer table's last place.
    pub last_place: f32,
    /// Depth over a code, in which running integrals of the transfer function are counted.
    pub sum_unit: f32,
    /// Level-0 voxels along the octree's root; at least the extent.
    pub root_size: [f32; 3],
    /// Macro-cells along a brick's edge.
    pub macro_cells: u32,
    /// Low corner of what is shown, level-0 voxels.
    pub shown_low: [f32; 3],
    /// Texels along a slot's edge.
    pub slot_edge: f32,
    /// High corner of what is shown.
    pub shown_high: [f32; 3],
    /// How many lights there are; with none, one is at the eye.
    pub lights: u32,
    /// Colour of the surface, if the mode has one.
    pub surface_color: [f32; 3],
    /// Normalised code from which on a place is inside of it.
    pub threshold: f32,
    /// How far rays lean to the right, in units of `right`: 0 in orthographic views, where `forward` leans.
    pub shift: f32,
    /// Clip planes in use.
    pub plane_count: u32,
    /// 0 without jitter, 1 for a number of each pixel's own, 2 for the mask.
    pub jitter: u32,
    /// The numbers' seed, or where in the table's buffer the mask begins, in entries.
    pub jitter_seed: u32,
    /// No ray meets a mesh farther away: what depths are shares of.
    pub mesh_far: f32,
    /// Nodes of stored gradients along a slot's edge; 0 if there are none.
    pub gradient_edge: f32,
    /// Where in a slot, in texels, the first of them lies.
    pub first_gradient: f32,
    /// Where in the table's buffer the entries over values and gradients begin, if there are any.
    pub grid_at: u32,
    /// The first of the picture's rows that a dispatch draws.
    pub first_row: u32,
    /// Adaptive sampling: the largest difference between a part's two end values, as a fraction of the code range, before the part is split.
    pub adaptive_step: f32,
    /// In projections, 1 for what adds and 0 for what mixes.
    pub adds: f32,
    /// A projection's opacity.
    pub opacity: f32,
    /// How many voxels along each axis a world unit reaches at most.
    pub reach: [f32; 3],
    /// The depth of a medium of that opacity, finite.
    pub flat_depth: f32,
    /// Of entries over values and gradients the first row's code, rows from one code to the next, columns from one gradient to the
    /// next where that is the differences of normalised codes across two voxels by a voxel's size in the world, and the last row.
    pub grid: [f32; 4],
    /// The normalised code from which on a place is past each surface, ascending; more than any code where there is no surface.
    pub thresholds: [[f32; 4]; 2],
    /// Each surface's colour and opacity.
    pub surfaces: [[f32; 4]; 8],
    /// Where the lights are from the volume's corner, in the scene's world.
    pub light_places: [[f32; 4]; 4],
    /// What a voxel along each axis is in the scene's world.
    pub axes: [[f32; 4]; 3],
    /// What a gradient of 1 to a voxel along each axis is there; all three in some unit.
    pub slopes: [[f32; 4]; 3],
    /// First tick of each zone.
    pub zone_starts: [u32; 16],
    /// Clip planes: how much higher above the plane a voxel along each axis is, and the eye's height, world units.
    pub planes: [[f32; 4]; 14],
    /// The word of the octree's root and the first brick of the layer's draw list, in the buffers of all lists.
    pub list_at: [u32; 4],
    /// Padding: frames begin at multiples of 256 bytes, which any device can bind.
    pub spare: [[f32; 4]; 4],
}

/// A vertex of a mesh; `MeshVertex` in WGSL.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct MeshVertex {
    /// Voxels from the volume's corner times the spacing.
    pub place: [f32; 3],
    /// Red, green and blue in 8 bits each, from the lowest.
    pub color: u32,
    /// The normal in the world, of any length.
    pub normal: [f32; 3],
    /// Padding.
    pub spare: f32,
}

/// How a mesh looks; `MeshLook` in WGSL.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct MeshLook {
    /// Its colour, if it is not its vertices'.
    pub color: [f32; 3],
    /// Its opacity.
    pub opacity: f32,
    /// Which of the following there are.
    pub flags: u32,
    /// Padding.
    pub spare: [u32; 3],
}

impl MeshLook {
    /// A colour of its own.
    pub const HAS_COLOR: u32 = 1;
    /// Colours of the vertices.
    pub const HAS_COLORS: u32 = 2;
    /// Normals of the vertices.
    pub const HAS_NORMALS: u32 = 4;
    /// Light.
    pub const IS_LIT: u32 = 8;
}

/// A cell of the draw list, as a box to draw; `Cell` in WGSL.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct CellInstance {
    /// Low corner of the cell's half-open box, level-0 voxels.
    pub region_min: [f32; 3],
    /// The least threshold of the pixels that it draws.
    pub pixels_from: u32,
    /// High corner, exclusive.
    pub region_max: [f32; 3],
    /// The first threshold that is too great.
    pub pixels_to: u32,
}

/// The brick that stands for a layer in a cell; `CellBrick` in WGSL.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct CellBrick {
    /// Atlas texels per level-0 voxel: one over the brick's level's factor.
    pub texel_scale: [f32; 3],
    /// 1 if there is one, else 0.
    pub is_there: u32,
    /// Atlas texel of voxel-space zero.
    pub texel_offset: [f32; 3],
    /// Padding.
    pub spare: f32,
}

/// One entry of the draw list, as a leaf of the octree or what it gives way to; `RayBrick` in WGSL.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct RayBrick {
    /// Atlas texels per level-0 voxel: one over the brick's level's factor.
    pub texel_scale: [f32; 3],
    /// The brick's first macro-cell in the buffer of ranges; [`NO_RANGES`] where all of them are seen.
    pub first_range: u32,
    /// Atlas texel of voxel-space zero.
    pub texel_offset: [f32; 3],
    /// Least (low half) and greatest code of the whole brick.
    pub range: u32,
    /// Low corner of the brick's core, level-0 voxels.
    pub low: [f32; 3],
    /// The first threshold of the pixels in which the brick that follows is drawn instead.
    pub pixels_to: u32,
}

/// [`RayBrick::first_range`] of a brick that needs no look at its macro-cells.
pub const NO_RANGES: u32 = u32::MAX;

/// Bit of an octree node that is a leaf: 0 besides where nothing is drawn, else one more than the brick's position.
pub const LEAF: u32 = 1 << 31;

/// Bit of an octree node that halves x; those of y and z follow. Below them is the position of its children's group of eight.
pub const HALVES_X: u32 = 1 << 28;
