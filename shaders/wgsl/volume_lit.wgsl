// The light of one of several volumes, #, which is lit. Gradient, ray and lights are brought to the scene's world, but from the volume's
// corner on.
fn lit_#(t: f32, value: f32, medium: Medium) -> vec3f {
    if (medium.depth <= 0.0) {
        return medium.color;
    }
    let ray = way_#.ray;
    let scale = way_#.brick.texel_scale;
    let field = field_about_#(way_#.brick.low + 0.5 / scale, scale, way_#.brick.texel_offset, ray);
    let differences = differences_#(field, t, value);
    let is_flat = length(differences) * frame_#.last_code < FLAT_CODES;
    let gradient = along_axes(frame_#.slopes, differences * scale);
    let view = along_axes(frame_#.axes, ray.direction);
    volume = #u;
    return lit(LIGHTu, medium.color, is_flat, gradient, view, along_axes(frame_#.axes, ray.origin + ray.direction * t));
}
