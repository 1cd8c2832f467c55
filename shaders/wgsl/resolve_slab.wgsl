// What is seen of a slab, over the layer behind it; to be blended behind what is in front.
@group(1) @binding(0) var layer: texture_2d<f32>;

@fragment
fn resolve(@builtin(position) position: vec4f) -> @location(0) vec4f {
    frame = frame_settings;
    let color = seen(position.xy);
    return color + (1.0 - color.a) * textureLoad(layer, vec2i(position.xy), 0);
}
