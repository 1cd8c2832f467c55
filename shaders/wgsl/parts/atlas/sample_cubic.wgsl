// Tricubic B-spline of the 64 texels around a point of the atlas, in eight of the hardware's trilinear samples (Sigg and
// Hadwiger, Fast Third-Order Texture Filtering, GPU Gems 2, 2005). Never negative.
//!import frame sampler

fn sample_full(atlas: texture_3d<f32>, point: vec3f) -> f32 {
    let corner = floor(point - 0.5);
    let t = point - 0.5 - corner;
    let s = 1.0 - t;
    // Weights of the outer voxels and of each pair along an axis.
    let first = s * s * s / 6.0;
    let last = t * t * t / 6.0;
    let far = (4.0 - 6.0 * s * s + 3.0 * s * s * s) / 6.0 + last;
    let near = 1.0 - far;
    // Points at which the hardware's filter gives both texels of a pair their weights.
    let low = (corner - 0.5 + (near - first) / near) * frame.texel;
    let high = (corner + 1.5 + last / far) * frame.texel;
    var planes: vec2f;
    for (var k = 0u; k < 2u; k++) {
        let z = select(low.z, high.z, k == 1u);
        let a = textureSampleLevel(atlas, atlas_sampler, vec3f(low.xy, z), 0.0).x;
        let b = textureSampleLevel(atlas, atlas_sampler, vec3f(high.x, low.y, z), 0.0).x;
        let c = textureSampleLevel(atlas, atlas_sampler, vec3f(low.x, high.y, z), 0.0).x;
        let d = textureSampleLevel(atlas, atlas_sampler, vec3f(high.xy, z), 0.0).x;
        planes[k] = (a * near.x + b * far.x) * near.y + (c * near.x + d * far.x) * far.y;
    }
    return planes.x * near.z + planes.y * far.z;
}
