// Direct volume rendering: emission and absorption, front to back, premultiplied.
//!import classify through

fn accumulate(pixel: Pixel, value: f32, length: f32) -> Pixel {
    let medium = classify(value);
    return add(pixel, medium, medium.color, length);
}
