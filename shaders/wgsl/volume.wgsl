// One of several volumes, #: what this file declares there is once for each.
@group(0) @binding(BINDING) var atlas_#: texture_3d<f32>;
// The word of its octree's root, and its first places in `table` and in `opaque_before`.
const ROOT_#: u32 = FIRST_NODEu;
const FIRST_PLACE_#: u32 = FIRST_PLACEu;
const FIRST_COUNT_#: u32 = FIRST_COUNTu;
var<private> frame_#: Frame;
var<private> way_#: Way;

fn sees_#(range: u32) -> bool {
    let low = range & 0xffffu;
    let high = range >> 16u;
    let is_foggy = opaque_before[FIRST_COUNT_# + low] < opaque_before[FIRST_COUNT_# + high + 1u];
    return low <= high && (is_foggy || is_passed_#(low, high));
}

// Sets out along a pixel's ray.
fn begin_#(pixel: vec2f) {
    volume = #u;
    frame = frames[#];
    frame_# = frame;
    way_#.ray = pixel_ray(pixel);
    let stretch = shown(way_#.ray);
    // One that is empty is nowhere.
    way_#.stretch = select(vec2f(1e30, -1e30), stretch, stretch.x < stretch.y);
    way_#.leave = -1.0;
    way_#.until = -1.0;
    way_#.is_seen = false;
    way_#.rank = -1;
}

// Finds what is at distance `t`: the leaf, if it is not the last one's, and of its macro-cells the one.
fn enter_#(t: f32, threshold: u32, stride: u32) {
    let ray = way_#.ray;
    let point = ray.origin + ray.direction * t;
    if (t >= way_#.leave) {
        let place = find_place_#(point);
        way_#.leave = leaving(ray, place.low, place.size);
        way_#.is_leaf_seen = place.number != 0u;
        if (way_#.is_leaf_seen) {
            way_#.brick = bricks[brick_number(place.number, threshold)];
            way_#.is_leaf_seen = sees_#(way_#.brick.range);
        }
    }
    way_#.until = way_#.leave;
    way_#.is_seen = way_#.is_leaf_seen;
    way_#.stride = stride;
    if (way_#.is_seen && way_#.brick.first_range != NO_RANGES && is_covered_#()) {
        let size = CELL_EDGE / way_#.brick.texel_scale;
        let along = f32(frame_#.macro_cells);
        let at = clamp(floor((point - way_#.brick.low) / size), vec3f(0.0), vec3f(along - 1.0));
        let cell = u32((at.z * along + at.y) * along + at.x);
        way_#.is_seen = sees_#(ranges[way_#.brick.first_range + cell]);
        way_#.until = min(way_#.leave, leaving(ray, way_#.brick.low + at * size, size));
    }
}

// Puts in what the volume has in its part of a segment, and says up to where there is nothing of it.
fn look_#(before: Together, walk: Walk, threshold: u32) -> Together {
    var together = before;
    let start = max(walk.start, way_#.stretch.x);
    let end = min(walk.end, way_#.stretch.y);
    let t = 0.5 * (start + end);
    let is_inside = start < end;
    if (is_inside && (t >= way_#.until || (HAS_SURFACES_# && walk.stride != way_#.stride))) {
        enter_#(t, threshold, walk.stride);
    }
    let is_seen = is_inside && way_#.is_seen;
    if (IS_LAYERED) {
        way_#.part = vec2f(0.0, 1.0);
        way_#.color = vec3f(0.0);
        way_#.depth = 0.0;
    }
    start_surfaces_#(is_inside && !is_seen);
    if (is_seen) {
        let point = way_#.ray.origin + way_#.ray.direction * t;
        let value = sample_atlas_#(point * way_#.brick.texel_scale + way_#.brick.texel_offset);
        if (value >= 0.0) {
            let place = u32(clamp(value, 0.0, 1.0) * frame_#.last_place + 0.5);
            let medium = medium_at(FIRST_PLACE_# + place);
            let color = COLOR;
            let amount = medium.depth * (end - start) * frame_#.per_unit_distance;
            PUT
        }
        find_surfaces_#(start, end);
    }
    // Ahead of it, nothing up to the segment that it begins in; behind it, nothing at all.
    let ahead = way_#.stretch.x - 0.5 * f32(walk.stride) * frame.step;
    let empty = select(select(way_#.until, ahead, walk.end <= way_#.stretch.x), 1e30, walk.start >= way_#.stretch.y);
    together.empty_until = min(together.empty_until, select(empty, walk.end, is_seen));
    return together;
}
