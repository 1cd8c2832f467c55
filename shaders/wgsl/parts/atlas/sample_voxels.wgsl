// The value at a point of the atlas (in texels), voxel by voxel: of 32-bit floats, which no hardware has to filter; of codes in a narrow window,
// for which its 8 bits of fraction are few; and where voxels may have no value, which are left out.
//!import voxel

// Weighted sums between two others. Where both are alike it is just that: an expression may compare it.
fn between(near: vec2f, far: vec2f, share: f32) -> vec2f {
    return near + share * (far - near);
}

// The weighted sums between a voxel and the next one along x.
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
