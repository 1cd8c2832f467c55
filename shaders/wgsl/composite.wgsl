// Direct volume rendering: emission and absorption, front to back; premultiplied.
// A ray begins where it enters the volume.
//!import classify frame
const FIRST_SHARE: f32 = 0.0;

struct Pixel {
    color: vec3f,
    transmittance: f32,
}

fn pixel_start() -> Pixel {
    return Pixel(vec3f(0.0), 1.0);
}

fn accumulate(pixel: Pixel, value: f32, length: f32) -> Pixel {
    let medium = classify(value);
    let left = exp2(-medium.depth * length * frame.per_unit_distance);
    let weight = pixel.transmittance * (1.0 - left);
    return Pixel(pixel.color + weight * medium.color, pixel.transmittance * left);
}

fn light_left(pixel: Pixel) -> f32 {
    return pixel.transmittance;
}

// Whatever lies behind adds less than a sixteenth of an 8-bit code.
fn is_final(pixel: Pixel) -> bool {
    return pixel.transmittance < 1.0 / 4096.0;
}

fn pixel_end(pixel: Pixel) -> vec4f {
    return vec4f(pixel.color, 1.0 - pixel.transmittance);
}
