// A ray's way through one layer: what it finds of the layer in each segment.
//!import field find frame lattice medium part ray
struct Way {
    ray: Ray,
    // Where it is in what is shown of the layer.
    stretch: vec2f,
    // Up to where it was looked at last, and whether anything may be seen up to there.
    until: f32,
    is_seen: bool,
    found: Found,
    field: Field,
    known: Known,
    // Ticks of the segments for which it was looked at.
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
    // Where that is lit: the gradient of the value's code by the step, in the scene's world; zero where the field is flat.
    gradient: vec3f,
}

var<private> way: Way;

// The middle of the segment.
var<private> segment_middle: f32;

// Nothing is seen before.
var<private> empty_until: f32;

// Sets out along a pixel's ray.
fn set_out(position: vec2f) {
    way.ray = pixel_ray(position);
    let stretch = shown(way.ray);
    // One that is empty is nowhere.
    way.stretch = select(vec2f(1e30, -1e30), stretch, stretch.x < stretch.y);
    way.found = nothing_found();
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

// Takes the layer's part of a segment, and notes up to where there is nothing of it.
fn take_part(walk: Walk, threshold: u32, transmittance: f32) {
    segment_middle = walk.middle;
    let start = max(walk.start, way.stretch.x);
    let end = min(walk.end, way.stretch.y);
    let middle = 0.5 * (start + end);
    let is_inside = start < end && is_own(middle);
    if (is_inside && (middle >= way.until || (!IS_MIDDLE && walk.stride != way.stride))) {
        find(middle, threshold, walk.stride, transmittance);
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
