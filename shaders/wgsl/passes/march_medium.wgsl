// Adds up the segments of a cell, each evaluated from end to end.
//!import caps cut_face field lattice medium sight sorted take

@fragment
fn march(in: Proxy) -> @location(0) vec4f {
    frame = frames[layer];
    let seen = sight(in.position.xy);
    let ray = seen.ray;
    let stretch = seen.stretch;
    meet_cut(ray, seen.eye);
    meet_brick(ray, in.texel_scale);
    let own = own_stretch(in, ray, stretch);
    let box = box_of(in);
    let field = field_about(box.centre, in.texel_scale, in.texel_offset, ray);
    var pixel = pixel_start();
    var known: Known;
    var walk = enter_zone(tick_at(own.x), 0u, stretch);
    if (walk.start <= stretch.x) {
        pixel.rank = first_rank(stretch.x);
    }
    while (own.x < own.y && walk.middle < own.y && !is_final(pixel)) {
        if (is_in_box(box, ray.origin + ray.direction * walk.middle)) {
            let taken = take(pixel, known, field, ray, walk.start, walk.end);
            pixel = taken.pixel;
            known = taken.known;
        } else {
            // The cell before has taken the first segment.
            pixel.rank = max(pixel.rank, -1);
        }
        walk = walk_across(walk, stretch);
    }
    return pixel_end(pixel);
}
