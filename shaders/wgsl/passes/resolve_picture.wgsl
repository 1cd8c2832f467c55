// Resolves a pixel: its colour over the background, rounded to an 8-bit code like `Picture::quantise`. Halves go up here: a target may
// round them either way, and an H200 rounds 25.5 down.
//!import frame fullscreen seen

@fragment
fn resolve(@builtin(position) position: vec4f) -> @location(0) vec4f {
    frame = frames[layer];
    let color = seen(position.xy);
    let shown = saturate(color.rgb + (1.0 - color.a) * frame.background);
    return vec4f(floor(shown * 255.0 + 0.5) / 255.0, 1.0);
}
