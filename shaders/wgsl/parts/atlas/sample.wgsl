// The atlas's value at a point (in texels), by the hardware's trilinear filter. Never negative.
//!import frame sampler

fn sample_full(atlas: texture_3d<f32>, point: vec3f) -> f32 {
    return textureSampleLevel(atlas, atlas_sampler, point * frame.texel, 0.0).x;
}
