// Whether samples with codes in a range can have opacity. `opaque_before` counts the table's entries with opacity before
// each code.
@group(0) @binding(8) var<storage, read> opaque_before: array<u32>;

fn sees(pixel: Pixel, range: u32) -> bool {
    let low = range & 0xffffu;
    let high = range >> 16u;
    return low <= high && opaque_before[low] < opaque_before[high + 1u];
}
