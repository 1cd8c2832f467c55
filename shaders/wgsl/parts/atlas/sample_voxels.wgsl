// The atlas's value at a point (in texels), voxel by voxel: for 32-bit floats, which hardware need not filter; for codes in a narrow window,
// where the hardware's 8 bits of fraction are too few; and for fields with missing values, which are left out.
//!import voxel

// Interpolates weighted sums. Equal ones yield exactly themselves: an expression may compare them.
fn between(near: vec2f, far: vec2f, share: f32) -> vec2f {
    return near + share * (far - near);
}

// The weighted sums between a voxel and the next along x.
fn line(atlas: texture_3d<f32>, first: vec3i, share: f32) -> vec2f {
    return between(voxel(atlas, first), voxel(atlas, first + vec3i(1, 0, 0)), share);
}

fn sample_voxels(atlas: texture_3d<f32>, point: vec3f) -> f32 {
    let corner = floor(point - 0.5);
    let t = point - 0.5 - corner;
    let base = vec3i(corner);
    let near = between(line(atlas, base, t.x), line(atlas, base + vec3i(0, 1, 0), t.x), t.y);
    let far = between(line(atlas, base + vec3i(0, 0, 1), t.x), line(atlas, base + vec3i(0, 1, 1), t.x), t.y);
    return value_of(between(near, far, t.z));
}
