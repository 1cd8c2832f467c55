// Differences of values by the 3D Sobel operator: across two voxels along each axis, about a place with a value.
//!import field neighbour

const IS_STORED: bool = false;

fn value_differences(field: Field, t: f32, middle: f32) -> vec3f {
    let texel = field.origin + field.along * clamp(t, field.reach.x, field.reach.y);
    var sum = vec3f(0.0);
    for (var i = 0u; i < 27u; i++) {
        let offset = vec3f(vec3u(i % 3u, i / 3u % 3u, i / 9u)) - 1.0;
        let smoothed = 0.5 - 0.25 * abs(offset);
        sum += offset * smoothed.yxx * smoothed.zzy * neighbour(field, texel, offset, middle);
    }
    return sum;
}
