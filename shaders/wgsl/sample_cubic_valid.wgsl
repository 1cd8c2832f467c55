// The tricubic B-spline where code 0 means invalid: invalid voxels are left out, and where they hold more than half the weight
// there is no value.
//!import no_value spline

// The weighted sum of a row of voxels along x, and what of the weight is valid.
fn row(atlas: texture_3d<f32>, first: vec3i, weights: vec4f) -> vec2f {
    let a = textureLoad(atlas, first, 0).x;
    let b = textureLoad(atlas, first + vec3i(1, 0, 0), 0).x;
    let c = textureLoad(atlas, first + vec3i(2, 0, 0), 0).x;
    let d = textureLoad(atlas, first + vec3i(3, 0, 0), 0).x;
    let values = vec4f(a, b, c, d);
    let valid = select(vec4f(0.0), weights, values > vec4f(0.0));
    return vec2f(dot(valid, values), dot(valid, vec4f(1.0)));
}

fn sample_valid(atlas: texture_3d<f32>, point: vec3f) -> f32 {
    let corner = floor(point - 0.5);
    let t = point - 0.5 - corner;
    let first = vec3i(corner) - 1;
    let x = spline(t.x);
    let y = spline(t.y);
    let z = spline(t.z);
    var sums = vec2f(0.0);
    // In few rounds: lavapipe gives up on a shader whose loops go round 65,535 times in all.
    for (var k = 0; k < 4; k++) {
        let plane = first + vec3i(0, 0, k);
        sums += z[k] * y.x * row(atlas, plane, x);
        sums += z[k] * y.y * row(atlas, plane + vec3i(0, 1, 0), x);
        sums += z[k] * y.z * row(atlas, plane + vec3i(0, 2, 0), x);
        sums += z[k] * y.w * row(atlas, plane + vec3i(0, 3, 0), x);
    }
    return select(NO_VALUE, sums.x / sums.y, sums.y >= 0.5);
}
