// Bricks of a draw list, as rays find them.
//!import bindings context ray

// Twin of `RayBrick` in layout.rs.
struct RayBrick {
    // texel = voxel * texel_scale + texel_offset
    texel_scale: vec3f,
    // Of the brick's first macro-cell in `ranges`; NO_RANGES where all of them are seen.
    first_range: u32,
    texel_offset: vec3f,
    // Of all the brick's macro-cells together.
    range: u32,
    // Low corner of the brick's core, level-0 voxels.
    low: vec3f,
    // Pixels with this threshold or a greater one draw the next brick instead.
    pixels_to: u32,
}

const NO_RANGES: u32 = 0xffffffffu;
@group(0) @binding(BRICKS) var<storage, read> bricks: array<RayBrick>;

// Where the ray leaves a box that it is in.
fn leaving(ray: Ray, low: vec3f, size: vec3f) -> f32 {
    let t = (select(low, low + size, ray.direction > vec3f(0.0)) - ray.origin) * ray.inverse;
    return min(min(t.x, t.y), t.z);
}

// Which brick a leaf's number stands for in a pixel. While one fades in, pixels that it does not have yet draw the next one.
fn brick_number(leaf: u32, threshold: u32) -> u32 {
    let first = leaf - 1u;
    return first + u32(threshold >= bricks[FIRST_BRICK + first].pixels_to);
}

fn brick_at(number: u32) -> RayBrick {
    return bricks[FIRST_BRICK + number];
}
