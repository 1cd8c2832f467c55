//! Numbers of all bindings, in one table for layouts, bind groups and WGSL.

macro_rules! bindings {
    ($($(#[$doc:meta])* $name:ident = $number:literal;)*) => {
        $($(#[$doc])* pub const $name: u32 = $number;)*

        /// WGSL source with a constant for each number.
        pub(crate) fn wgsl() -> String {
            [$(concat!("const ", stringify!($name), ": u32 = ", $number, "u;\n")),*].concat()
        }
    };
}

bindings! {
    /// Group 0: settings of the layers' frames, [`FrameUniform`](crate::FrameUniform)s.
    FRAMES = 0;
    /// Group 0 of marches: bricks of draw lists for ray casting, [`RayBrick`](crate::RayBrick)s.
    BRICKS = 1;
    /// Group 0 of marches: cells of a draw list drawn as boxes, [`CellInstance`](crate::CellInstance)s.
    CELLS = 2;
    /// Group 0 of marches: the layers' bricks in cells drawn as boxes, [`CellBrick`](crate::CellBrick)s.
    CELL_BRICKS = 14;
    /// Group 0 of marches: sampler for atlases and stored gradients.
    ATLAS_SAMPLER = 3;
    /// Group 0 of marches and of resolving passes: transfer tables.
    TABLE = 4;
    /// Group 0 of resolving passes: source texture of the colours, with gathered samples, the sum of mixing
    /// projections, or the picture composed of slabs.
    GATHERED = 5;
    /// Group 0 of marches: nodes of octrees over draw lists.
    NODES = 6;
    /// Group 0 of marches: ranges of codes in macro-cells.
    RANGES = 7;
    /// Group 0 of marches: for each code of the transfer table, and for the entries between it and the next, the number
    /// of such places before it with opacity.
    OPAQUE_BEFORE = 8;
    /// Group 0 of marches: for each brick of draw lists, the greatest transmittance of an entering ray, in steps of 1 /
    /// [`MARK_STEPS`](crate::MARK_STEPS).
    MARKS = 9;
    /// Group 0 of the pass for joined projections: summed light of adding layers.
    EMISSION = 10;
    /// Group 0 of the pass over meshes: vertices, [`MeshVertex`](crate::MeshVertex)es.
    VERTICES = 11;
    /// Group 0 of the pass over meshes: vertex index for each corner of each triangle.
    CORNERS = 12;
    /// Group 0 of the pass over meshes: looks of the meshes, [`MeshLook`](crate::MeshLook)s.
    LOOKS = 13;
    /// Group 0 of marches: the first pool's atlas. Atlases of the other pools have the next numbers.
    FIRST_ATLAS = 16;
    /// Group 0 of marches: texture of the first pool's stored gradients. Those of the other pools have the next
    /// numbers. Leaves room for the greatest number of atlases.
    FIRST_GRADIENTS = 48;
    /// Group 1: distances of the layer of meshes in front of a slab.
    NEAR_LAYER = 0;
    /// Group 1: distances of the layer of meshes behind a slab.
    FAR_LAYER = 1;
    /// Group 1: the picture in front of a slab.
    FRONT = 2;
    /// Group 1: for each pixel, one more than the index of the triangle seen in the layer of meshes in front of a slab,
    /// counted over all meshes; 0 if there is none.
    NEAR_NUMBER = 3;
    /// Group 1: colours of the layer of meshes behind a slab.
    LAYER_COLOR = 4;
    /// Group 2: the texture written by compute shaders.
    TEXELS = 0;
    /// Group 0 of the pass to an application's texture: the left or only eye's picture.
    LEFT_PICTURE = 0;
    /// Group 0 of the pass to an application's texture: the right or only eye's picture.
    RIGHT_PICTURE = 1;
    /// Group 0 of the pass to an application's texture: the sampler that stretches pictures.
    PICTURE_SAMPLER = 2;
}
