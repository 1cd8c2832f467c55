// A brick's field along a ray, for segments evaluated from end to end.
//!import atlas frame no_value ray

// A ray's line through a brick in the atlas: texel = origin + along * t.
struct Field {
    origin: vec3f,
    along: vec3f,
    // Texels per level-0 voxel.
    scale: vec3f,
    // Bounds of its slot for samples that touch no other slot: in texels, and on the ray.
    low: vec3f,
    high: vec3f,
    reach: vec2f,
}

// The field of the brick with `point` in its core; texel = voxel * scale + offset.
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

// The value at the nearest place in the brick.
fn inside(field: Field, t: f32) -> f32 {
    return value_at(field, clamp(t, field.reach.x, field.reach.y));
}

// World length per voxel along the ray's fastest axis.
fn voxel_length(ray: Ray, scale: vec3f) -> f32 {
    let along = abs(ray.direction * scale);
    return 1.0 / max(max(along.x, along.y), along.z);
}

// How far a segment of `stride` ticks may reach out of its brick, less the half voxel covered by ranges of codes.
fn overhang(ray: Ray, scale: vec3f, stride: u32) -> f32 {
    return max(0.5 * (f32(stride) * frame.step - voxel_length(ray, scale)), 0.0);
}
