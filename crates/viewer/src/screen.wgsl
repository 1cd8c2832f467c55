// A picture over a part of the window: places go from 0 to 1, from its upper left corner.
@group(0) @binding(0) var picture: texture_2d<f32>;
@group(0) @binding(1) var picture_sampler: sampler;

struct Place {
    @builtin(position) position: vec4f,
    @location(0) at: vec2f,
}

// One triangle over the whole part.
@vertex
fn corner(@builtin(vertex_index) i: u32) -> Place {
    let at = vec2f(f32(i & 1u) * 2.0, f32(i >> 1u) * 2.0);
    return Place(vec4f(at.x * 2.0 - 1.0, 1.0 - at.y * 2.0, 0.5, 1.0), at);
}

fn color(at: vec2f) -> vec3f {
    return textureSampleLevel(picture, picture_sampler, at, 0.0).rgb;
}

// The window stores the written values.
@fragment
fn codes(place: Place) -> @location(0) vec4f {
    return vec4f(color(place.at), 1.0);
}

// The window encodes light, as sRGB formats do; this decodes the picture's codes for it.
@fragment
fn light(place: Place) -> @location(0) vec4f {
    let code = color(place.at);
    let bright = pow((code + 0.055) / 1.055, vec3f(2.4));
    return vec4f(select(bright, code / 12.92, code <= vec3f(0.04045)), 1.0);
}
