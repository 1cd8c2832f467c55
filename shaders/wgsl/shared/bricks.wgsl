// Bricks of a draw list, as rays find them.
//!import bindings context ray

// Twin of `RayBrick` in layout.rs.
struct RayBrick {
    // texel = voxel * texel_scale + texel_offset
    texel_scale: vec3f,
    // Index of the brick's first macro-cell in `ranges`; NO_RANGES if all of them are visible.
    first_range: u32,
    texel_offset: vec3f,
    // Range of codes of the whole brick.
    range: u32,
    // Low corner of the brick's core, in level-0 voxels.
    low: vec3f,
    // Pixels with this threshold or a greater one draw the next brick instead.
    pixels_to: u32,
}

const NO_RANGES: u32 = 0xffffffffu;
@group(0) @binding(BRICKS) var<storage, read> bricks: array<RayBrick>;

// Where a ray inside a box leaves it.
fn leaving(ray: Ray, low: vec3f, size: vec3f) -> f32 {
    let t = (select(low, low + size, ray.direction > vec3f(0.0)) - ray.origin) * ray.inverse;
    return min(min(t.x, t.y), t.z);
}

// The brick of a leaf's number in a pixel. While one fades in, pixels not yet its own draw the next one.
fn brick_number(leaf: u32, threshold: u32) -> u32 {
    let first = leaf - 1u;
    return first + u32(threshold >= bricks[FIRST_BRICK + first].pixels_to);
}

fn brick_at(number: u32) -> RayBrick {
    return bricks[FIRST_BRICK + number];
}
