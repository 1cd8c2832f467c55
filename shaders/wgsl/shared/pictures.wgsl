// Pictures of the eyes; a single eye's picture is both. Places go from 0 to 1, from the upper left corner.
//!import bindings

@group(0) @binding(LEFT_PICTURE) var left_picture: texture_2d<f32>;
@group(0) @binding(RIGHT_PICTURE) var right_picture: texture_2d<f32>;
@group(0) @binding(PICTURE_SAMPLER) var picture_sampler: sampler;

fn left_eye(at: vec2f) -> vec3f {
    return textureSampleLevel(left_picture, picture_sampler, at, 0.0).rgb;
}

fn right_eye(at: vec2f) -> vec3f {
    return textureSampleLevel(right_picture, picture_sampler, at, 0.0).rgb;
}
