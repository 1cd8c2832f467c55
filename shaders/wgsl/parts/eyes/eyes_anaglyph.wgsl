// For red-cyan glasses, by Dubois's matrices; they are documented with their CPU twin, the volume crate's `stereo`.
//!import light pictures

const LEFT_EYE = mat3x3f(0.456100, -0.0400822, -0.0152161, 0.500484, -0.0378246, -0.0205971, 0.176381, -0.0157589, -0.00546856);
const RIGHT_EYE = mat3x3f(-0.0434706, 0.378476, -0.0721527, -0.0879388, 0.73364, -0.112961, -0.00155529, -0.0184503, 1.2264);

fn color_of_eyes(at: vec2f) -> vec3f {
    return encoded(saturate(LEFT_EYE * light_of(left_eye(at)) + RIGHT_EYE * light_of(right_eye(at))));
}
