// The gathered colour, premultiplied.
//!import gathered

fn seen(position: vec2f) -> vec4f {
    return textureLoad(gathered, vec2i(position), 0);
}
