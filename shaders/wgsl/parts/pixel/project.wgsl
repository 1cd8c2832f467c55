// Maximum and minimum intensity; the minimum is the maximum of 1 - value (`frame.invert` 1).
//!import extreme frame

fn accumulate(pixel: Pixel, value: f32, length: f32) -> Pixel {
    return Pixel(max(pixel.value, abs(frame.invert - clamp(value, 0.0, 1.0))), 1.0);
}
