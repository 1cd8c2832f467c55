// Whether the surface can be where codes are in a range: they are on both sides of it, or not on the ray's side.
//!import anything frame pixel

fn sees(pixel: Pixel, range: u32) -> bool {
    let low = f32(range & 0xffffu);
    let high = f32(range >> 16u);
    let threshold = frame.threshold_code;
    let side = select(select(0.0, -1.0, high < threshold), 1.0, low >= threshold);
    return range == ANYTHING || (low <= high && pixel.side * side <= 0.0 && (side == 0.0 || pixel.side != 0.0));
}
