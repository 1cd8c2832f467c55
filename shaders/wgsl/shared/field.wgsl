// The field of a brick along a ray, for what looks at segments from end to end.
//!import atlas frame no_value ray

// A ray's way through a brick in the atlas: texel = origin + along * t.
struct Field {
    origin: vec3f,
    along: vec3f,
    // Texels per level-0 voxel.
    scale: vec3f,
    // Where its slot can be sampled without touching another, in texels, and on the ray.
    low: vec3f,
    high: vec3f,
    reach: vec2f,
}

// Through the brick whose core holds `point`, with texel = voxel * scale + offset.
fn field_about(point: vec3f, scale: vec3f, offset: vec3f, ray: Ray) -> Field {
    let slot = floor((point * scale + offset) / frame.slot_edge) * frame.slot_edge;
    let low = slot + MARGIN;
    let high = slot + frame.slot_edge - MARGIN;
    let reach = clip(ray, (low - offset) / scale, (high - offset) / scale);
    return Field(ray.origin * scale + offset, ray.direction * scale, scale, low, high, reach);
}

// `NO_VALUE` where there is none.
fn value_at(field: Field, t: f32) -> f32 {
    return sample_atlas(field.origin + field.along * t);
}

// The same at the next place that the brick has.
fn inside(field: Field, t: f32) -> f32 {
    return value_at(field, clamp(t, field.reach.x, field.reach.y));
}

// World length over which the ray moves a voxel along the axis along which it is fastest.
fn voxel_length(ray: Ray, scale: vec3f) -> f32 {
    let along = abs(ray.direction * scale);
    return 1.0 / max(max(along.x, along.y), along.z);
}

// How far a segment of so many ticks may reach out of the brick that owns it, less half a voxel: as far as ranges of codes hold.
fn overhang(ray: Ray, scale: vec3f, stride: u32) -> f32 {
    return max(0.5 * (f32(stride) * frame.step - voxel_length(ray, scale)), 0.0);
}
