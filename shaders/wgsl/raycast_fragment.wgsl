// Rays by fragment shader, of one triangle over the picture.
@fragment
fn raycast(@builtin(position) position: vec4f) -> @location(0) vec4f {
    frame = frame_settings;
    return cast_ray(position.xy);
}
