// Whether samples with codes in a range can beat the extreme so far.
//!import counted frame pixel

fn sees(pixel: Pixel, range: u32) -> bool {
    let low = range & 0xffffu;
    let high = range >> 16u;
    let best = select(counted(high), frame.last_code - counted(low), frame.invert > 0.0);
    return low <= high && (pixel.sampled == 0.0 || best > pixel.value * frame.last_code);
}
