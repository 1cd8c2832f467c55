// The greatest or least value through the table's colours; opaque where something was sampled.
@group(0) @binding(5) var gathered: texture_2d<f32>;

fn seen(position: vec2f) -> vec4f {
    let extreme = textureLoad(gathered, vec2i(position), 0).xy;
    let color = classify(abs(frame.invert - extreme.x)).color;
    return select(vec4f(0.0), vec4f(color, 1.0), extreme.y > 0.0);
}
