// Length-weighted sum of the values, and sum of lengths.
// A ray begins where it enters the volume.
const FIRST_SHARE: f32 = 0.0;

struct Pixel {
    sum: f32,
    length: f32,
}

fn pixel_start() -> Pixel {
    return Pixel(0.0, 0.0);
}

fn accumulate(pixel: Pixel, value: f32, length: f32) -> Pixel {
    return Pixel(pixel.sum + value * length, pixel.length + length);
}

// Nothing hides anything.
fn light_left(pixel: Pixel) -> f32 {
    return 1.0;
}

fn is_final(pixel: Pixel) -> bool {
    return false;
}

fn pixel_end(pixel: Pixel) -> vec4f {
    return vec4f(pixel.sum, pixel.length, 0.0, 0.0);
}
