// The greatest or least value, through the table's colours; opaque where something was sampled.
//!import colors frame gathered projected

fn seen(position: vec2f) -> vec4f {
    let extreme = textureLoad(gathered, vec2i(position), 0).xy;
    let color = color_at(abs(frame.invert - extreme.x));
    return select(vec4f(0.0), projected(color), extreme.y > 0.0);
}
