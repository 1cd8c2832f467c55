// Every sample there is counts.
fn sees(pixel: Pixel, range: u32) -> bool {
    return (range & 0xffffu) <= (range >> 16u);
}
