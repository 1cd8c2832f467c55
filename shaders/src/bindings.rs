//! Where shaders find what is bound: one table of names and numbers, for layouts, bind groups and WGSL alike.

macro_rules! bindings {
    ($($(#[$doc:meta])* $name:ident = $number:literal;)*) => {
        $($(#[$doc])* pub const $name: u32 = $number;)*

        /// All of them as constants of WGSL.
        pub(crate) fn wgsl() -> String {
            [$(concat!("const ", stringify!($name), ": u32 = ", $number, "u;\n")),*].concat()
        }
    };
}

bindings! {
    /// Group 0: the settings of all layers' frames.
    FRAMES = 0;
    /// Group 0 of marches: the bricks of draw lists that rays are cast through.
    BRICKS = 1;
    /// Group 0 of marches: the cells of a draw list that is drawn as boxes.
    CELLS = 2;
    /// Group 0 of marches: the bricks that stand for layers in such cells.
    CELL_BRICKS = 14;
    /// Group 0 of marches: how atlases are sampled.
    ATLAS_SAMPLER = 3;
    /// Group 0: the transfer tables.
    TABLE = 4;
    /// Group 0 of resolving passes: what has been gathered.
    GATHERED = 5;
    /// Group 0 of marches: the octrees' nodes.
    NODES = 6;
    /// Group 0 of marches: the codes' ranges in macro-cells.
    RANGES = 7;
    /// Group 0 of marches: how many entries of a table have opacity before each.
    OPAQUE_BEFORE = 8;
    /// Group 0 of marches: how bricks were entered.
    MARKS = 9;
    /// Group 0 of the pass that shows joined projections: of what adds, the sum.
    EMISSION = 10;
    /// Group 0 of the pass over meshes: vertices.
    VERTICES = 11;
    /// Group 0 of the pass over meshes: triangles' corners.
    CORNERS = 12;
    /// Group 0 of the pass over meshes: how each mesh looks.
    LOOKS = 13;
    /// Group 0 of marches: the first pool's atlas; the others follow.
    FIRST_ATLAS = 16;
    /// Group 0 of marches: the first pool's stored gradients, behind as many atlases as there can be; the others follow.
    FIRST_GRADIENTS = 48;
    /// Group 1: distances of the layer of meshes in front of a slab.
    NEAR_LAYER = 0;
    /// Group 1: distances of the layer of meshes behind a slab.
    FAR_LAYER = 1;
    /// Group 1: the picture in front of a slab.
    FRONT = 2;
    /// Group 1: triangles' numbers of the layer of meshes in front.
    NEAR_NUMBER = 3;
    /// Group 1: colours of the layer of meshes behind a slab.
    LAYER_COLOR = 4;
    /// Group 2: what compute shaders write.
    TEXELS = 0;
    /// Group 0 of the pass to an application's texture: the picture of the one eye, or of the left one.
    LEFT_PICTURE = 0;
    /// Group 0 of that pass: the picture of the right eye.
    RIGHT_PICTURE = 1;
    /// Group 0 of that pass: how pictures are stretched.
    PICTURE_SAMPLER = 2;
}
