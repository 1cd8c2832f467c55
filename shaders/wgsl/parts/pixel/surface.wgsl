// Isosurface: the first place where a ray passes the threshold, opaque, lit from the eye. The rule is documented with its CPU twin, the volume
// crate's `surface`.
//!import cut_face field frame lighting no_value search sight

// A ray begins where it enters the volume.
const FIRST_SHARE: f32 = 0.0;

struct Pixel {
    // 1 before the surface, then 0.
    transmittance: f32,
    // The ray's side: 1 inside, -1 outside, 0 unknown. `AT_CUT` is unknown before a first place that may be on a cap: it meets an inside as from
    // outside.
    side: f32,
    // The piece of the ray with the surface; without length for a cap.
    start: f32,
    end: f32,
}

const AT_CUT: f32 = -0.5;

fn pixel_start() -> Pixel {
    return Pixel(1.0, 0.0, 0.0, 0.0);
}

// The pixel before the first place of the ray's stretch.
fn pixel_before(seen: Sight) -> Pixel {
    met.cut = cut_face(seen.ray, seen.eye);
    var pixel = pixel_start();
    pixel.side = select(0.0, AT_CUT, is_at_cut(seen.stretch.x));
    return pixel;
}

// The pixel at the start of the first segment: on a cap if the first place, right behind a cut, is inside.
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

// Searches a segment for the surface, as far as the field can be sampled.
fn search(before: Pixel, field: Field, segment_start: f32, segment_end: f32) -> Pixel {
    let start = max(segment_start, field.reach.x);
    let end = min(segment_end, field.reach.y);
    let value = value_at(field, max(end, field.reach.x));
    let is_there = start < end;
    let side = select(before.side, side_of(value), is_there);
    let is_crossed = before.side * side < 0.0;
    return Pixel(select(before.transmittance, 0.0, is_crossed), side, start, end);
}

// The pixel of a ray after its end in the field or a miss.
fn pixel_in(pixel: Pixel, field: Field, ray: Ray) -> vec4f {
    if (is_final(pixel)) {
        let t = locate(field, pixel.start, pixel.end, frame.threshold, pixel.side > 0.0);
        return vec4f(lit(field, ray, t, pixel.start == pixel.end), 1.0);
    }
    return vec4f(0.0);
}

// The difference of the values a voxel to each side, or as far as the field goes. A place without a value counts as the surface.
fn difference(field: Field, texel: vec3f, axis: vec3f) -> f32 {
    let low = max(texel - axis, field.low);
    let high = min(texel + axis, field.high);
    let before = smooth_atlas(low);
    let after = smooth_atlas(high);
    let change = select(frame.threshold, after, has_value(after)) - select(frame.threshold, before, has_value(before));
    return change * 2.0 / dot(high - low, axis);
}

// The lit colour of the surface at a place, or of a cap, under the cut's normal.
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
