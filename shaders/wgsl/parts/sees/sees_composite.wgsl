// Whether fog can be visible with codes in a range.
//!import opaque pixel

fn sees(pixel: Pixel, range: u32) -> bool {
    return has_codes(range) && has_opacity(range);
}
