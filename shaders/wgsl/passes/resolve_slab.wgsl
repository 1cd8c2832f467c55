// A slab's colours over the layer behind it, to be blended behind everything in front.
//!import bindings frame fullscreen seen

@group(1) @binding(LAYER_COLOR) var layer_color: texture_2d<f32>;

@fragment
fn resolve(@builtin(position) position: vec4f) -> @location(0) vec4f {
    frame = frames[layer];
    let color = seen(position.xy);
    return color + (1.0 - color.a) * textureLoad(layer_color, vec2i(position.xy), 0);
}
