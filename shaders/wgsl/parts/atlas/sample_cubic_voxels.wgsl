// Tricubic B-spline of the 64 voxels around a point of the atlas (in texels), voxel by voxel: see `sample_voxels`.
//!import spline voxel

// The weighted sums of a row along x, less those of a row of `middle` alone.
fn row(atlas: texture_3d<f32>, first: vec3i, weights: vec4f, middle: vec2f) -> vec2f {
    let near = weights.x * (voxel(atlas, first) - middle) + weights.y * (voxel(atlas, first + vec3i(1, 0, 0)) - middle);
    let far = weights.z * (voxel(atlas, first + vec3i(2, 0, 0)) - middle) + weights.w * (voxel(atlas, first + vec3i(3, 0, 0)) - middle);
    return near + far;
}

// The weighted sums of a plane, less those of a plane of `middle` alone.
fn plane(atlas: texture_3d<f32>, first: vec3i, x: vec4f, y: vec4f, middle: vec2f) -> vec2f {
    let near = y.x * row(atlas, first, x, middle) + y.y * row(atlas, first + vec3i(0, 1, 0), x, middle);
    let far = y.z * row(atlas, first + vec3i(0, 2, 0), x, middle) + y.w * row(atlas, first + vec3i(0, 3, 0), x, middle);
    return near + far;
}

fn sample_voxels(atlas: texture_3d<f32>, point: vec3f) -> f32 {
    let corner = floor(point - 0.5);
    let t = point - 0.5 - corner;
    let first = vec3i(corner) - 1;
    let x = spline(t.x);
    let y = spline(t.y);
    let z = spline(t.z);
    // Equal voxels yield exactly their value: an expression may compare it.
    let middle = voxel(atlas, vec3i(corner));
    var sums = middle;
    // Unrolled: lavapipe gives up on a shader after 65,535 rounds of loops in all, and a loop here reaches them around the Sobel operator's 27
    // places.
    sums += z.x * plane(atlas, first + vec3i(0, 0, 0), x, y, middle);
    sums += z.y * plane(atlas, first + vec3i(0, 0, 1), x, y, middle);
    sums += z.z * plane(atlas, first + vec3i(0, 0, 2), x, y, middle);
    sums += z.w * plane(atlas, first + vec3i(0, 0, 3), x, y, middle);
    return value_of(sums);
}
