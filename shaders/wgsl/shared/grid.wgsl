// Transfer table of values and gradient magnitudes, looked up bilinearly. The rule is documented with its CPU twin, the volume crate's
// `TransferGrid`.
//!import classify frame

const GRID_COLUMNS: u32 = 256u;
// As in the table of values: opaque, and finite.
const OPAQUE: f32 = 1e30;

// An entry's straight colour and opacity.
fn grid_entry(index: u32) -> vec4f {
    let place = table[FIRST_PLACE + index];
    return vec4f(color_of(place.x), bitcast<f32>(place.y));
}

// The medium at a value with these differences of values across two voxels, for `texel_scale` texels per level-0 voxel.
fn classify_by_gradient(value: f32, differences: vec3f, texel_scale: vec3f) -> Medium {
    let gradient = length(differences * texel_scale / frame.spacing);
    let row = clamp((value * frame.last_code - frame.grid.x) * frame.grid.y, 0.0, frame.grid.w);
    let column = clamp(gradient * frame.grid.z, 0.0, f32(GRID_COLUMNS - 1u));
    let first_row = min(floor(row), frame.grid.w - 1.0);
    let first_column = min(floor(column), f32(GRID_COLUMNS - 2u));
    let at = frame.grid_at + u32(first_row) * GRID_COLUMNS + u32(first_column);
    let a = grid_entry(at);
    let b = grid_entry(at + 1u);
    let c = grid_entry(at + GRID_COLUMNS);
    let d = grid_entry(at + GRID_COLUMNS + 1u);
    let s = row - first_row;
    let t = column - first_column;
    // Written to keep four equal values exact.
    let low = a.w + t * (b.w - a.w);
    let high = c.w + t * (d.w - c.w);
    let alpha = low + s * (high - low);
    if (alpha <= 0.0) {
        return Medium(vec3f(0.0), 0.0);
    }
    let weights = vec4f((1.0 - s) * (1.0 - t), (1.0 - s) * t, s * (1.0 - t), s * t) * vec4f(a.w, b.w, c.w, d.w);
    let color = weights.x * a.rgb + weights.y * b.rgb + weights.z * c.rgb + weights.w * d.rgb;
    let depth = select(-log2(max(1.0 - alpha, 1e-30)), OPAQUE, alpha >= 1.0);
    return Medium(color / dot(weights, vec4f(1.0)), depth);
}

