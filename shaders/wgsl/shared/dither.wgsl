// A pixel's threshold: Bayer's matrix of 8 by 8. Where a brick fades in, pixels with lesser thresholds show it, the others what was
// there before. In integers, so that it is the same in all renderers; the twin of `Pixels::threshold` in the pager's draw_list.rs.
fn dither(position: vec2f) -> u32 {
    let y = u32(position.y);
    let z = u32(position.x) ^ y;
    return ((z & 1u) << 5u) | ((y & 1u) << 4u) | ((z & 2u) << 2u) | ((y & 2u) << 1u) | ((z & 4u) >> 1u) | ((y & 4u) >> 2u);
}
