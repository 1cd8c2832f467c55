// The projection of a layer over others: it covers adding layers, and dims mixing ones by its opacity in the final resolving pass.
//!import frame fullscreen seen sums

@fragment
fn resolve(@builtin(position) position: vec4f) -> Sums {
    frame = frames[layer];
    return Sums(vec4f(0.0), seen(position.xy));
}
