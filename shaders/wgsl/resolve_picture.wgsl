// What is seen, over the background.
//!import frame fullscreen seen
@fragment
fn resolve(@builtin(position) position: vec4f) -> @location(0) vec4f {
    frame = frames[layer];
    let color = seen(position.xy);
    return vec4f(color.rgb + (1.0 - color.a) * frame.background, 1.0);
}
