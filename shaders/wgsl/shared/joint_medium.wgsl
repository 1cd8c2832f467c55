// What is seen of all layers together in an interval of a ray. The rule is written down beside its CPU twin, the volume crate's
// `JointMedium`.
//!import layer_medium

struct Light {
    color: vec3f,
    transmittance: f32,
}

struct JointMedium {
    // Of layers that mix: colour times depth, and depth.
    color: vec3f,
    depth: f32,
    // Of layers that add.
    emission: vec3f,
}

// With a share of what a layer shows of a piece.
fn with_share(before: JointMedium, shown: Pixel, share: f32) -> JointMedium {
    // A medium's colour times its depth is what is seen of it in its own light times this.
    var thinned = 1.0;
    if (!IS_ONE_SAMPLE) {
        thinned = select(shown.depth / hidden_by(shown.depth), 1.0 / LN_2, shown.depth * LN_2 < THIN);
    }
    let color = before.color + shown.color * (thinned * share);
    return JointMedium(color, before.depth + shown.depth * share, before.emission + shown.emission * share);
}

fn see(light: Light, together: JointMedium) -> Light {
    let nats = together.depth * LN_2;
    let hidden = hidden_by(together.depth);
    // The mean, from the interval's front to its back, of the light that passes from there.
    let dimmed = select(hidden / nats, 1.0 - 0.5 * nats, nats < THIN);
    let seen = together.color * (LN_2 * dimmed) + together.emission * dimmed;
    return Light(light.color + light.transmittance * seen, light.transmittance * (1.0 - hidden));
}
