// The octree over the draw list: which brick, if any, stands for a point of the volume. Built anew on the CPU for every
// frame; its size is the cut's, not the volume's.
//!import bindings context frame

// Words of the nodes, eight to a group, child x + 2y + 4z; the root is the first. A leaf has bit 31 and holds a number: 0 where
// nothing is drawn, else one more than the brick's place in `bricks`. Another node holds its children's group, and in bits
// 28 to 30 the axes that it halves; children past the halved axes are never asked for.
const LEAF: u32 = 1u << 31u;
const GROUP: u32 = (1u << 28u) - 1u;
@group(0) @binding(NODES) var<storage, read> nodes: array<u32>;

// A leaf of the tree: a box of voxel space and the node's number.
struct Place {
    low: vec3f,
    size: vec3f,
    number: u32,
}

fn find_place(point: vec3f) -> Place {
    // The volume's own faces are no borders: a point that rounding puts past one still belongs to the leaf inside.
    let inside = clamp(point, vec3f(0.0), frame.extent - 0.5);
    var low = vec3f(0.0);
    var size = frame.root_size;
    var word = nodes[FIRST_NODE];
    // Every way ends in a leaf after `tree_depth` nodes at most. Without that bound lavapipe (Mesa 22.3) was seen to go round
    // with no lane active, until it gave up on all loops of the shader.
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
