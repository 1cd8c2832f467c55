// Weights of four neighbours in a cubic B-spline.
fn spline(t: f32) -> vec4f {
    let s = 1.0 - t;
    return vec4f(s * s * s, 4.0 - 6.0 * t * t + 3.0 * t * t * t, 4.0 - 6.0 * s * s + 3.0 * s * s * s, t * t * t) / 6.0;
}
