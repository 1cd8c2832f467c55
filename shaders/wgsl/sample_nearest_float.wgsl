// The value of the texel that a place is in, in an atlas of 32-bit floats.
//!import float_texel
fn sample_nearest_float(atlas: texture_3d<f32>, point: vec3f) -> f32 {
    return float_value(float_texel(atlas, vec3i(floor(point))));
}
