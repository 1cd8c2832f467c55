// Whether surfaces can be among codes in a range.
//!import anything caps counted frame

// Number of surfaces that a code is past.
fn rank_of_code(code: u32) -> i32 {
    let first = select(vec4f(0.0), vec4f(1.0), frame.thresholds[0] * frame.last_code <= vec4f(counted(code)));
    let others = select(vec4f(0.0), vec4f(1.0), frame.thresholds[1] * frame.last_code <= vec4f(counted(code)));
    return i32(dot(first + others, vec4f(1.0)));
}

// Whether some codes of a range are past other surfaces than the ray. In front of a cut the ray is past none.
fn is_passed(ray_rank: i32, range: u32) -> bool {
    let rank = rank_of_code(range & 0xffffu);
    return range == ANYTHING || rank_of_code(range >> 16u) != rank || (ray_rank != -1 && max(ray_rank, 0) != rank);
}
