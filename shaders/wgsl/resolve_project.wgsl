// The greatest or least value through the table's colours; opaque where something was sampled.
@group(0) @binding(5) var gathered: texture_2d<f32>;

@fragment
fn resolve(@builtin(position) position: vec4f) -> @location(0) vec4f {
    frame = frame_settings;
    let extreme = textureLoad(gathered, vec2i(position.xy), 0).xy;
    let color = classify(abs(frame.invert - extreme.x)).color;
    return vec4f(select(frame.background, color, extreme.y > 0.0), 1.0);
}
