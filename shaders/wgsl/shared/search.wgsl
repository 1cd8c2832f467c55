// Search for surfaces along a ray. The rule is documented with its CPU twin, the volume crate's `surface`.
//!import context field frame no_value

const SEARCH_PARTS: u32 = 8u;
const ROUNDS: u32 = 2u;

// Number of surfaces that a value is past; -1 without a value.
fn rank_of(value: f32) -> i32 {
    let first = select(vec4f(0.0), vec4f(1.0), frame.thresholds[0] <= vec4f(value));
    let others = select(vec4f(0.0), vec4f(1.0), frame.thresholds[1] <= vec4f(value));
    return select(-1, i32(dot(first + others, vec4f(1.0))), has_value(value));
}

// Where a surface is passed in a piece of the ray, inward or outward. All parts are sampled: software rasterisers are slowest at
// early loop exits where rays diverge.
fn locate(field: Field, start: f32, end: f32, threshold: f32, is_up: bool) -> f32 {
    var near = start;
    var far = end;
    var far_value = inside(field, end);
    var near_value = far_value;
    for (var round = 0u; round < ROUNDS; round++) {
        let first = near;
        let part = (far - near) / f32(SEARCH_PARTS);
        var is_past = false;
        for (var k = 0u; k < SEARCH_PARTS; k++) {
            let t = first + f32(k) * part;
            let value = inside(field, t);
            let is_first_past = !is_past && has_value(value) && (value >= threshold) == is_up;
            far = select(far, t, is_first_past);
            far_value = select(far_value, value, is_first_past);
            is_past = is_past || is_first_past;
            // If even the first place is past it, the brick before saw that place on the other side.
            near = select(t, near, is_past);
            near_value = select(select(far_value, value, has_value(value)), near_value, is_past);
        }
    }
    let share = (threshold - near_value) / (far_value - near_value);
    return select(near + (far - near) * clamp(share, 0.0, 1.0), far, far_value == near_value);
}

// Where a surface begins.
fn threshold_of(surface: u32) -> f32 {
    return frames[layer].thresholds[surface / 4u][surface % 4u];
}
