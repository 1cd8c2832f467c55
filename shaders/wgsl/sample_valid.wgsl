// The value at a point of the atlas (in texels) where code 0 means invalid: invalid corners are left out, and where they
// hold more than half the weight there is no value.
//!import no_value

fn sample_valid(atlas: texture_3d<f32>, point: vec3f) -> f32 {
    let corner = floor(point - 0.5);
    let t = point - 0.5 - corner;
    let base = vec3i(corner);
    var sum = 0.0;
    var weight = 0.0;
    for (var i = 0u; i < 8u; i++) {
        let bit = vec3u(i & 1u, (i >> 1u) & 1u, i >> 2u);
        let side = select(1.0 - t, t, bit == vec3u(1u));
        let value = textureLoad(atlas, base + vec3i(bit), 0).x;
        let share = select(0.0, side.x * side.y * side.z, value > 0.0);
        sum += share * value;
        weight += share;
    }
    return select(NO_VALUE, sum / weight, weight >= 0.5);
}
