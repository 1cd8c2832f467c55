// No surfaces: a segment is only fog.
//!import medium

fn take(before: Pixel, known: Known, field: Field, ray: Ray, start: f32, end: f32) -> Taken {
    return take_fog(before, known, field, ray, start, end);
}
