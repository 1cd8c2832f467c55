// Isosurfaces: the first place where a ray passes the threshold, opaque, lit from the eye. The rule is written down beside its
// CPU twin, the volume crate's `surface`.
//!import cut_face field frame lighting no_value search sight

struct Pixel {
    // 1 before the surface, then 0.
    transmittance: f32,
    // Which one the ray is on: 1 inside, -1 outside, 0 not known, `AT_CUT` not known of a ray whose first place may be on a cap: as from outside,
    // it meets what is inside.
    side: f32,
    // The piece of the ray with the surface; a cap's has no length.
    start: f32,
    end: f32,
}

const AT_CUT: f32 = -0.5;

fn pixel_start() -> Pixel {
    return Pixel(1.0, 0.0, 0.0, 0.0);
}

// Before the first place of what is seen.
fn pixel_before(seen: Sight) -> Pixel {
    met.cut = cut_face(seen.ray, seen.eye);
    var pixel = pixel_start();
    pixel.side = select(0.0, AT_CUT, is_at_cut(seen.stretch.x));
    return pixel;
}

// At the start of the first segment that is looked at: on a cap, if that is inside, at the first place behind a cut.
fn begin(before: Pixel, field: Field, start: f32, first: f32) -> Pixel {
    let place = max(start, field.reach.x);
    let side = side_of(value_at(field, place));
    let is_cap = before.side == AT_CUT && side > 0.0 && place <= first;
    return Pixel(select(before.transmittance, 0.0, is_cap), side, start, start);
}

fn light_left(pixel: Pixel) -> f32 {
    return pixel.transmittance;
}

fn is_final(pixel: Pixel) -> bool {
    return pixel.transmittance == 0.0;
}

fn side_of(value: f32) -> f32 {
    return select(0.0, select(-1.0, 1.0, value >= frame.threshold), has_value(value));
}

// Looks for the surface in a segment, as far as the field can be sampled.
fn search(before: Pixel, field: Field, segment_start: f32, segment_end: f32) -> Pixel {
    let start = max(segment_start, field.reach.x);
    let end = min(segment_end, field.reach.y);
    let value = value_at(field, max(end, field.reach.x));
    let is_there = start < end;
    let side = select(before.side, side_of(value), is_there);
    let is_crossed = before.side * side < 0.0;
    return Pixel(select(before.transmittance, 0.0, is_crossed), side, start, end);
}

// The pixel of a ray that ended in the field, or met nothing.
fn pixel_in(pixel: Pixel, field: Field, ray: Ray) -> vec4f {
    if (is_final(pixel)) {
        let t = locate(field, pixel.start, pixel.end, frame.threshold, pixel.side > 0.0);
        return vec4f(lit(field, ray, t, pixel.start == pixel.end), 1.0);
    }
    return vec4f(0.0);
}

// The difference of the values a voxel to each side, or as far as the field goes. A place without a value is as good as the
// surface.
fn difference(field: Field, texel: vec3f, axis: vec3f) -> f32 {
    let low = max(texel - axis, field.low);
    let high = min(texel + axis, field.high);
    let before = smooth_atlas(low);
    let after = smooth_atlas(high);
    let change = select(frame.threshold, after, has_value(after)) - select(frame.threshold, before, has_value(before));
    return change * 2.0 / dot(high - low, axis);
}

// The surface's colour at a place, or a cap's, which the cut lights.
fn lit(field: Field, ray: Ray, t: f32, is_cap: bool) -> vec3f {
    let texel = clamp(field.origin + field.along * t, field.low, field.high);
    let differences = vec3f(
        difference(field, texel, vec3f(1.0, 0.0, 0.0)),
        difference(field, texel, vec3f(0.0, 1.0, 0.0)),
        difference(field, texel, vec3f(0.0, 0.0, 1.0)),
    );
    if (!is_cap && length(differences) < max(frame.flat, FLAT_SHARE * abs(frame.threshold))) {
        return (AMBIENT + DIFFUSE) * frame.surface_color;
    }
    // In the volume's own world, of any length.
    let gradient = select(differences * field.scale, met.cut.xyz, is_cap) / frame.spacing;
    let cosine = min(abs(dot(normalize(gradient), ray.direction * frame.spacing)), 1.0);
    return (AMBIENT + DIFFUSE * cosine) * frame.surface_color + SPECULAR * tenth_power(cosine);
}
