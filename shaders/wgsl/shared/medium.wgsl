// Direct volume rendering by every method but the plain one: segments become media. The rules are documented with their CPU
// twins, the volume crate's `sampling`, `preintegration` and `lighting`. Code ruled out by `CURVE`, `PARTS`,
// `IS_PRE_INTEGRATED`, `LIGHTING`, `HAS_FOG` and `HAS_GRID` is not part of the compiled shader.
//!import classify context cut_face differences field grid no_value pixel shade world

// Values of CURVE.
const MIDDLE: u32 = 0u;
const LINE: u32 = 1u;
const CUBIC: u32 = 2u;
const FIELD: u32 = 3u;

const MOST_PARTS: u32 = 8u;
const CLOSE_CODES: f32 = 0.015625;
const MAX_DEPTH: f32 = 4096.0;

// The known field about a segment: values a segment's length before it, at its ends, and after it, `NO_VALUE` where there is
// none; and the gradients computed so far (see `differences`), a bit each.
struct Known {
    values: vec4f,
    length: f32,
    gradients: u32,
    g0: vec3f,
    g1: vec3f,
    g2: vec3f,
    g3: vec3f,
}

fn known_of(field: Field, start: f32, end: f32) -> Known {
    var known: Known;
    known.length = end - start;
    if (CURVE != MIDDLE) {
        known.values.y = inside(field, start);
        known.values.z = inside(field, end);
    }
    if (CURVE == CUBIC) {
        known.values.x = inside(field, start - known.length);
        known.values.w = inside(field, end + known.length);
    }
    return known;
}

// The known field of the next segment, or of a first one (length 0 before it). For a segment of equal length only the last value
// is new.
fn known_next(before: Known, field: Field, start: f32, end: f32) -> Known {
    let length = end - start;
    if (before.length == 0.0 || (CURVE == CUBIC && abs(length - before.length) > 1e-3 * length)) {
        return known_of(field, start, end);
    }
    var known = before;
    known.length = length;
    if (CURVE == LINE || CURVE == FIELD) {
        known.values.y = before.values.z;
        known.values.z = inside(field, end);
    }
    if (CURVE == CUBIC) {
        known.values = vec4f(before.values.yzw, inside(field, end + length));
        known.g0 = before.g1;
    }
    known.g1 = before.g2;
    known.g2 = before.g3;
    known.gradients = select(before.gradients >> 1u & 2u, before.gradients >> 1u, CURVE == CUBIC);
    return known;
}

// A colour lit at a place of the ray; `share` is the met cut's share of the normal.
fn shade(lighting: u32, field: Field, ray: Ray, t: f32, color: vec3f, differences: vec3f, share: f32) -> vec3f {
    let is_flat = length(differences) < frame.flat;
    let view = to_world(ray.direction);
    var normal = normal_of(gradient_to_world(differences * field.scale), view);
    if (share > 0.0) {
        normal = cut_normal(share, is_flat, normal, view);
    }
    let place = to_world(ray.origin + ray.direction * t);
    return lit(lighting, frame.lights, color, is_flat && share <= 0.0, normal, view, place);
}

// The running integral of one of four channels up to an entry: 64 bits in two words.
fn sum_at(entry: u32, channel: u32) -> vec2u {
    return table[FIRST_PLACE + u32(frame.last_place) + 1u + entry * 4u + channel];
}

fn left_integral(left: f32) -> f32 {
    return left * log(max(left, 1e-30)) - left;
}

// The integral past an entry, over the first `t` of the way to the next.
fn rest_of(entry: u32, t: f32) -> vec4f {
    let places = frame.last_place / frame.last_entry;
    let a = medium_at(u32(f32(entry) * places + 0.5));
    let b = medium_at(u32((f32(entry) + 1.0) * places + 0.5));
    // Transmittance; opacity is linear from entry to entry.
    let before = exp2(-a.depth);
    let slope = before - exp2(-b.depth);
    var depth = t * min(-log2(max(before - 0.5 * t * slope, 1e-30)), MAX_DEPTH);
    if (abs(slope) > 1e-3) {
        depth = (left_integral(before - t * slope) - left_integral(before)) / (slope * 0.6931472);
    }
    return vec4f(mix(a.color, b.color, 0.5 * t) * depth, depth);
}

// The integral past the table's ends between two places in entries: the end's medium goes on there.
fn beyond(low: f32, high: f32) -> vec4f {
    let before = max(min(high, 0.0) - low, 0.0);
    let behind = max(high - max(low, frame.last_entry), 0.0);
    let first = medium_at(0u);
    let last = medium_at(u32(frame.last_place));
    let depths = vec2f(before, behind) * min(vec2f(first.depth, last.depth), vec2f(MAX_DEPTH));
    return vec4f(first.color * depths.x + last.color * depths.y, depths.x + depths.y);
}

// The mean medium between two values.
fn mean_medium(one: f32, other: f32) -> Medium {
    let least = min(one, other) * frame.last_entry;
    let greatest = max(one, other) * frame.last_entry;
    if (greatest - least < CLOSE_CODES) {
        return classify(0.5 * (one + other));
    }
    let low = clamp(least, 0.0, frame.last_entry);
    let high = clamp(greatest, 0.0, frame.last_entry);
    let first = min(floor(low), frame.last_entry - 1.0);
    let last = min(floor(high), frame.last_entry - 1.0);
    var sums = rest_of(u32(last), high - last) - rest_of(u32(first), low - first);
    if (last > first) {
        for (var channel = 0u; channel < 4u; channel++) {
            let a = sum_at(u32(first), channel);
            let b = sum_at(u32(last), channel);
            let words = vec2u(b.x - a.x, b.y - a.y - u32(b.x < a.x));
            sums[channel] += (f32(words.y) * 4294967296.0 + f32(words.x)) * frame.sum_unit;
        }
    }
    if (IS_UNBOUNDED) {
        sums += beyond(least, greatest);
    }
    let depth = max(sums.w, 0.0);
    let color = select(vec3f(0.0), clamp(sums.xyz / max(depth, 1e-30), vec3f(0.0), vec3f(1.0)), depth > 0.0);
    return Medium(color, depth / (greatest - least));
}

// Adds a medium at a value with its differences: classified by gradient, and lit, if the variant does so.
fn add_by_gradient(
    pixel: Pixel, by_value: Medium, field: Field, ray: Ray, t: f32, length: f32, value: f32, differences: vec3f
) -> Pixel {
    var medium = by_value;
    if (HAS_GRID) {
        medium = classify_by_gradient(value, differences, field.scale);
        if (medium.depth <= 0.0) {
            return pixel;
        }
    }
    var color = medium.color;
    if (LIGHTING != UNLIT) {
        color = shade(LIGHTING, field, ray, t, color, differences, met_share(t));
    }
    return add(pixel, medium, color, length);
}

// Adds a real sample, which stands for `length`.
fn add_sampled(pixel: Pixel, field: Field, ray: Ray, t: f32, length: f32) -> Pixel {
    let value = inside(field, t);
    let medium = classify(value);
    if ((HAS_INVALID && !has_value(value)) || medium.depth <= 0.0) {
        return pixel;
    }
    if (LIGHTING == UNLIT && !HAS_GRID) {
        return add(pixel, medium, medium.color, length);
    }
    return add_by_gradient(pixel, medium, field, ray, t, length, value, differences(field, t, value));
}

// The Catmull-Rom curve through four values.
fn catmull_rom(a: vec3f, b: vec3f, c: vec3f, d: vec3f, t: f32) -> vec3f {
    return b + 0.5 * t * (c - a + t * (2.0 * a - 5.0 * b + 4.0 * c - d + t * (3.0 * (b - c) + d - a)));
}

// The value on the curve, `s` of the way along the segment.
fn on_curve(values: vec4f, s: f32) -> f32 {
    if (CURVE == LINE) {
        return mix(values.y, values.z, s);
    }
    let value = catmull_rom(vec3f(values.x), vec3f(values.y), vec3f(values.z), vec3f(values.w), s).x;
    return clamp(value, min(values.y, values.z), max(values.y, values.z));
}

// A pixel and the known field, behind a segment.
struct Taken {
    pixel: Pixel,
    known: Known,
}

// Takes the fog of a segment, given the known field of the one before in the same brick.
fn take_fog(before: Pixel, so_far: Known, field: Field, ray: Ray, start: f32, end: f32) -> Taken {
    var pixel = before;
    let length = end - start;
    if (CURVE == MIDDLE || IS_LABELS) {
        return Taken(add_sampled(pixel, field, ray, 0.5 * (start + end), length), so_far);
    }
    var known = known_next(so_far, field, start, end);
    // If only one end has a value, it stands for the other.
    var values = known.values;
    if (HAS_INVALID) {
        values.y = select(values.z, values.y, has_value(values.y));
        values.z = select(values.y, values.z, has_value(values.z));
        values.x = select(values.y, values.x, has_value(values.x));
        values.w = select(values.z, values.w, has_value(values.w));
        if (!has_value(values.y)) {
            return Taken(pixel, known);
        }
    }
    if (CURVE == FIELD) {
        let parts = u32(clamp(ceil(abs(values.z - values.y) / frame.adaptive_step), 1.0, f32(MOST_PARTS)));
        let part = length / f32(parts);
        for (var k = 0u; k < parts; k++) {
            pixel = add_sampled(pixel, field, ray, start + (f32(k) + 0.5) * part, part);
        }
        return Taken(pixel, known);
    }
    for (var k = 0u; k < PARTS; k++) {
        let s = vec3f(f32(k), f32(k) + 0.5, f32(k) + 1.0) / f32(PARTS);
        var medium: Medium;
        if (IS_PRE_INTEGRATED) {
            medium = mean_medium(on_curve(values, s.x), on_curve(values, s.z));
        } else {
            medium = classify(on_curve(values, s.y));
        }
        if (medium.depth > 0.0) {
            var gradient = vec3f(0.0);
            if (LIGHTING != UNLIT || HAS_GRID) {
                known = with_gradients(known, values, field, start, end);
                gradient = mix(known.g1, known.g2, s.y);
                if (CURVE == CUBIC) {
                    gradient = catmull_rom(known.g0, known.g1, known.g2, known.g3, s.y);
                }
            }
            let t = start + s.y * length;
            pixel = add_by_gradient(pixel, medium, field, ray, t, length / f32(PARTS), on_curve(values, s.y), gradient);
        }
    }
    return Taken(pixel, known);
}

// Adds the missing gradients of the curve's nodes.
fn with_gradients(so_far: Known, values: vec4f, field: Field, start: f32, end: f32) -> Known {
    var known = so_far;
    let length = end - start;
    if ((known.gradients & 2u) == 0u) {
        known.g1 = differences(field, start, values.y);
    }
    if ((known.gradients & 4u) == 0u) {
        known.g2 = differences(field, end, values.z);
    }
    if (CURVE == CUBIC) {
        if ((known.gradients & 1u) == 0u) {
            known.g0 = differences(field, start - length, values.x);
        }
        if ((known.gradients & 8u) == 0u) {
            known.g3 = differences(field, end + length, values.w);
        }
    }
    known.gradients = 15u;
    return known;
}
