// The transfer table: one straight (r, g, b, alpha) per code, linear between neighbours.
@group(0) @binding(4) var<storage, read> table: array<vec4f>;

fn classify(value: f32) -> vec4f {
    let position = clamp(value, 0.0, 1.0) * frame.last_entry;
    let entry = min(u32(position), u32(frame.last_entry) - 1u);
    return mix(table[entry], table[entry + 1u], position - f32(entry));
}

// What is left of the light after `length` world units of a medium that takes `alpha` of it per unit distance.
fn transmittance(alpha: f32, length: f32) -> f32 {
    let left = pow(max(1.0 - alpha, 1e-30), length * frame.per_unit_distance);
    return select(left, 0.0, alpha >= 1.0);
}
