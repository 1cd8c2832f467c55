// The greatest of the labels that are shown, as (label, 1) where there is one, else (0, 0). Labels that are hidden hide nothing.
//!import classify frame
const FIRST_SHARE: f32 = 0.5;

struct Pixel {
    value: f32,
    sampled: f32,
}

fn pixel_start() -> Pixel {
    return Pixel(0.0, 0.0);
}

fn accumulate(pixel: Pixel, value: f32, length: f32) -> Pixel {
    if (classify(value).depth <= 0.0) {
        return pixel;
    }
    return Pixel(max(pixel.value, value), 1.0);
}

fn light_left(pixel: Pixel) -> f32 {
    return 1.0;
}

fn is_final(pixel: Pixel) -> bool {
    return pixel.value >= 1.0;
}

fn pixel_end(pixel: Pixel) -> vec4f {
    return vec4f(pixel.value, pixel.sampled, 0.0, 0.0);
}
