// Bricks for a ray: leaf by leaf of a layer's octree, and macro-cell by macro-cell.
//!import bricks cut_face feedback field frame lattice macrocells opaque ranks tree way

struct Found {
    // The exit from the latest leaf, and whether anything may be visible in it.
    leave: f32,
    is_seen: bool,
    number: u32,
    brick: RayBrick,
    // Ticks per segment at the latest look.
    stride: u32,
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

// Whether anything can be visible with codes in a range.
fn may_show(range: u32) -> bool {
    return has_codes(range) && ((HAS_FOG && has_opacity(range)) || (HAS_SURFACES && is_passed(way.rank, range)));
}

// Whether the layer's part of a segment is past the latest leaf.
fn is_due(walk: Walk) -> bool {
    let part = part_of(walk);
    return part.x < part.y && 0.5 * (part.x + part.y) >= way.found.leave;
}

// Finds the leaf of the layer's part of a segment, unless it is the latest one.
fn find(walk: Walk, threshold: u32, transmittance: f32) {
    if (!is_due(walk)) {
        return;
    }
    let part = part_of(walk);
    let place = find_place(way.ray.origin + way.ray.direction * (0.5 * (part.x + part.y)));
    way.found.leave = leaving(way.ray, place.low, place.size);
    way.found.is_seen = place.number != 0u;
    way.until = -1.0;
    way.known.length = 0.0;
    if (way.found.is_seen) {
        let number = brick_number(place.number, threshold);
        mark(number, transmittance);
        way.found.number = number;
        open_brick();
        way.found.is_seen = may_show(way.found.brick.range);
    }
}

// Loads the found brick and its field.
fn open_brick() {
    way.found.brick = brick_at(way.found.number);
    let scale = way.found.brick.texel_scale;
    way.field = field_about(way.found.brick.low + 0.5 / scale, scale, way.found.brick.texel_offset, way.ray);
    way.met.rate = rate_in(way.met.cut, way.ray, scale);
}

// State of the find kept by a loop over layers, for `restore_found`.
fn kept_found() -> vec3u {
    return vec3u(bitcast<u32>(way.found.leave), way.found.number, way.found.stride << 1u | u32(way.found.is_seen));
}

fn restore_found(kept: vec3u) {
    way.found.leave = bitcast<f32>(kept.x);
    way.found.number = kept.y;
    way.found.stride = kept.z >> 1u;
    way.found.is_seen = (kept.z & 1u) != 0u;
    open_brick();
}

// Whether the layer's part of a segment is outside the range of the latest look.
fn is_elsewhere(walk: Walk) -> bool {
    let part = part_of(walk);
    let is_past = 0.5 * (part.x + part.y) >= way.until;
    return part.x < part.y && (is_past || (!IS_MIDDLE && walk.stride != way.found.stride));
}

// Looks up the macro-cell for the layer's part of a segment.
fn look(walk: Walk) {
    if (!is_elsewhere(walk)) {
        return;
    }
    way.until = way.found.leave;
    way.is_seen = way.found.is_seen;
    way.found.stride = walk.stride;
    let brick = way.found.brick;
    // Longer segments reach farther out of macro-cells than the ranges cover.
    let is_covered = IS_MIDDLE || overhang(way.ray, brick.texel_scale, walk.stride) == 0.0;
    if (way.is_seen && brick.first_range != NO_RANGES && is_covered) {
        let part = part_of(walk);
        let point = way.ray.origin + way.ray.direction * (0.5 * (part.x + part.y));
        let size = CELL_EDGE / brick.texel_scale;
        let along = f32(frame.macro_cells);
        let at = clamp(floor((point - brick.low) / size), vec3f(0.0), vec3f(along - 1.0));
        way.is_seen = may_show(cell_range(brick.first_range, u32((at.z * along + at.y) * along + at.x)));
        way.until = min(way.found.leave, leaving(way.ray, brick.low + at * size, size));
    }
    // A skipped stretch may have no value.
    way.known.length = select(0.0, way.known.length, way.is_seen);
    way.rank = select(way.rank, -1, HAS_INVALID && !way.is_seen);
}

// The end of the layer's empty stretch from a segment after a look: the segment's own end if its part may be visible.
fn empty_until(walk: Walk) -> f32 {
    let part = part_of(walk);
    // Before the layer, empty up to its first segment; behind it, empty for good.
    let ahead = way.stretch.x - 0.5 * f32(walk.stride) * frame.step;
    let empty = select(select(way.until, ahead, walk.end <= way.stretch.x), 1e30, walk.start >= way.stretch.y);
    return select(empty, walk.end, part.x < part.y && way.is_seen);
}
