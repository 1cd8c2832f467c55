// Whether samples with codes in a range can have opacity, or surfaces be among them: if they are not all past as many as the ray.
// `opaque_before` counts the table's entries with opacity before each code.
@group(0) @binding(8) var<storage, read> opaque_before: array<u32>;

// How many surfaces a code is past.
fn rank_of_code(code: u32) -> i32 {
    let first = select(vec4f(0.0), vec4f(1.0), frame.thresholds[0] * frame.last_code <= vec4f(f32(code)));
    let others = select(vec4f(0.0), vec4f(1.0), frame.thresholds[1] * frame.last_code <= vec4f(f32(code)));
    return i32(dot(first + others, vec4f(1.0)));
}

fn sees(pixel: Pixel, range: u32) -> bool {
    let low = range & 0xffffu;
    let high = range >> 16u;
    let is_foggy = HAS_FOG && opaque_before[low] < opaque_before[high + 1u];
    let rank = rank_of_code(low);
    let is_passed = rank_of_code(high) != rank || (pixel.rank >= 0 && pixel.rank != rank);
    return low <= high && (is_foggy || is_passed);
}
