// Rays by compute shader: workgroups of 8 x 8 pixels, side by side in some rows of the picture, or of a part of it. Eight consecutive invocations are 4 x 2
// pixels, and 32 are 8 x 4, so that rays that run together stay together.
//!import bindings cast frame texels

@group(2) @binding(TEXELS) var texels: Texels;

@compute @workgroup_size(64)
fn raycast(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) index: u32) {
    frame = frames[layer];
    let x = (index & 3u) | ((index >> 1u) & 4u);
    let y = ((index >> 2u) & 1u) | ((index >> 3u) & 6u);
    let pixel = 8u * group.xy + vec2u(frame.first_px & 0xffffu, frame.first_px >> 16u) + vec2u(x, y);
    if (all(pixel < textureDimensions(texels))) {
        textureStore(texels, pixel, cast_ray(vec2f(pixel) + 0.5));
    }
}
