// Whether samples with codes in a range can have opacity. `opaque_before` counts the table's entries with opacity before each code.
//!import bindings context
@group(0) @binding(OPAQUE_BEFORE) var<storage, read> opaque_before: array<u32>;

fn has_opacity(range: u32) -> bool {
    let low = FIRST_COUNT + (range & 0xffffu);
    let past = FIRST_COUNT + (range >> 16u) + 1u;
    return opaque_before[low] < opaque_before[past];
}

// Whether a range has codes at all.
fn has_codes(range: u32) -> bool {
    return (range & 0xffffu) <= (range >> 16u);
}
