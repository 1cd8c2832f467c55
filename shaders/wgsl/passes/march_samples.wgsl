// Adds up the samples of a cell.
//!import atlas boxes lattice no_value pixel sight sorted

@fragment
fn march(in: Proxy) -> @location(0) vec4f {
    frame = frames[layer];
    let seen = sight(in.position.xy);
    let ray = seen.ray;
    let stretch = seen.stretch;
    let own = own_stretch(in, ray, stretch);
    let box = box_of(in);
    var pixel = pixel_start();
    var walk = enter_zone(tick_at(own.x), 0u, stretch);
    // A loop of its own: on lavapipe every part of a loop's body costs time in each round, even under an `if` not
    // taken.
    let is_coarse = HAS_BOXES && any(in.texel_scale < vec3f(1.0));
    while (is_coarse && own.x < own.y && walk.middle < own.y && !is_final(pixel)) {
        let point = ray.origin + ray.direction * walk.middle;
        if (is_in_box(box, point)) {
            let length = walk.end - walk.start;
            let way = ray.direction * in.texel_scale * length;
            pixel = take_box(pixel, point * in.texel_scale + in.texel_offset, way, in.texel_scale, length);
        }
        walk = walk_across(walk, stretch);
    }
    while (own.x < own.y && walk.middle < own.y && !is_final(pixel)) {
        let point = ray.origin + ray.direction * walk.middle;
        let value = sample_atlas(point * in.texel_scale + in.texel_offset);
        if (is_in_box(box, point) && has_value(value)) {
            pixel = accumulate(pixel, value, walk.end - walk.start);
        }
        walk = walk_across(walk, stretch);
    }
    return pixel_end(pixel);
}
