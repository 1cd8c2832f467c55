//! Where shaders find what is bound: one table of names and numbers, for layouts, bind groups and WGSL alike.

macro_rules! bindings {
    ($($(#[$doc:meta])* $name:ident = $number:literal;)*) => {
        $($(#[$doc])* pub const $name: u32 = $number;)*

        /// WGSL source that declares all of these numbers as constants.
        pub(crate) fn wgsl() -> String {
            [$(concat!("const ", stringify!($name), ": u32 = ", $number, "u;\n")),*].concat()
        }
    };
}

bindings! {
    /// Binding in group 0: the settings of the layers' frames, [`FrameUniform`](crate::FrameUniform)s.
    FRAMES = 0;
    /// Binding in group 0 of marches: the bricks of draw lists that rays are cast through,
    /// [`RayBrick`](crate::RayBrick)s.
    BRICKS = 1;
    /// Binding in group 0 of marches: the cells of a draw list that is drawn as boxes,
    /// [`CellInstance`](crate::CellInstance)s.
    CELLS = 2;
    /// Binding in group 0 of marches: the bricks that stand for layers in cells that are drawn as boxes,
    /// [`CellBrick`](crate::CellBrick)s.
    CELL_BRICKS = 14;
    /// Binding in group 0 of marches: the sampler for atlases and stored gradients.
    ATLAS_SAMPLER = 3;
    /// Binding in group 0 of marches and of resolving passes: the transfer tables.
    TABLE = 4;
    /// Binding in group 0 of resolving passes: the texture that colours are made of. It holds gathered samples, the sum
    /// of the projections that mix, or the picture composed of slabs.
    GATHERED = 5;
    /// Binding in group 0 of marches: the nodes of octrees over draw lists.
    NODES = 6;
    /// Binding in group 0 of marches: the ranges of codes in macro-cells.
    RANGES = 7;
    /// Binding in group 0 of marches: for each code, how many entries of the transfer table before it have opacity.
    OPAQUE_BEFORE = 8;
    /// Binding in group 0 of marches: for each brick of draw lists, the greatest transmittance with which a ray has
    /// entered it, in steps of 1 / [`MARK_STEPS`](crate::MARK_STEPS).
    MARKS = 9;
    /// Binding in group 0 of the pass that shows joined projections: the sum of the light of layers that add.
    EMISSION = 10;
    /// Binding in group 0 of the pass over meshes: the vertices, [`MeshVertex`](crate::MeshVertex)es.
    VERTICES = 11;
    /// Binding in group 0 of the pass over meshes: the index of a vertex for each corner of each triangle.
    CORNERS = 12;
    /// Binding in group 0 of the pass over meshes: how each mesh looks, [`MeshLook`](crate::MeshLook)s.
    LOOKS = 13;
    /// Binding in group 0 of marches: the first pool's atlas. The atlases of the other pools have the next numbers.
    FIRST_ATLAS = 16;
    /// Binding in group 0 of marches: the texture of the first pool's stored gradients. The textures of the other pools
    /// have the next numbers. The number leaves room for as many atlases as there can be.
    FIRST_GRADIENTS = 48;
    /// Binding in group 1: the distances of the layer of meshes in front of a slab.
    NEAR_LAYER = 0;
    /// Binding in group 1: the distances of the layer of meshes behind a slab.
    FAR_LAYER = 1;
    /// Binding in group 1: the picture of all that is in front of a slab.
    FRONT = 2;
    /// Binding in group 1: for each pixel, one more than the index of the triangle that is seen in the layer of meshes
    /// in front of a slab, counted over all meshes; 0 where there is none.
    NEAR_NUMBER = 3;
    /// Binding in group 1: the colours of the layer of meshes behind a slab.
    LAYER_COLOR = 4;
    /// Binding in group 2: the texture that compute shaders write.
    TEXELS = 0;
    /// Binding in group 0 of the pass to an application's texture: the left eye's picture, or the picture of the only
    /// eye.
    LEFT_PICTURE = 0;
    /// Binding in group 0 of the pass to an application's texture: the right eye's picture, or the picture of the only
    /// eye.
    RIGHT_PICTURE = 1;
    /// Binding in group 0 of the pass to an application's texture: the sampler that stretches pictures.
    PICTURE_SAMPLER = 2;
}
