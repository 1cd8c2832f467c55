// Nearest texel: for labels, which are never interpolated, and for fields with steps.
//!import context no_value

// The atlas's value at a point (in texels); `NO_VALUE` where the texel has none.
fn sample_nearest(atlas: texture_3d<f32>, point: vec3f) -> f32 {
    let value = textureLoad(atlas, vec3i(floor(point)), 0).x;
    return select(value, NO_VALUE, HAS_INVALID && value <= 0.0);
}
