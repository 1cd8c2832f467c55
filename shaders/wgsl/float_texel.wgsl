// Numbers of f32 slots, and the normalised codes that they become. Twin of the volume crate's `slot_encoding` and `float_slots`.
//!import frame no_value
const LEAST_SLOT: f32 = -2e38;

// How much more than the table's first value a voxel is, and 1; or twice 0 if it has no value. Differences of near numbers are exact, so
// what is far from zero is interpolated as exactly as what is near.
fn float_texel(atlas: texture_3d<f32>, place: vec3i) -> vec2f {
    let number = textureLoad(atlas, place, 0).x;
    return select(vec2f(0.0), vec2f(number - frame.first_slot, 1.0), number > LEAST_SLOT);
}

// The value of weighted sums of such texels.
fn float_value(sums: vec2f) -> f32 {
    let difference = sums.x / max(sums.y, 0.5);
    let value = clamp(difference, -frame.farthest_slots, frame.farthest_slots) * frame.per_slot;
    return select(NO_VALUE, value, sums.y >= 0.5);
}
