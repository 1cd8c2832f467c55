// Adds up the segments of a cell, each looked at from end to end.
//!import field lattice medium sight sorted take
@fragment
fn march(in: Proxy) -> @location(0) vec4f {
    frame = frames[layer];
    let seen = sight(in.position.xy);
    let ray = seen.ray;
    let stretch = seen.stretch;
    // Where middles of this cell's segments can be: its box, widened by what rounding moves a point.
    let own = clip(ray, in.region_min - frame.slack, in.region_max + frame.slack);
    let first = max(own.x, stretch.x);
    let last = select(first, min(own.y, stretch.y), has_pixel(in));

    // The volume's own faces are no borders: a point that rounding puts past one still belongs to the cell inside.
    let low = select(in.region_min, vec3f(-1e30), in.region_min <= vec3f(0.0));
    let high = select(in.region_max, vec3f(1e30), in.region_max >= frame.extent);

    let field = field_about((in.region_min + in.region_max) * 0.5, in.texel_scale, in.texel_offset, ray);
    var pixel = pixel_start();
    var known: Known;
    var walk = enter_zone(tick_at(first), 0u, stretch);
    while (first < last && walk.middle < last && !is_final(pixel)) {
        let point = ray.origin + ray.direction * walk.middle;
        if (all(point >= low) && all(point < high)) {
            let taken = take(pixel, known, field, ray, walk.start, walk.end);
            pixel = taken.pixel;
            known = taken.known;
        }
        walk = walk_on(walk, stretch);
        if (is_zone_left(walk)) {
            walk = next_zone(walk, stretch);
        }
    }
    return pixel_end(pixel);
}
