// A ray's pixel, composited front to back.
//!import classify frame

// A ray begins where it enters the volume.
const FIRST_SHARE: f32 = 0.0;

struct Pixel {
    color: vec3f,
    transmittance: f32,
    // Number of surfaces behind the ray; negative if unknown.
    rank: i32,
}

fn pixel_start() -> Pixel {
    return Pixel(vec3f(0.0), 1.0, -1);
}

fn add(pixel: Pixel, medium: Medium, color: vec3f, length: f32) -> Pixel {
    let left = exp2(-medium.depth * length * frame.per_unit_distance);
    return Pixel(pixel.color + pixel.transmittance * (1.0 - left) * color, pixel.transmittance * left, pixel.rank);
}

fn light_left(pixel: Pixel) -> f32 {
    return pixel.transmittance;
}

// Everything behind adds less than a sixteenth of an 8-bit code.
fn is_final(pixel: Pixel) -> bool {
    return pixel.transmittance < 1.0 / 4096.0;
}

fn pixel_end(pixel: Pixel) -> vec4f {
    return vec4f(pixel.color, 1.0 - pixel.transmittance);
}
