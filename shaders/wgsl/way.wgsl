// A ray's way through one layer: what it finds of the layer in each segment, leaf by leaf and macro-cell by macro-cell.
//!import bricks feedback field frame lattice macrocells medium opaque part ranks ray tree
struct Way {
    ray: Ray,
    // Where it is in what is shown of the layer.
    stretch: vec2f,
    // Where it leaves the leaf that it has come to last, and the macro-cell.
    leave: f32,
    until: f32,
    // Whether anything may be seen in them.
    is_leaf_seen: bool,
    is_seen: bool,
    brick: RayBrick,
    field: Field,
    known: Known,
    // Ticks of the segments for which macro-cells were looked at.
    stride: u32,
    // Of its own surfaces, how many it is past, and how many at the end of its part of the segment; negative where that is not known.
    rank: i32,
    last: i32,
    // Where the part ends, and where the next surface in it is passed: far away if none is.
    end: f32,
    crossing: f32,
    // The piece up to there, and what the layer shows of it.
    piece: vec2f,
    shown: Pixel,
    // Where media are an expression's: the value in the middle of the part, negative if there is none, and the part's length.
    value: f32,
    length: f32,
}

var<private> way: Way;

// Nothing is seen before.
var<private> empty_until: f32;

// Sets out along a pixel's ray.
fn set_out(position: vec2f) {
    way.ray = pixel_ray(position);
    let stretch = shown(way.ray);
    // One that is empty is nowhere.
    way.stretch = select(vec2f(1e30, -1e30), stretch, stretch.x < stretch.y);
    way.leave = -1.0;
    way.until = -1.0;
    way.is_seen = false;
    way.known.length = 0.0;
    way.rank = -1;
}

// The stretch of all layers so far, and of this one.
fn union_with(whole: vec2f) -> vec2f {
    return vec2f(min(whole.x, way.stretch.x), max(whole.y, way.stretch.y));
}

// Moves the lattice.
fn shift_by(shift: f32) {
    way.ray.origin -= way.ray.direction * shift;
    way.stretch += shift;
}

// Whether anything can be seen where codes are in a range.
fn may_show(range: u32) -> bool {
    return has_codes(range) && ((HAS_FOG && has_opacity(range)) || (HAS_SURFACES && is_passed(way.rank, range)));
}

// Finds what is at distance `t`: the leaf, if it is not the last one's, and of its macro-cells the one.
fn enter(t: f32, threshold: u32, stride: u32, transmittance: f32) {
    let ray = way.ray;
    let point = ray.origin + ray.direction * t;
    if (t >= way.leave) {
        let place = find_place(point);
        way.leave = leaving(ray, place.low, place.size);
        way.is_leaf_seen = place.number != 0u;
        way.known.length = 0.0;
        if (way.is_leaf_seen) {
            let number = brick_number(place.number, threshold);
            mark(number, transmittance);
            way.brick = brick_at(number);
            let scale = way.brick.texel_scale;
            way.field = field_about(way.brick.low + 0.5 / scale, scale, way.brick.texel_offset, ray);
            way.is_leaf_seen = may_show(way.brick.range);
        }
    }
    way.until = way.leave;
    way.is_seen = way.is_leaf_seen;
    way.stride = stride;
    // Longer segments reach out of macro-cells farther than their ranges hold.
    let is_covered = IS_MIDDLE || overhang(ray, way.brick.texel_scale, stride) == 0.0;
    if (way.is_seen && way.brick.first_range != NO_RANGES && is_covered) {
        let size = CELL_EDGE / way.brick.texel_scale;
        let along = f32(frame.macro_cells);
        let at = clamp(floor((point - way.brick.low) / size), vec3f(0.0), vec3f(along - 1.0));
        way.is_seen = may_show(cell_range(way.brick.first_range, u32((at.z * along + at.y) * along + at.x)));
        way.until = min(way.leave, leaving(ray, way.brick.low + at * size, size));
    }
}

// Takes the layer's part of a segment, and notes up to where there is nothing of it.
fn take_part(walk: Walk, threshold: u32, transmittance: f32) {
    let start = max(walk.start, way.stretch.x);
    let end = min(walk.end, way.stretch.y);
    let middle = 0.5 * (start + end);
    let is_inside = start < end;
    if (is_inside && (middle >= way.until || (!IS_MIDDLE && walk.stride != way.stride))) {
        enter(middle, threshold, walk.stride, transmittance);
    }
    let is_taken = is_inside && way.is_seen;
    show_nothing();
    if (is_taken) {
        show_part(start, end);
    } else {
        // What was leapt over may have had no value.
        way.known.length = 0.0;
        way.rank = select(way.rank, -1, HAS_INVALID && is_inside);
    }
    // Ahead of it, nothing up to the segment that it begins in; behind it, nothing at all.
    let ahead = way.stretch.x - 0.5 * f32(walk.stride) * frame.step;
    let empty = select(select(way.until, ahead, walk.end <= way.stretch.x), 1e30, walk.start >= way.stretch.y);
    empty_until = min(empty_until, select(empty, walk.end, is_taken));
}
