// The value at a point of the atlas (in texels), by the hardware's trilinear filter. Never negative.
@group(0) @binding(2) var atlas: texture_3d<f32>;
@group(0) @binding(3) var atlas_sampler: sampler;

const HAS_INVALID: bool = false;
// Texels between a sample and the edge of what it may touch.
const MARGIN: f32 = 0.5;

fn sample_atlas(point: vec3f) -> f32 {
    return textureSampleLevel(atlas, atlas_sampler, point * frame.texel, 0.0).x;
}
