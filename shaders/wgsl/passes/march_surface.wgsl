// Looks for the surface in a cell.
//
// Cells do not know on which side a ray comes from the one before. So each looks in its own field from as far before it as its
// apron goes: what two cells would see each just beyond the plane where they meet, one of them sees.
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
    // A segment may begin before the apron does. The cell sees only its end then: a ray inside there is not on a known side, for the segment's own cell looks
    // at both ends.
    let is_part = walk.start < field.reach.x && walk.middle < own.x;
    pixel.side = select(pixel.side, 0.0, is_part && pixel.side > 0.0);
    while (own.x < own.y && walk.middle < last && !is_final(pixel)) {
        pixel = search(pixel, field, walk.start, walk.end);
        walk = walk_on(walk, stretch);
        if (is_zone_left(walk)) {
            walk = next_zone(walk, stretch);
        }
    }
    return pixel_in(pixel, field, ray);
}
