// Differences across two voxels along each axis, about a place with a value: of values, or, for labels, of the indicator of the label there, with
// the height of one code.
//!import atlas context field frame gradient lighting

fn differences(field: Field, t: f32, middle: f32) -> vec3f {
    if (!IS_LABELS) {
        let found = value_differences(field, t, middle);
        let least = FLAT_SHARE * middle;
        let is_flat = !IS_STORED && dot(found, found) < least * least;
        return select(found, vec3f(0.0), is_flat);
    }
    let texel = field.origin + field.along * clamp(t, field.reach.x, field.reach.y);
    let low = vec3f(
        share_at(field, texel - vec3f(1.0, 0.0, 0.0), middle),
        share_at(field, texel - vec3f(0.0, 1.0, 0.0), middle),
        share_at(field, texel - vec3f(0.0, 0.0, 1.0), middle),
    );
    let high = vec3f(
        share_at(field, texel + vec3f(1.0, 0.0, 0.0), middle),
        share_at(field, texel + vec3f(0.0, 1.0, 0.0), middle),
        share_at(field, texel + vec3f(0.0, 0.0, 1.0), middle),
    );
    return (high - low) / frame.last_code;
}

// A label's share around a texel, or around the nearest one in the brick.
fn share_at(field: Field, texel: vec3f, label: f32) -> f32 {
    return share_of_label(clamp(texel, field.low, field.high), label);
}
