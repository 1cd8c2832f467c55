// The tricubic B-spline of an atlas of 32-bit floats: voxels without a value are left out, and where they hold more than half the weight
// there is none.
//!import float_texel spline

// The weighted sums of a row along x.
fn float_row(atlas: texture_3d<f32>, first: vec3i, weights: vec4f) -> vec2f {
    let near = weights.x * float_texel(atlas, first) + weights.y * float_texel(atlas, first + vec3i(1, 0, 0));
    let far = weights.z * float_texel(atlas, first + vec3i(2, 0, 0)) + weights.w * float_texel(atlas, first + vec3i(3, 0, 0));
    return near + far;
}

fn sample_float(atlas: texture_3d<f32>, point: vec3f) -> f32 {
    let corner = floor(point - 0.5);
    let t = point - 0.5 - corner;
    let first = vec3i(corner) - 1;
    let x = spline(t.x);
    let y = spline(t.y);
    let z = spline(t.z);
    var sums = vec2f(0.0);
    // In few rounds: see `sample_cubic_valid`.
    for (var k = 0; k < 4; k++) {
        let plane = first + vec3i(0, 0, k);
        sums += z[k] * y.x * float_row(atlas, plane, x);
        sums += z[k] * y.y * float_row(atlas, plane + vec3i(0, 1, 0), x);
        sums += z[k] * y.z * float_row(atlas, plane + vec3i(0, 2, 0), x);
        sums += z[k] * y.w * float_row(atlas, plane + vec3i(0, 3, 0), x);
    }
    return float_value(sums);
}
