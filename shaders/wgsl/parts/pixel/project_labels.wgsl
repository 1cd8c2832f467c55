// The greatest visible label; hidden labels hide nothing.
//!import colors extreme

fn accumulate(pixel: Pixel, value: f32, length: f32) -> Pixel {
    if (!is_shown(value)) {
        return pixel;
    }
    return Pixel(max(pixel.value, value), 1.0);
}
