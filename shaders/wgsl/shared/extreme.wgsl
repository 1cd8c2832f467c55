// A projection's sum of samples: the greatest value so far, as (value, 1) if something was sampled, else (0, 0); blended by max over a target
// cleared to zero.
// A ray takes its far half first: from the middle of things it soon finds an extreme, and skips their surroundings before and behind.
const FIRST_SHARE: f32 = 0.5;

struct Pixel {
    value: f32,
    sampled: f32,
}

fn pixel_start() -> Pixel {
    return Pixel(0.0, 0.0);
}

// Nothing hides anything.
fn light_left(pixel: Pixel) -> f32 {
    return 1.0;
}

// Nothing exceeds the end of the scale.
fn is_final(pixel: Pixel) -> bool {
    return pixel.value >= 1.0;
}

fn pixel_end(pixel: Pixel) -> vec4f {
    return vec4f(pixel.value, pixel.sampled, 0.0, 0.0);
}
