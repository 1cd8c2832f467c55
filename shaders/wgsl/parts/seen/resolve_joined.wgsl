// Summed projections of several layers: a medium of the mixing layers, on top the light of adding layers, and over both, with an opacity, covering
// layers.
//!import bindings

@group(0) @binding(GATHERED) var mixed: texture_2d<f32>;
@group(0) @binding(EMISSION) var emission: texture_2d<f32>;

fn seen(position: vec2f) -> vec4f {
    let sum = textureLoad(mixed, vec2i(position), 0);
    let top = textureLoad(emission, vec2i(position), 0);
    let alpha = 1.0 - exp2(-sum.a);
    let color = select(vec3f(0.0), sum.rgb / max(sum.a, 1e-30), sum.a > 0.0);
    return vec4f(color * alpha * (1.0 - top.a) + top.rgb, 1.0 - (1.0 - alpha) * (1.0 - top.a));
}
