// The value at a point of the atlas (in texels), voxel by voxel: of 32-bit floats, which no hardware has to filter; of codes in a narrow window,
// for which its 8 bits of fraction are few; and where voxels may have no value, which are left out.
//!import voxel

fn sample_voxels(atlas: texture_3d<f32>, point: vec3f) -> f32 {
    let corner = floor(point - 0.5);
    let t = point - 0.5 - corner;
    let base = vec3i(corner);
    var sums = vec2f(0.0);
    for (var i = 0u; i < 8u; i++) {
        let bit = vec3u(i & 1u, (i >> 1u) & 1u, i >> 2u);
        let side = select(1.0 - t, t, bit == vec3u(1u));
        sums += side.x * side.y * side.z * voxel(atlas, base + vec3i(bit));
    }
    return value_of(sums);
}
