// Isosurfaces, in fog or alone: each cuts its segment, and what is in front of it and behind it are segments of their own. The rule is
// written down beside its CPU twin, the volume crate's `surface`.
const SEARCH_PARTS: u32 = 8u;
const ROUNDS: u32 = 2u;

// How many surfaces a value is past; -1 where there is none.
fn rank_of(value: f32) -> i32 {
    let first = select(vec4f(0.0), vec4f(1.0), frame.thresholds[0] <= vec4f(value));
    let others = select(vec4f(0.0), vec4f(1.0), frame.thresholds[1] <= vec4f(value));
    return select(i32(dot(first + others, vec4f(1.0))), -1, value < 0.0);
}

// Takes a segment, given what is known of the field from the one before it in the same brick.
fn take(before: Pixel, so_far: Known, field: Field, ray: Ray, start: f32, end: f32) -> Taken {
    var taken = Taken(before, so_far);
    if (taken.pixel.rank < 0) {
        taken.pixel.rank = rank_of(inside(field, start));
    }
    let last = rank_of(inside(field, end));
    let is_known = taken.pixel.rank >= 0 && last >= 0;
    let passed = select(0, abs(last - taken.pixel.rank), is_known);
    let is_up = last > taken.pixel.rank;
    var piece_start = start;
    for (var k = 0; k <= passed; k++) {
        let surface = u32(max(taken.pixel.rank - select(1, 0, is_up), 0));
        var piece_end = end;
        if (k < passed) {
            piece_end = locate(field, piece_start, end, frame_settings.thresholds[surface / 4u][surface % 4u], is_up);
        }
        if (HAS_FOG) {
            if (passed > 0) {
                taken.known.length = 0.0;
            }
            taken = take_fog(taken.pixel, taken.known, field, ray, piece_start, piece_end);
        }
        if (k < passed) {
            taken.pixel = add_surface(taken.pixel, field, ray, piece_end, surface);
            taken.pixel.rank += select(-1, 1, is_up);
            piece_start = piece_end;
        }
    }
    if (passed > 0) {
        taken.known.length = 0.0;
    }
    taken.pixel.rank = last;
    return taken;
}

fn add_surface(pixel: Pixel, field: Field, ray: Ray, t: f32, surface: u32) -> Pixel {
    let look = frame_settings.surfaces[surface];
    let value = frame_settings.thresholds[surface / 4u][surface % 4u];
    let color = shade(SURFACE_LIGHTING, field, ray, t, look.rgb, differences(field, t, value));
    return Pixel(pixel.color + pixel.transmittance * look.a * color, pixel.transmittance * (1.0 - look.a), pixel.rank);
}

// Where in a piece of the ray a surface is passed, to its inside or out of it. (All parts are sampled: to leave loops early where
// rays part ways is what software rasterisers are slowest at.)
fn locate(field: Field, start: f32, end: f32, threshold: f32, is_up: bool) -> f32 {
    var near = start;
    var far = end;
    var far_value = inside(field, end);
    var near_value = far_value;
    for (var round = 0u; round < ROUNDS; round++) {
        let first = near;
        let part = (far - near) / f32(SEARCH_PARTS);
        var is_past = false;
        for (var k = 0u; k < SEARCH_PARTS; k++) {
            let t = first + f32(k) * part;
            let value = inside(field, t);
            let is_first_past = !is_past && value >= 0.0 && (value >= threshold) == is_up;
            far = select(far, t, is_first_past);
            far_value = select(far_value, value, is_first_past);
            is_past = is_past || is_first_past;
            // If the first place is past it already, the brick before saw it on the other side there.
            near = select(t, near, is_past);
            near_value = select(select(value, far_value, value < 0.0), near_value, is_past);
        }
    }
    let share = (threshold - near_value) / (far_value - near_value);
    return select(near + (far - near) * clamp(share, 0.0, 1.0), far, far_value == near_value);
}
