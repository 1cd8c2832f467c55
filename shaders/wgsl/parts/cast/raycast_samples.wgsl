// Leaves; in a leaf, runs of visible macro-cells; in a run, samples. Runs are as long as possible, and are searched in a loop
// without samples: neighbouring rays wait for each other and leave a loop with the last of them. Conditions stand at the heads
// of loops or one `if` deep: a `break` two deep made all of this three times slower on lavapipe (Mesa 22.3).
//!import atlas boxes bricks dither lattice macrocells feedback no_value pixel runs sees sight tree

fn cast_ray(position: vec2f) -> vec4f {
    let seen = sight(position);
    let ray = seen.ray;
    let threshold = dither(position);
    let whole = seen.stretch;
    let t_in = whole.x;
    var pixel = pixel_start();
    // First up to `until`; the stretch before `rest` follows later.
    var until = whole.y;
    var walk = enter_zone(tick_at(mix(t_in, until, FIRST_SHARE)), 0u, vec2f(t_in, until));
    var rest = walk.start;
    while ((walk.start < until || rest > t_in) && !is_final(pixel)) {
        let is_rest_due = walk.start >= until;
        until = select(until, rest, is_rest_due);
        rest = select(rest, t_in, is_rest_due);
        let stretch = vec2f(t_in, until);
        if (is_rest_due || is_zone_left(walk)) {
            walk = enter_zone(select(walk.tick, tick_at(t_in), is_rest_due), 0u, stretch);
        }

        let place = find_place(ray.origin + ray.direction * walk.middle);
        // The leaf has at least this segment, even if rounding puts its end before it.
        let leave = max(min(leaving(ray, place.low, place.size), until), walk.end);
        var brick: RayBrick;
        var is_brick_seen = place.number != 0u;
        if (is_brick_seen) {
            let number = brick_number(place.number, threshold);
            mark(number, light_left(pixel));
            brick = brick_at(number);
            is_brick_seen = sees(pixel, brick.range);
        }
        let has_cells = is_brick_seen && brick.first_range != NO_RANGES;
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
            }
            let base = walk.middle;
            let texel = (ray.origin + ray.direction * base) * brick.texel_scale + brick.texel_offset;
            let along = ray.direction * brick.texel_scale;
            // A loop of its own: on lavapipe every part of a loop's body costs time in each round, even under an `if` not
            // taken.
            let is_coarse = HAS_BOXES && any(brick.texel_scale < vec3f(1.0));
            while (is_coarse && walk.middle < min(run.end, leave) && !is_zone_left(walk) && !is_final(pixel)) {
                let length = walk.end - walk.start;
                pixel = take_box(pixel, texel + along * (walk.middle - base), along * length, brick.texel_scale, length);
                walk = walk_on(walk, stretch);
            }
            while (walk.middle < min(run.end, leave) && !is_zone_left(walk) && !is_final(pixel)) {
                let value = sample_atlas(texel + along * (walk.middle - base));
                if (has_value(value)) {
                    pixel = accumulate(pixel, value, walk.end - walk.start);
                }
                walk = walk_on(walk, stretch);
            }
            if (walk.middle >= leave || is_zone_left(walk) || is_final(pixel)) {
                break;
            }
        }
    }
    return pixel_end(pixel);
}
