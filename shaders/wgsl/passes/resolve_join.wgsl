// The projection of one of several layers, to be added to those of the others: of what mixes colour times depth and depth, of what
// adds colour times opacity. The rule is written down beside its CPU twin, the volume crate's `JointMedium`.
//!import frame fullscreen seen

struct Sums {
    @location(0) mixed: vec4f,
    @location(1) emission: vec4f,
}

@fragment
fn resolve(@builtin(position) position: vec4f) -> Sums {
    frame = frames[layer];
    let color = seen(position.xy);
    // Straight colour times opacity, as `projected` makes it; with an alpha of what mixes.
    let depth = select(0.0, frame.flat_depth, color.a > 0.0);
    return Sums(vec4f(color.rgb / max(frame.opacity, 1e-30), 1.0) * depth, vec4f(color.rgb * frame.adds, 0.0));
}
