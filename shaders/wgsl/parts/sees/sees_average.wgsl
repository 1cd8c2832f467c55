// Every sample counts.
//!import pixel

fn sees(pixel: Pixel, range: u32) -> bool {
    return (range & 0xffffu) <= (range >> 16u);
}
