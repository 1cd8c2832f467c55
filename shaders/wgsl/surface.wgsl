// Isosurfaces: the first place where a ray passes the threshold, opaque, lit from the eye. The rule is written down beside its
// CPU twin, the volume crate's `surface`.
//!import field frame lighting
const SEARCH_PARTS: u32 = 8u;
const ROUNDS: u32 = 2u;

struct Pixel {
    // 1 before the surface, then 0.
    transmittance: f32,
    // Which one the ray is on: 1 inside, -1 outside, 0 not known.
    side: f32,
    // The piece of the ray with the surface, and the value at its end.
    start: f32,
    end: f32,
    value: f32,
}

fn pixel_start() -> Pixel {
    return Pixel(1.0, 0.0, 0.0, 0.0, 0.0);
}

fn light_left(pixel: Pixel) -> f32 {
    return pixel.transmittance;
}

fn is_final(pixel: Pixel) -> bool {
    return pixel.transmittance == 0.0;
}

fn side_of(value: f32) -> f32 {
    return select(select(-1.0, 1.0, value >= frame.threshold), 0.0, value < 0.0);
}

// Looks for the surface in a segment, as far as the field can be sampled.
fn search(before: Pixel, field: Field, segment_start: f32, segment_end: f32) -> Pixel {
    let start = max(segment_start, field.reach.x);
    let end = min(segment_end, field.reach.y);
    let value = value_at(field, max(end, field.reach.x));
    let is_there = start < end;
    let side = select(before.side, side_of(value), is_there);
    let is_crossed = before.side * side < 0.0;
    return Pixel(select(before.transmittance, 0.0, is_crossed), side, start, end, value);
}

// The pixel of a ray that ended in the field, or met nothing.
fn pixel_in(pixel: Pixel, field: Field, ray: Ray) -> vec4f {
    if (is_final(pixel)) {
        return vec4f(lit(field, ray, locate(field, pixel)), 1.0);
    }
    return vec4f(0.0);
}

// Where in its piece of the ray the surface is. (All parts are sampled: to leave loops early where rays
// part ways is what software rasterisers are slowest at.)
fn locate(field: Field, pixel: Pixel) -> f32 {
    var near = pixel.start;
    var far = pixel.end;
    var near_value = pixel.value;
    var far_value = pixel.value;
    for (var round = 0u; round < ROUNDS; round++) {
        let first = near;
        let part = (far - near) / f32(SEARCH_PARTS);
        var is_past = false;
        for (var k = 0u; k < SEARCH_PARTS; k++) {
            let t = first + f32(k) * part;
            let value = value_at(field, t);
            let is_first_past = !is_past && side_of(value) == pixel.side;
            far = select(far, t, is_first_past);
            far_value = select(far_value, value, is_first_past);
            is_past = is_past || is_first_past;
            // If the first place is past it already, the brick before saw it on the other side there.
            near = select(t, near, is_past);
            near_value = select(select(value, pixel.value, value < 0.0), near_value, is_past);
        }
    }
    let share = (frame.threshold - near_value) / (far_value - near_value);
    return select(near + (far - near) * clamp(share, 0.0, 1.0), far, far_value == near_value);
}

// The difference of the values a voxel to each side, or as far as the field goes. A place without a value is as good as the
// surface.
fn difference(field: Field, texel: vec3f, axis: vec3f) -> f32 {
    let low = max(texel - axis, field.low);
    let high = min(texel + axis, field.high);
    let before = sample_atlas(low);
    let after = sample_atlas(high);
    let change = select(after, frame.threshold, after < 0.0) - select(before, frame.threshold, before < 0.0);
    return change * 2.0 / dot(high - low, axis);
}

// The surface's colour at a place.
fn lit(field: Field, ray: Ray, t: f32) -> vec3f {
    let texel = clamp(field.origin + field.along * t, field.low, field.high);
    let differences = vec3f(
        difference(field, texel, vec3f(1.0, 0.0, 0.0)),
        difference(field, texel, vec3f(0.0, 1.0, 0.0)),
        difference(field, texel, vec3f(0.0, 0.0, 1.0)),
    );
    if (length(differences) * frame.last_code < FLAT_CODES) {
        return (AMBIENT + DIFFUSE) * frame.surface_color;
    }
    let gradient = normalize(differences * field.scale / frame.spacing);
    let cosine = min(abs(dot(gradient, ray.direction * frame.spacing)), 1.0);
    return (AMBIENT + DIFFUSE * cosine) * frame.surface_color + SPECULAR * pow(cosine, SPECULAR_POWER);
}
