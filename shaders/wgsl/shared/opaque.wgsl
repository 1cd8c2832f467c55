// Whether samples with codes in a range can have opacity. `opaque_before` counts the opaque places of the table before each; a place is a code
// or lies between two. Twin of the volume crate's `OpaqueCodes`.
//!import bindings context counted frame

@group(0) @binding(OPAQUE_BEFORE) var<storage, read> opaque_before: array<u32>;

fn has_opacity(range: u32) -> bool {
    let low = FIRST_COUNT + count_at(range & 0xffffu);
    let past = FIRST_COUNT + count_at(range >> 16u) + 1u;
    return opaque_before[low] < opaque_before[past];
}

fn count_at(code: u32) -> u32 {
    return u32(clamp(counted(code), 0.0, frame.last_code)) * frame.counts_per_code;
}

// Whether a range has codes at all.
fn has_codes(range: u32) -> bool {
    return (range & 0xffffu) <= (range >> 16u);
}
