// A pixel's ray with its lattice moved, and its shown stretch.
//!import jitter limits ray

struct Sight {
    ray: Ray,
    // From and to.
    stretch: vec2f,
    // Distance from the ray's origin to the eye.
    eye: f32,
}

fn sight(position: vec2f) -> Sight {
    let ray = pixel_ray(position);
    let whole = shown(ray);
    let stretch = limited(whole, position);
    let shift = jitter_shift(whole, position);
    if (shift == 0.0) {
        return Sight(ray, stretch, 0.0);
    }
    return Sight(Ray(ray.origin - ray.direction * shift, ray.direction, ray.inverse), stretch + shift, shift);
}
