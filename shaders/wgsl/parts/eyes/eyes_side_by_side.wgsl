// The left eye's picture in the left half, the right eye's in the right.
//!import pictures

fn color_of_eyes(at: vec2f) -> vec3f {
    let own = vec2f(at.x * 2.0, at.y);
    return select(left_eye(own), right_eye(own - vec2f(1.0, 0.0)), own.x >= 1.0);
}
