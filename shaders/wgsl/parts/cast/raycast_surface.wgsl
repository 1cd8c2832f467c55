// Like `raycast_samples`: leaves, runs of macro-cells, segments. But segments are evaluated from end to end, and the ray's side carries over
// from brick to brick, also across skipped stretches.
//!import bricks dither field lattice macrocells feedback runs sees sight surface tree

fn cast_ray(position: vec2f) -> vec4f {
    let seen = sight(position);
    let ray = seen.ray;
    let threshold = dither(position);
    let stretch = seen.stretch;
    var pixel = pixel_before(seen);
    var field: Field;
    var walk = enter_zone(tick_at(stretch.x), 0u, stretch);
    // Where the ray has left the last leaf, and a hair farther: rounding does not find the same leaf again.
    var left = 0.0;
    let hair = 0.01 * voxel_length(ray, vec3f(1.0));
    while (walk.start < stretch.y && !is_final(pixel)) {
        if (is_zone_left(walk)) {
            walk = next_zone(walk, stretch);
        }
        // Long segments reach out of their leaf. A visible brick takes its neighbours' segments as far as they reach into it, and an
        // invisible one leaves its own to the next: the ray visits each leaf within a segment's reach.
        let hang = overhang(ray, vec3f(1.0), walk.stride);
        let reach = min(walk.middle + hang, stretch.y);
        let at = clamp(max(left, stretch.x), walk.middle - hang, reach);
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
        if (!is_brick_seen && end > at && left < reach) {
            continue;
        }
        // The leaf has at least this segment, even if rounding puts its end before it.
        let leave = max(min(end + select(-hang, hang, is_brick_seen), stretch.y), walk.end);
        field = field_about(brick.low + 0.5 / brick.texel_scale, brick.texel_scale, brick.texel_offset, ray);
        // Longer segments reach farther out of macro-cells than the ranges cover.
        let has_cells = is_brick_seen && overhang(ray, brick.texel_scale, walk.stride) == 0.0;
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
                pixel.side = select(pixel.side, 0.0, HAS_INVALID);
            }
            let until = min(run.end, leave);
            if (abs(pixel.side) < 1.0 && walk.middle < until) {
                pixel = begin(pixel, field, walk.start, stretch.x);
            }
            while (walk.middle < until && !is_zone_left(walk) && !is_final(pixel)) {
                pixel = search(pixel, field, walk.start, walk.end);
                walk = walk_on(walk, stretch);
            }
            if (walk.middle >= leave || is_zone_left(walk) || is_final(pixel)) {
                break;
            }
        }
    }
    return pixel_in(pixel, field, ray);
}
