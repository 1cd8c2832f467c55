// Adds up the samples of a cell.
//!import atlas lattice pixel sight sorted
@fragment
fn march(in: Proxy) -> @location(0) vec4f {
    frame = frames[layer];
    let seen = sight(in.position.xy);
    let ray = seen.ray;
    let stretch = seen.stretch;
    // Where samples of this cell can be: its box, widened by what rounding moves a point.
    let own = clip(ray, in.region_min - frame.slack, in.region_max + frame.slack);
    let first = max(own.x, stretch.x);
    let last = select(first, min(own.y, stretch.y), has_pixel(in));

    // The volume's own faces are no borders: a point that rounding puts past one still belongs to the cell inside.
    let low = select(in.region_min, vec3f(-1e30), in.region_min <= vec3f(0.0));
    let high = select(in.region_max, vec3f(1e30), in.region_max >= frame.extent);

    var pixel = pixel_start();
    var walk = enter_zone(tick_at(first), 0u, stretch);
    while (first < last && walk.middle < last && !is_final(pixel)) {
        let point = ray.origin + ray.direction * walk.middle;
        let value = sample_atlas(point * in.texel_scale + in.texel_offset);
        if (all(point >= low) && all(point < high) && value >= 0.0) {
            pixel = accumulate(pixel, value, walk.end - walk.start);
        }
        walk = walk_on(walk, stretch);
        if (is_zone_left(walk)) {
            walk = next_zone(walk, stretch);
        }
    }
    return pixel_end(pixel);
}
