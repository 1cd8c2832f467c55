// The value a voxel away from a texel; a missing one counts as `middle`.
//!import field no_value

fn neighbour(field: Field, texel: vec3f, offset: vec3f, middle: f32) -> f32 {
    let value = smooth_atlas(clamp(texel + offset, field.low, field.high));
    return select(value, middle, HAS_INVALID && !has_value(value));
}
