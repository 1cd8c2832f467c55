// The gathered colour, which is premultiplied.
@group(0) @binding(5) var gathered: texture_2d<f32>;

fn seen(position: vec2f) -> vec4f {
    return textureLoad(gathered, vec2i(position), 0);
}
