// Like `raycast_samples`: leaves, runs of macro-cells, segments. But segments are evaluated from end to end, each in the brick that
// owns it, and the known field carries over from one segment of a brick to the next.
//!import bricks caps cut_face dither field lattice macrocells feedback medium runs sees sight take tree

fn cast_ray(position: vec2f) -> vec4f {
    let seen = sight(position);
    let ray = seen.ray;
    let threshold = dither(position);
    let stretch = seen.stretch;
    meet_cut(ray, seen.eye);
    var pixel = pixel_start();
    pixel.rank = first_rank(stretch.x);
    var walk = enter_zone(tick_at(stretch.x), 0u, stretch);
    while (walk.start < stretch.y && !is_final(pixel)) {
        if (is_zone_left(walk)) {
            walk = next_zone(walk, stretch);
        }
        let place = find_place(ray.origin + ray.direction * walk.middle);
        // The leaf has at least this segment, even if rounding puts its end before it.
        let leave = max(min(leaving(ray, place.low, place.size), stretch.y), walk.end);
        var brick: RayBrick;
        var is_brick_seen = place.number != 0u;
        if (is_brick_seen) {
            let number = brick_number(place.number, threshold);
            mark(number, light_left(pixel));
            brick = brick_at(number);
            is_brick_seen = sees(pixel, brick.range);
        }
        let field = field_about(brick.low + 0.5 / brick.texel_scale, brick.texel_scale, brick.texel_offset, ray);
        meet_brick(ray, brick.texel_scale);
        // Longer segments reach farther out of macro-cells than the ranges cover.
        let is_covered = (CURVE == MIDDLE && !HAS_SURFACES) || overhang(ray, brick.texel_scale, walk.stride) == 0.0;
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
                pixel.rank = max(select(pixel.rank, -1, HAS_INVALID), -1);
            }
            let until = min(run.end, leave);
            var known: Known;
            while (walk.middle < until && !is_zone_left(walk) && !is_final(pixel)) {
                let taken = take(pixel, known, field, ray, walk.start, walk.end);
                pixel = taken.pixel;
                known = taken.known;
                walk = walk_on(walk, stretch);
            }
            if (walk.middle >= leave || is_zone_left(walk) || is_final(pixel)) {
                break;
            }
        }
    }
    return pixel_end(pixel);
}
