// Rows 0, 2, 4... from the top are the left eye's, the others the right eye's.
//!import pictures

fn color_of_eyes(at: vec2f) -> vec3f {
    let row = u32(at.y * f32(textureDimensions(left_picture).y));
    return select(left_eye(at), right_eye(at), (row & 1u) == 1u);
}
