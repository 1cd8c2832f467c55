// Whether samples with codes in a range can pass the extreme found so far.
//!import frame pixel
fn sees(pixel: Pixel, range: u32) -> bool {
    let low = range & 0xffffu;
    let high = range >> 16u;
    let best = select(f32(high), frame.last_code - f32(low), frame.invert > 0.0);
    return low <= high && (pixel.sampled == 0.0 || best > pixel.value * frame.last_code);
}
