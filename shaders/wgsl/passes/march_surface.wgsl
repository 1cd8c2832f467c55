// Searches a cell for the surface.
//
// A cell does not have the ray's side from the cell before, so each searches its own field from as far before it as its apron goes. A surface just
// beyond the common plane of two cells, from either's view, is thus seen by one of them.
//!import field lattice sight sorted surface

@fragment
fn march(in: Proxy) -> @location(0) vec4f {
    frame = frames[layer];
    let seen = sight(in.position.xy);
    let ray = seen.ray;
    let stretch = seen.stretch;
    let own = own_stretch(in, ray, stretch);
    let field = field_about(box_of(in).centre, in.texel_scale, in.texel_offset, ray);
    let before = max(own.x - 1.5 * voxel_length(ray, in.texel_scale), max(stretch.x, field.reach.x));
    var walk = enter_zone(tick_at(before), 0u, stretch);
    let last = min(own.y + overhang(ray, in.texel_scale, walk.stride), stretch.y);
    var pixel = pixel_start();
    if (own.x < own.y && before <= stretch.x) {
        pixel = pixel_before(seen);
    }
    pixel = begin(pixel, field, walk.start, stretch.x);
    // A segment may begin before the apron. The cell then sees only its end: a ray inside there is on an unknown side, because the segment's own cell
    // evaluates both ends.
    let is_part = walk.start < field.reach.x && walk.middle < own.x;
    pixel.side = select(pixel.side, 0.0, is_part && pixel.side > 0.0);
    while (own.x < own.y && walk.middle < last && !is_final(pixel)) {
        pixel = search(pixel, field, walk.start, walk.end);
        walk = walk_across(walk, stretch);
    }
    return pixel_in(pixel, field, ray);
}
