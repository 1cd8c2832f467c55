// A pixel's ray with its lattice moved, and what of it is shown.
//!import jitter limits ray

struct Sight {
    ray: Ray,
    // From where to where.
    stretch: vec2f,
    // The distance of the eye, behind which the ray begins.
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
