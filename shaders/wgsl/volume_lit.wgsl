// Light of one of several volumes, #. Gradient, ray and lights are brought to the scene's world, but from the volume's corner on.
fn field_#() -> Field {
    let scale = way_#.brick.texel_scale;
    return field_about_#(way_#.brick.low + 0.5 / scale, scale, way_#.brick.texel_offset, way_#.ray);
}

// A colour lit at a place of the ray, by differences of values about it.
fn shade_#(lighting: u32, t: f32, color: vec3f, differences: vec3f) -> vec3f {
    let ray = way_#.ray;
    let is_flat = length(differences) * frame_#.last_code < FLAT_CODES;
    let gradient = along_axes(frame_#.slopes, differences * way_#.brick.texel_scale);
    let view = along_axes(frame_#.axes, ray.direction);
    let place = along_axes(frame_#.axes, ray.origin + ray.direction * t);
    volume = #u;
    return lit(lighting, frame_#.lights, color, is_flat, gradient, view, place);
}

fn lit_#(t: f32, value: f32, medium: Medium) -> vec3f {
    if (medium.depth <= 0.0) {
        return medium.color;
    }
    return shade_#(LIGHTu, t, medium.color, differences_#(field_#(), t, value));
}
