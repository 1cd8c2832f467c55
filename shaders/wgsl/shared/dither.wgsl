// A pixel's threshold, by Bayer's matrix of 8 by 8. Where a brick fades in, pixels with lesser thresholds show it, the others its
// predecessor. In integers, for the same result in all renderers; twin of `PixelShare::threshold` in the pager's dither.rs.
fn dither(position: vec2f) -> u32 {
    let y = u32(position.y);
    let z = u32(position.x) ^ y;
    return ((z & 1u) << 5u) | ((y & 1u) << 4u) | ((z & 2u) << 2u) | ((y & 2u) << 1u) | ((z & 4u) >> 1u) | ((y & 4u) >> 2u);
}
