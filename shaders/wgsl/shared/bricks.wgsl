// Bricks of a draw list, as rays find them.
//!import RayBrick bindings context ray

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
