// Every sample there is counts.
//!import pixel

fn sees(pixel: Pixel, range: u32) -> bool {
    return (range & 0xffffu) <= (range >> 16u);
}
