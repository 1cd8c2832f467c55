// The gathered premultiplied colour over the background.
@group(0) @binding(5) var gathered: texture_2d<f32>;

@fragment
fn resolve(@builtin(position) position: vec4f) -> @location(0) vec4f {
    frame = frame_settings;
    let color = textureLoad(gathered, vec2i(position.xy), 0);
    return vec4f(color.rgb + (1.0 - color.a) * frame.background, 1.0);
}
