// A ray's way through one layer: what it finds of the layer in each segment.
//!import caps cut_face field find frame lattice medium part ray

struct Way {
    ray: Ray,
    // The cut by which it enters.
    met: Met,
    // Where it is in what is shown of the layer.
    stretch: vec2f,
    // Up to where it was looked at last, and whether anything may be seen up to there.
    until: f32,
    is_seen: bool,
    found: Found,
    field: Field,
    known: Known,
    // Of its own surfaces, how many it is past, and how many at the end of its part of the segment; negative where that is not known.
    rank: i32,
    last: i32,
    // Of the cap where it enters, one more than the surface's index; 0 without a cap.
    cap: i32,
    // Where the part ends, and where the next surface in it is passed: far away if none is, a tie before its cut if it is a cap.
    end: f32,
    crossing: f32,
    // The piece up to that surface, and what the layer shows of it.
    piece: vec2f,
    shown: Pixel,
    // Where media are an expression's: the value in the middle of the part, `NO_VALUE` if there is none, and the part's length.
    value: f32,
    length: f32,
    // Where that is lit: the gradient of the value's code by the step, in the scene's world; zero where the field is flat.
    gradient: vec3f,
}

var<private> way: Way;

// By how much the lattice is moved, and with it each ray's origin.
var<private> moved_by: f32;

// The middle of the segment.
var<private> segment_middle: f32;

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
    meet_cut(way.ray, 0.0);
    way.met = met;
    way.rank = first_rank(stretch.x);
}

// The stretch of all layers so far, and of this one.
fn union_with(whole: vec2f) -> vec2f {
    return vec2f(min(whole.x, way.stretch.x), max(whole.y, way.stretch.y));
}

// Moves the lattice.
fn shift_by(shift: f32) {
    moved_by = shift;
    way.ray.origin -= way.ray.direction * shift;
    way.stretch += shift;
    way.met.cut.w += shift;
}

// The layer's part of a segment: empty if it has none.
fn part_of(walk: Walk) -> vec2f {
    return vec2f(max(walk.start, way.stretch.x), min(walk.end, way.stretch.y));
}

// How far apart things of several layers may be that begin on one cut, as a share of the step: rounding parts them.
const CAP_TIE: f32 = 0.01;

// Whether a layer's next crossing is passed with the next of all. A cap so near behind it is, in the order of layers.
fn is_passed_with(next: f32, crossing: f32, cap: i32) -> bool {
    return crossing <= next + select(0.0, CAP_TIE * frame.step, cap > 0);
}

// The cut is the layer's again, where something may ask for it. A loop over layers finds it anew, for what it keeps of each has to be little.
fn meet_again() {
    if (IS_LOOPED && (LIGHTING != UNLIT || HAS_SURFACES)) {
        meet_cut(way.ray, moved_by);
        meet_brick(way.ray, way.field.scale);
    } else if (!IS_LOOPED) {
        met = way.met;
    }
}

// Takes the layer's part of a segment, for which it has been looked at.
fn take_part(walk: Walk) {
    segment_middle = walk.middle;
    let part = part_of(walk);
    show_nothing();
    if (part.x < part.y && way.is_seen && is_own(0.5 * (part.x + part.y))) {
        meet_again();
        show_part(part.x, part.y);
    }
}
