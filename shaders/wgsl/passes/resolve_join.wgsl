// A layer's projection, to be added to those of others: colour times depth, and depth, of a mixing layer; colour times opacity of
// an adding one. The rule is documented with its CPU twin, the volume crate's `JointMedium`.
//!import frame fullscreen seen sums

@fragment
fn resolve(@builtin(position) position: vec4f) -> Sums {
    frame = frames[layer];
    let color = seen(position.xy);
    // Straight colour times opacity, from `projected`; only mixing layers have an alpha.
    let depth = select(0.0, frame.flat_depth, color.a > 0.0);
    return Sums(vec4f(color.rgb / max(frame.opacity, 1e-30), 1.0) * depth, vec4f(color.rgb * frame.adds, 0.0));
}
