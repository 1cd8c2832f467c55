// Rays by fragment shader, with one triangle over the picture.
//!import cast frame fullscreen

@fragment
fn raycast(@builtin(position) position: vec4f) -> @location(0) vec4f {
    frame = frames[layer];
    return cast_ray(position.xy);
}
