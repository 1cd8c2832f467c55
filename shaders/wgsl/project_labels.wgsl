// The greatest of the labels that are shown. Labels that are hidden hide nothing.
//!import classify extreme
fn accumulate(pixel: Pixel, value: f32, length: f32) -> Pixel {
    if (classify(value).depth <= 0.0) {
        return pixel;
    }
    return Pixel(max(pixel.value, value), 1.0);
}
