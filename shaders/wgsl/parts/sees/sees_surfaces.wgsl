// Whether fog or surfaces can be visible with codes in a range.
//!import opaque pixel ranks

fn sees(pixel: Pixel, range: u32) -> bool {
    return has_codes(range) && ((HAS_FOG && has_opacity(range)) || is_passed(pixel.rank, range));
}
