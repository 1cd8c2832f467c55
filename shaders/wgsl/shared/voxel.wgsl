// Voxels of a slot, and values of their weighted sums: 0 at the transfer table's first code, 1 at its last. Twin of the volume crate's
// `slot_encoding` and `float_slots`.
//!import context frame no_value

const LEAST_SLOT: f32 = -2e38;

// A voxel's difference from the table's first code, or from the first number of f32 slots, and 1; or twice 0 if it has no value. Differences of
// near numbers are exact, so that interpolation is as exact far from zero as near it.
fn voxel(atlas: texture_3d<f32>, place: vec3i) -> vec2f {
    let texel = textureLoad(atlas, place, 0).x;
    // A texel of codes is a share of the greatest; its last bits span many entries of a table over few codes.
    let number = select(round(texel * frame.slot_codes), texel, IS_FLOAT);
    let is_valid = select(!HAS_INVALID || number > 0.5, number > LEAST_SLOT, IS_FLOAT);
    return select(vec2f(0.0), vec2f(number - frame.first_slot, 1.0), is_valid);
}

// The value of weighted sums of voxels; none if missing ones have more than half of the weight.
fn value_of(sums: vec2f) -> f32 {
    // A quotient by 1 is not exact on all GPUs.
    let difference = select(sums.x / max(sums.y, 0.5), sums.x, sums.y == 1.0);
    let value = clamp(difference, -frame.farthest_slots, frame.farthest_slots) * frame.per_slot;
    return select(NO_VALUE, value, sums.y >= 0.5);
}
