// What a layer shows of a piece of a segment by itself. The rule is written down beside its CPU twin, the volume crate's `LayerMedium`.
//!import classify context

struct Pixel {
    // Premultiplied colour of a layer that mixes, and its depth: halvings of the light on the way through. Of a single sample
    // (`IS_ONE_SAMPLE`) it is colour times depth, which is what it will be needed as.
    color: vec3f,
    depth: f32,
    // What a layer that adds gives.
    emission: vec3f,
}

// Below so many natural logarithms of the light a difference to all of it would be what rounding leaves.
const THIN: f32 = 1e-3;
const LN_2: f32 = 0.69314718;

fn pixel_start() -> Pixel {
    return Pixel(vec3f(0.0), 0.0, vec3f(0.0));
}

// The share of the light that a depth takes.
fn hidden_by(depth: f32) -> f32 {
    let nats = depth * LN_2;
    return select(1.0 - exp2(-depth), nats - 0.5 * nats * nats, nats < THIN);
}

fn add(pixel: Pixel, medium: Medium, color: vec3f, length: f32) -> Pixel {
    let distance = length * frame.per_unit_distance;
    if (ADDS) {
        return Pixel(vec3f(0.0), 0.0, pixel.emission + color * (hidden_by(medium.depth) * distance));
    }
    let depth = medium.depth * distance;
    if (IS_ONE_SAMPLE) {
        return Pixel(color * depth, depth, vec3f(0.0));
    }
    return Pixel(pixel.color + color * (exp2(-pixel.depth) * hidden_by(depth)), pixel.depth + depth, vec3f(0.0));
}
