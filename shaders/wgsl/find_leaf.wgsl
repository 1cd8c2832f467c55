// What a ray finds on its way through a layer: leaf by leaf of the octree, and macro-cell by macro-cell.
//!import bricks feedback field macrocells opaque ranks tree way
struct Found {
    // Where the ray leaves the leaf that it has come to last, and whether anything may be seen there.
    leave: f32,
    is_seen: bool,
    brick: RayBrick,
}

fn nothing_found() -> Found {
    var found: Found;
    found.leave = -1.0;
    return found;
}

// A ray takes all segments.
fn is_own(t: f32) -> bool {
    return true;
}

// Whether anything can be seen where codes are in a range.
fn may_show(range: u32) -> bool {
    return has_codes(range) && ((HAS_FOG && has_opacity(range)) || (HAS_SURFACES && is_passed(way.rank, range)));
}

// Finds what is at distance `t`: the leaf, if it is not the last one's, and of its macro-cells the one.
fn find(t: f32, threshold: u32, stride: u32, transmittance: f32) {
    let ray = way.ray;
    let point = ray.origin + ray.direction * t;
    if (t >= way.found.leave) {
        let place = find_place(point);
        way.found.leave = leaving(ray, place.low, place.size);
        way.found.is_seen = place.number != 0u;
        way.known.length = 0.0;
        if (way.found.is_seen) {
            let number = brick_number(place.number, threshold);
            mark(number, transmittance);
            way.found.brick = brick_at(number);
            let scale = way.found.brick.texel_scale;
            way.field = field_about(way.found.brick.low + 0.5 / scale, scale, way.found.brick.texel_offset, ray);
            way.found.is_seen = may_show(way.found.brick.range);
        }
    }
    way.until = way.found.leave;
    way.is_seen = way.found.is_seen;
    way.stride = stride;
    // Longer segments reach out of macro-cells farther than their ranges hold.
    let is_covered = IS_MIDDLE || overhang(ray, way.found.brick.texel_scale, stride) == 0.0;
    if (way.is_seen && way.found.brick.first_range != NO_RANGES && is_covered) {
        let size = CELL_EDGE / way.found.brick.texel_scale;
        let along = f32(frame.macro_cells);
        let at = clamp(floor((point - way.found.brick.low) / size), vec3f(0.0), vec3f(along - 1.0));
        way.is_seen = may_show(cell_range(way.found.brick.first_range, u32((at.z * along + at.y) * along + at.x)));
        way.until = min(way.found.leave, leaving(ray, way.found.brick.low + at * size, size));
    }
}
