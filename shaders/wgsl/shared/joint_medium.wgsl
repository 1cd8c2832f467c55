// All layers together in an interval of a ray. The rule is documented with its CPU twin, the volume crate's `JointMedium`.
//!import layer_medium

struct Light {
    color: vec3f,
    transmittance: f32,
}

struct JointMedium {
    // Of mixing layers: colour times depth, and depth.
    color: vec3f,
    depth: f32,
    // Of adding layers.
    emission: vec3f,
}

// Adds a share of a layer's medium in a piece.
fn with_share(before: JointMedium, shown: Pixel, share: f32) -> JointMedium {
    // Factor from premultiplied colour to colour times depth.
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
    // The interval's mean of the light passing to its front.
    let dimmed = select(hidden / nats, 1.0 - 0.5 * nats, nats < THIN);
    let seen = together.color * (LN_2 * dimmed) + together.emission * dimmed;
    return Light(light.color + light.transmittance * seen, light.transmittance * (1.0 - hidden));
}
