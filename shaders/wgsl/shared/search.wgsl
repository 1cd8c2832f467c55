// Where a ray passes surfaces. The rule is written down beside its CPU twin, the volume crate's `surface`.
//!import context field frame no_value

const SEARCH_PARTS: u32 = 8u;
const ROUNDS: u32 = 2u;

// How many surfaces a value is past; -1 where there is none.
fn rank_of(value: f32) -> i32 {
    let first = select(vec4f(0.0), vec4f(1.0), frame.thresholds[0] <= vec4f(value));
    let others = select(vec4f(0.0), vec4f(1.0), frame.thresholds[1] <= vec4f(value));
    return select(-1, i32(dot(first + others, vec4f(1.0))), has_value(value));
}

// Where in a piece of the ray a surface is passed, to its inside or out of it. (All parts are sampled: to leave loops early where
// rays part ways is what software rasterisers are slowest at.)
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
            // If the first place is past it already, the brick before saw it on the other side there.
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
