//! Structs shared with shaders, each declared once for Rust and WGSL. A test compares names, offsets and sizes with naga's reflection.

use bytemuck::{Pod, Zeroable};

/// The WGSL of a field's type.
macro_rules! in_wgsl {
    (f32) => {
        "f32"
    };
    (u32) => {
        "u32"
    };
    ([f32; $n:literal]) => {
        concat!("vec", $n, "f")
    };
    // Only padding: a vector of three would be aligned like one of four.
    ([u32; 3]) => {
        "array<u32, 3>"
    };
    ([u32; 16]) => {
        "array<vec4u, 4>"
    };
    ([u32; $n:literal]) => {
        concat!("vec", $n, "u")
    };
    ([[f32; 4]; $n:literal]) => {
        concat!("array<vec4f, ", $n, ">")
    };
}

macro_rules! twins {
    ($($(#[$about:meta])* pub struct $name:ident as $wgsl:ident { $($(#[$doc:meta])* pub $field:ident: $type:tt,)* })*) => {
        $(
            $(#[$about])*
            #[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
            #[repr(C)]
            pub struct $name { $($(#[$doc])* pub $field: $type,)* }
        )*

        /// The structs in WGSL, each with its name there.
        pub(crate) const IN_WGSL: &[(&str, &str)] = &[$((
            stringify!($wgsl),
            concat!("struct ", stringify!($wgsl), " {\n", $("    ", stringify!($field), ": ", in_wgsl!($type), ",\n",)* "}\n"),
        )),*];
    };
}

twins! {
    /// Settings of a layer's frame, the same for all its pixels; `Frame` in WGSL. Positions are in voxel space (level-0 voxels from the volume's
    /// corner), and directions in voxels per world unit, unless a field states otherwise.
    pub struct FrameUniform as Frame {
        /// Position of the eye in voxel space.
        pub eye: [f32; 3],
        /// World length of the finest lattice step.
        pub step: f32,
        /// View direction in voxels per world unit; in orthographic views, the direction of all rays.
        pub forward: [f32; 3],
        /// The greatest shift of a point by 32-bit rounding, in voxels.
        pub slack: f32,
        /// Vector from the picture's centre to its right edge (at world distance 1 in perspective), in voxels.
        pub right: [f32; 3],
        /// World length from the picture's centre to its right edge (at world distance 1 in perspective).
        pub half_width: f32,
        /// Vector from the picture's centre to its top edge (at world distance 1 in perspective), in voxels.
        pub up: [f32; 3],
        /// World length from the picture's centre to its top edge (at world distance 1 in perspective).
        pub half_height: f32,
        /// Vector whose dot product with an offset from the eye, in voxels, is the point's x in clip space.
        pub clip_x: [f32; 3],
        /// World distance of the near clip plane from the eye; far below half a step.
        pub near: f32,
        /// Vector whose dot product with an offset from the eye, in voxels, is the point's y in clip space.
        pub clip_y: [f32; 3],
        /// World length of an eighth of a pixel (at distance 1 in perspective).
        pub pixel_share: f32,
        /// Vector whose dot product with an offset from the eye, in voxels, is the point's world distance along the view direction.
        pub clip_w: [f32; 3],
        /// One over the transfer table's unit distance in world units.
        pub per_unit_distance: f32,
        /// Extent of the volume in level-0 voxels.
        pub extent: [f32; 3],
        /// Codes from the transfer table's first entry to its last.
        pub last_code: f32,
        /// World units per level-0 voxel along each axis, in the volume's own world.
        pub spacing: [f32; 3],
        /// 1 if rays are parallel, else 0.
        pub orthographic: u32,
        /// One over the atlas's size in texels, along each axis.
        pub texel: [f32; 3],
        /// 1 for minimum intensity projection, else 0.
        pub invert: f32,
        /// Colour behind the volume, red, green and blue, 0 to 1.
        pub background: [f32; 3],
        /// The most nodes from the octree's root to a leaf, including the root but not the leaf.
        pub tree_depth: u32,
        /// Width and height of the picture in pixels.
        pub size_px: [f32; 2],
        /// Index of the last place of the transfer table, counted from its first.
        pub last_place: f32,
        /// The value of a one in the low word of a running integral of the transfer function, over entries.
        pub sum_unit: f32,
        /// Size of the octree's root in level-0 voxels; at least the extent.
        pub root_size: [f32; 3],
        /// Number of macro-cells along a brick's edge.
        pub macro_cells: u32,
        /// Low corner of the shown box, in level-0 voxels.
        pub shown_low: [f32; 3],
        /// Number of texels along a slot's edge.
        pub slot_edge: f32,
        /// High corner of the shown box, in level-0 voxels.
        pub shown_high: [f32; 3],
        /// Number of lights; 0 for a single light at the eye.
        pub lights: u32,
        /// Colour of the first isosurface, 0 to 1; black if there is none.
        pub surface_color: [f32; 3],
        /// The value (0 at the transfer table's first code, 1 at its last) from which on a place is inside the first isosurface; greater than all
        /// values if there is none.
        pub threshold: f32,
        /// Lean of rays to the right and up, in units of `right` and `up` per unit forward; 0 in orthographic views, where `forward` leans.
        pub lean: [f32; 2],
        /// Jitter of rays: 0 for none, 1 for a pseudo-random number per pixel, 2 for the blue-noise mask.
        pub jitter: u32,
        /// The seed of pseudo-random jitter, or the start of the jitter mask, in places (8 bytes) from the first of the layer's transfer table.
        pub jitter_seed: u32,
        /// A world distance from the eye beyond all meshes, whose depths are shares of it. 0 without meshes.
        pub mesh_far: f32,
        /// Number of nodes of stored gradients along a slot's edge; 0 if there are none.
        pub gradient_edge: f32,
        /// Position of a slot's first node of stored gradients along each axis, in texels from the slot's corner.
        pub first_gradient: f32,
        /// Start of the entries over values and gradients, if any, in places (8 bytes) from the first of the layer's transfer table.
        pub grid_at: u32,
        /// The first pixel of a compute shader's dispatch: its column in the low 16 bits, its row from the top in the high ones.
        pub first_px: u32,
        /// Adaptive sampling: the greatest difference between a part's two end values, as a share of the table, without splitting the part.
        pub adaptive_step: f32,
        /// 1 if the layer adds to others in projections, 0 if it mixes with them.
        pub adds: f32,
        /// Opacity of the layer in projections, 0 to 1.
        pub opacity: f32,
        /// The most voxels along each axis in a step of one world unit.
        pub reach: [f32; 3],
        /// The depth of a medium with the layer's opacity in projections, in halvings of the light; finite even for an opaque layer.
        pub flat_depth: f32,
        /// Index of entries over values and gradients: the code of the first row, counted from the table's first, the rows per code, the columns per
        /// unit of gradient, and the index of the last row. A gradient is a difference of values across two voxels, over the size of a voxel in the
        /// volume's own world. All four are 0 without such entries.
        pub grid: [f32; 4],
        /// For each isosurface, the value from which on a place is past it, ascending, as for `threshold`; greater than all values for missing
        /// surfaces.
        pub thresholds: [[f32; 4]; 2],
        /// Colour and opacity of each isosurface, in the order of the thresholds; 0 for missing surfaces.
        pub surfaces: [[f32; 4]; 8],
        /// Position of each light from the volume's corner, in the scene's world. The fourth number is 0.
        pub light_places: [[f32; 4]; 4],
        /// For each axis, the vector of one voxel in the scene's world. The fourth number is 0.
        pub axes: [[f32; 4]; 3],
        /// For each axis, the gradient in the scene's world of a field growing by 1 per voxel along it, over the length of the steepest of the
        /// three. The fourth number is that length times the step.
        pub slopes: [[f32; 4]; 3],
        /// The first tick of each zone of the lattice.
        pub zone_starts: [u32; 16],
        /// For each clip plane, the rise of height above it per voxel along each axis, and the eye's height above it; in world units.
        pub planes: [[f32; 4]; 14],
        /// Place of the layer's draw list in the buffers of all lists: the index of the octree's root among the nodes, and the index of the list's
        /// first brick.
        pub list_at: [u32; 2],
        /// Difference of values below which the field is flat.
        pub flat: f32,
        /// Padding.
        pub spare: f32,
        /// The slots' number, a code or a 32-bit float, for the table's first value.
        pub first_slot: f32,
        /// Share of the table between consecutive numbers in slots.
        pub per_slot: f32,
        /// The greatest difference from `first_slot` distinguished from greater ones.
        pub farthest_slots: f32,
        /// Factor from stored gradients to differences of values, which are 0 to 1 along the table.
        pub gradient_scale: f32,
        /// Number of clip planes in use.
        pub plane_count: u32,
        /// Shift of all rays' lattice towards the eye besides its jitter, in the steps of jitter.
        pub jitter_phase: u32,
        /// Codes of a texel of 1: the greatest code of slots that hold codes.
        pub slot_codes: f32,
        /// The code of the transfer table's first entry.
        pub first_code: f32,
        /// Index of the transfer table's last entry.
        pub last_entry: f32,
        /// Counts of opaque places ([`OPAQUE_BEFORE`](crate::bindings::OPAQUE_BEFORE)) per code.
        pub counts_per_code: u32,
        /// 1 if isosurfaces opened by a clip are capped, else 0.
        pub caps: u32,
        /// The code at which the first isosurface begins, for comparison with ranges of codes.
        pub threshold_code: f32,
        /// The [numbers](crate::LayerShader::numbers) of a layer drawn together with others; else 0.
        pub firsts: [u32; 4],
    }

    /// A vertex of a mesh; `MeshVertex` in WGSL.
    pub struct MeshVertex as MeshVertex {
        /// Position from the volume's corner, in world units: voxels times the spacing.
        pub place: [f32; 3],
        /// Red, green and blue of the vertex in 8 bits each, from the lowest; 0 if the mesh's vertices have no colours.
        pub color: u32,
        /// Normal of the vertex in the world, of any length; 0 if the mesh's vertices have no normals.
        pub normal: [f32; 3],
        /// Padding.
        pub spare: f32,
    }

    /// A mesh's look; `MeshLook` in WGSL.
    pub struct MeshLook as MeshLook {
        /// Colour of the whole mesh, 0 to 1; used if [`MeshLook::HAS_COLOR`] is set.
        pub color: [f32; 3],
        /// Opacity of the mesh, 0 to 1.
        pub opacity: f32,
        /// The mesh's features: the sum of those of [`MeshLook::HAS_COLOR`], [`MeshLook::HAS_COLORS`], [`MeshLook::HAS_NORMALS`] and
        /// [`MeshLook::IS_LIT`] that apply.
        pub flags: u32,
        /// Padding.
        pub spare: [u32; 3],
    }

    /// A cell of the draw list, drawn as a box; `Cell` in WGSL.
    pub struct CellInstance as Cell {
        /// Low corner of the cell's half-open box, in level-0 voxels.
        pub region_min: [f32; 3],
        /// The least threshold (0 to 63) of the cell's pixels.
        pub pixels_from: u32,
        /// High corner of the cell's half-open box, in level-0 voxels; exclusive.
        pub region_max: [f32; 3],
        /// One past the greatest threshold of the cell's pixels.
        pub pixels_to: u32,
    }

    /// A layer's brick in a cell; `CellBrick` in WGSL.
    pub struct CellBrick as CellBrick {
        /// Atlas texels per level-0 voxel: one over the brick's level's factor.
        pub texel_scale: [f32; 3],
        /// 1 if the layer has a brick in the cell, else 0.
        pub is_there: u32,
        /// Position of voxel-space zero in the atlas, in texels.
        pub texel_offset: [f32; 3],
        /// Padding.
        pub spare: f32,
    }

    /// A brick of the draw list, found by rays through a leaf of the octree; `RayBrick` in WGSL. A brick that fades in is followed by its
    /// predecessor.
    pub struct RayBrick as RayBrick {
        /// Atlas texels per level-0 voxel: one over the brick's level's factor.
        pub texel_scale: [f32; 3],
        /// Index of the brick's first macro-cell in its pool's part of the buffer of ranges; [`NO_RANGES`] if rays ignore the brick's macro-cells.
        pub first_range: u32,
        /// Position of voxel-space zero in the atlas, in texels.
        pub texel_offset: [f32; 3],
        /// The least code of the whole brick in the low 16 bits, and the greatest in the high 16 bits. The least is past the greatest if no voxel
        /// has a value.
        pub range: u32,
        /// Low corner of the brick's core, in level-0 voxels.
        pub low: [f32; 3],
        /// The first threshold of the pixels that draw the next brick instead; 64 if there are none.
        pub pixels_to: u32,
    }
}

impl MeshLook {
    /// Flag: the mesh has one colour, which overrides its vertices' colours.
    pub const HAS_COLOR: u32 = 1;
    /// Flag: the mesh's vertices have colours.
    pub const HAS_COLORS: u32 = 2;
    /// Flag: the mesh's vertices have normals. Without it triangles have their own.
    pub const HAS_NORMALS: u32 = 4;
    /// Flag: the mesh is lit from the eye. Without it the mesh shows its plain colour.
    pub const IS_LIT: u32 = 8;
}

/// The value of [`RayBrick::first_range`] for a brick without macro-cells worth skipping: rays ignore its macro-cells.
pub const NO_RANGES: u32 = u32::MAX;

/// The leaf bit of an octree node's word. A leaf's other bits are 0 if nothing is drawn, else one more than the index of the brick.
pub const LEAF: u32 = 1 << 31;

/// The bit of an octree node's word for halving the x axis. The next two bits are for y and z; the bits below are the index of the children's
/// group of eight.
pub const HALVES_X: u32 = 1 << 28;
