// The left eye's picture in the top half, the right eye's below.
//!import pictures

fn color_of_eyes(at: vec2f) -> vec3f {
    let own = vec2f(at.x, at.y * 2.0);
    return select(left_eye(own), right_eye(own - vec2f(0.0, 1.0)), own.y >= 1.0);
}
