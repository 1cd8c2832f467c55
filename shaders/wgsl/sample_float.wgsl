// The value at a point of the atlas (in texels) of 32-bit floats, which no hardware has to filter. Voxels without a value are left out,
// and where they hold more than half the weight there is none.
//!import float_texel

fn sample_float(atlas: texture_3d<f32>, point: vec3f) -> f32 {
    let corner = floor(point - 0.5);
    let t = point - 0.5 - corner;
    let base = vec3i(corner);
    var sums = vec2f(0.0);
    for (var i = 0u; i < 8u; i++) {
        let bit = vec3u(i & 1u, (i >> 1u) & 1u, i >> 2u);
        let side = select(1.0 - t, t, bit == vec3u(1u));
        sums += side.x * side.y * side.z * float_texel(atlas, base + vec3i(bit));
    }
    return float_value(sums);
}
