// A layer's own medium over a piece of a segment. The rule is documented with its CPU twin, the volume crate's `LayerMedium`.
//!import classify context

struct Pixel {
    // Premultiplied colour of a mixing layer, and its depth: halvings of the light on the way through. For a single sample
    // (`IS_ONE_SAMPLE`), colour times depth, as needed later.
    color: vec3f,
    depth: f32,
    // Light of an adding layer.
    emission: vec3f,
}

// Depth in natural logarithms below which 1 minus the remaining light would be rounding error.
const THIN: f32 = 1e-3;
const LN_2: f32 = 0.69314718;

fn pixel_start() -> Pixel {
    return Pixel(vec3f(0.0), 0.0, vec3f(0.0));
}

// The share of the light absorbed by a depth.
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
