// The finished picture, stretched over a part of an application's texture.
//!import eyes written

struct Place {
    @builtin(position) position: vec4f,
    @location(0) at: vec2f,
}

@vertex
fn stretched(@builtin(vertex_index) i: u32) -> Place {
    let at = vec2f(f32(i & 1u) * 2.0, f32(i >> 1u) * 2.0);
    return Place(vec4f(at.x * 2.0 - 1.0, 1.0 - at.y * 2.0, 0.5, 1.0), at);
}

@fragment
fn blit(place: Place) -> @location(0) vec4f {
    return vec4f(written(color_of_eyes(place.at)), 1.0);
}
