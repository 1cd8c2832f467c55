// Rays through one layer: leaves; in a leaf, runs of visible macro-cells; in a run, what `cast` takes there. Runs are as long as possible, and are
// searched in a loop without samples: neighbouring rays wait for each other and leave a loop with the last of them. Conditions stand at the heads
// of loops or one `if` deep: a `break` two deep made all of this three times slower on lavapipe (Mesa 22.3).
//
// `cast` says whether it needs segments from end to end (`SPANS`), and whether also those that reach in from neighbours (`REACHES`). These are
// constants, so that the other kinds do not pay.
//!import bricks cast cut_face dither field lattice macrocells feedback pixel runs sees sight tree

fn cast_ray(position: vec2f) -> vec4f {
    let seen = sight(position);
    let ray = seen.ray;
    let threshold = dither(position);
    let t_in = seen.stretch.x;
    var pixel = pixel_first(seen);
    var field: Field;
    // First up to `until`; the stretch before `rest` follows later.
    var until = seen.stretch.y;
    var walk = enter_zone(tick_at(mix(t_in, until, FIRST_SHARE)), 0u, vec2f(t_in, until));
    var rest = select(t_in, walk.start, FIRST_SHARE > 0.0);
    // Where the ray has left the last leaf, and a hair farther: rounding does not find the same leaf again.
    var left = 0.0;
    let hair = 0.01 * voxel_length(ray, vec3f(1.0));
    while ((walk.start < until || rest > t_in) && !is_final(pixel)) {
        let is_rest_due = walk.start >= until;
        until = select(until, rest, is_rest_due);
        rest = select(rest, t_in, is_rest_due);
        let stretch = vec2f(t_in, until);
        if (is_rest_due || is_zone_left(walk)) {
            walk = enter_zone(select(walk.tick, tick_at(t_in), is_rest_due), 0u, stretch);
        }
        // Long segments reach out of their leaf. A visible brick takes its neighbours' segments as far as they reach into it, and an
        // invisible one leaves its own to the next: the ray visits each leaf within a segment's reach.
        var hang = 0.0;
        var at = walk.middle;
        if (REACHES) {
            hang = overhang(ray, vec3f(1.0), walk.stride);
            at = clamp(max(left, t_in), walk.middle - hang, min(walk.middle + hang, until));
        }
        let place = find_place(ray.origin + ray.direction * at);
        var brick: RayBrick;
        var is_brick_seen = place.number != 0u;
        if (is_brick_seen) {
            let number = brick_number(place.number, threshold);
            mark(number, light_left(pixel));
            brick = brick_at(number);
            is_brick_seen = sees(pixel, brick.range);
        }
        let end = leaving(ray, place.low, place.size);
        left = end + hair;
        if (REACHES && !is_brick_seen && end > at && left < min(walk.middle + hang, until)) {
            continue;
        }
        // The leaf has at least this segment, even if rounding puts its end before it.
        let leave = max(min(end + select(-hang, hang, is_brick_seen), until), walk.end);
        field = field_about(brick.low + 0.5 / brick.texel_scale, brick.texel_scale, brick.texel_offset, ray);
        meet_brick(ray, brick.texel_scale);
        // Longer segments reach farther out of macro-cells than the ranges cover.
        let is_covered = !SPANS || overhang(ray, brick.texel_scale, walk.stride) == 0.0;
        let has_cells = is_brick_seen && is_covered && brick.first_range != NO_RANGES;
        var cells = first_cell(ray, walk.middle, brick.low, brick.texel_scale);
        loop {
            // Without macro-cells to test, the whole leaf or nothing; otherwise its next visible run.
            var run = Run(select(leave, walk.middle, is_brick_seen), select(-1.0, leave, is_brick_seen), cells);
            if (has_cells) {
                run = next_run(ray, pixel, brick, cells, leave);
                cells = run.cells;
            }
            // A leaf too thin to resolve a segment's length is left, too: every round advances.
            if (run.enter > walk.middle || leave <= walk.middle) {
                walk = walk_past(walk, run.enter, stretch);
                pixel = pixel_skipping(pixel);
            }
            take_run(&pixel, &walk, brick, field, ray, stretch, min(run.end, leave));
            if (walk.middle >= leave || is_zone_left(walk) || is_final(pixel)) {
                break;
            }
        }
    }
    return pixel_last(pixel, field, ray);
}
