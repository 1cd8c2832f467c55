// The octree over the draw list: the brick, if any, at each point of the volume. Rebuilt on the CPU for every frame; its size
// is the cut's, not the volume's.
//!import bindings context frame

// Words of the nodes, eight to a group, child x + 2y + 4z; the root is the first. A leaf has bit 31 and a number: 0 if it is
// empty, else one more than the brick's index in `bricks`. Another node has its children's group, and in bits 28 to 30 the axes
// that it halves; upper children along other axes are never read.
const LEAF: u32 = 1u << 31u;
const GROUP: u32 = (1u << 28u) - 1u;
@group(0) @binding(NODES) var<storage, read> nodes: array<u32>;

// A leaf of the tree: a box in voxel space, and the leaf's number.
struct Place {
    low: vec3f,
    size: vec3f,
    number: u32,
}

fn find_place(point: vec3f) -> Place {
    // The volume's own faces are no borders: a point rounded past one still belongs to the leaf inside.
    let inside = clamp(point, vec3f(0.0), frame.extent - 0.5);
    var low = vec3f(0.0);
    var size = frame.root_size;
    var word = nodes[FIRST_NODE];
    // Every path ends in a leaf after at most `tree_depth` nodes. Without this bound lavapipe (Mesa 22.3) was seen to loop with
    // no lane active until it gave up on all loops of the shader.
    for (var depth = 0u; depth < frame.tree_depth; depth++) {
        if ((word & LEAF) != 0u) {
            break;
        }
        let halves = ((vec3u(word) >> vec3u(28u, 29u, 30u)) & vec3u(1u)) == vec3u(1u);
        size = select(size, size * 0.5, halves);
        let upper = inside >= low + size;
        low = select(low, low + size, upper);
        let child = select(vec3u(0u), vec3u(1u, 2u, 4u), upper);
        word = nodes[FIRST_NODE + ((word & GROUP) << 3u) + child.x + child.y + child.z];
    }
    return Place(low, size, word & ~LEAF);
}
