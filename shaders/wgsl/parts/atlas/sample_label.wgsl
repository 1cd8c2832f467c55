// Indicators of labels.

// A label's indicator at a point: 1 in texels with the label and 0 in all others, filtered linearly.
fn share_in_atlas(atlas: texture_3d<f32>, point: vec3f, label: f32) -> f32 {
    let corner = floor(point - 0.5);
    let t = point - 0.5 - corner;
    let base = vec3i(corner);
    var sum = 0.0;
    for (var i = 0u; i < 8u; i++) {
        let bit = vec3u(i & 1u, (i >> 1u) & 1u, i >> 2u);
        let side = select(1.0 - t, t, bit == vec3u(1u));
        let found = textureLoad(atlas, base + vec3i(bit), 0).x;
        sum += select(0.0, side.x * side.y * side.z, found == label);
    }
    return sum;
}
