// Central differences of values: across two voxels along each axis, about a place with a value.
//!import field neighbour

const IS_STORED: bool = false;

fn value_differences(field: Field, t: f32, middle: f32) -> vec3f {
    let texel = field.origin + field.along * clamp(t, field.reach.x, field.reach.y);
    let x = vec3f(1.0, 0.0, 0.0);
    let y = vec3f(0.0, 1.0, 0.0);
    let z = vec3f(0.0, 0.0, 1.0);
    return vec3f(
        neighbour(field, texel, x, middle) - neighbour(field, texel, -x, middle),
        neighbour(field, texel, y, middle) - neighbour(field, texel, -y, middle),
        neighbour(field, texel, z, middle) - neighbour(field, texel, -z, middle),
    );
}
