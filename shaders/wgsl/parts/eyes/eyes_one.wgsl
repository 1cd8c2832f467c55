// One eye.
//!import pictures

fn color_of_eyes(at: vec2f) -> vec3f {
    return left_eye(at);
}
