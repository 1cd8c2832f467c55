// A ray's way through one layer, with its finds in each segment.
//!import caps cut_face field find frame lattice medium part ray

struct Way {
    ray: Ray,
    // The entry cut.
    met: Met,
    // The ray's stretch in the shown part of the layer.
    stretch: vec2f,
    // End of the latest look, and whether anything may be visible up to there.
    until: f32,
    is_seen: bool,
    found: Found,
    field: Field,
    known: Known,
    // Number of its own surfaces behind it, now and at the end of its part of the segment; negative if unknown.
    rank: i32,
    last: i32,
    // One more than the surface's index of a cap at the entry; 0 without a cap.
    cap: i32,
    // End of the part, and crossing of its next surface: far away without one, a tie before the cut for a cap.
    end: f32,
    crossing: f32,
    // The piece up to that surface, and the layer's medium in it.
    piece: vec2f,
    shown: Pixel,
    // For expressions: the value in the middle of the part, `NO_VALUE` if there is none, and the part's length.
    value: f32,
    length: f32,
    // For lit expressions: the gradient of the value's code per step, in the scene's world; zero where the field is flat.
    gradient: vec3f,
}

var<private> way: Way;

// Shift of the lattice, and so of each ray's origin.
var<private> moved_by: f32;

// The middle of the segment.
var<private> segment_middle: f32;

// Sets out along a pixel's ray.
fn set_out(position: vec2f) {
    way.ray = pixel_ray(position);
    let stretch = shown(way.ray);
    // An empty stretch is nowhere.
    way.stretch = select(vec2f(1e30, -1e30), stretch, stretch.x < stretch.y);
    way.found = nothing_found();
    way.until = -1.0;
    way.is_seen = false;
    way.known.length = 0.0;
    meet_cut(way.ray, 0.0);
    way.met = met;
    way.rank = first_rank(stretch.x);
}

// The union of the stretches of all layers so far and of this one.
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

// The layer's part of a segment; may be empty.
fn part_of(walk: Walk) -> vec2f {
    return vec2f(max(walk.start, way.stretch.x), min(walk.end, way.stretch.y));
}

// Greatest distance between things of several layers that begin on one cut, as a share of the step: rounding separates them.
const CAP_TIE: f32 = 0.01;

// Whether a layer's next crossing is passed together with the next of all. Caps within a tie behind it are, in the order of layers.
fn is_passed_with(next: f32, crossing: f32, cap: i32) -> bool {
    return crossing <= next + select(0.0, CAP_TIE * frame.step, cap > 0);
}

// Restores the layer's cut for lighting and surfaces. A loop over layers finds it anew, to keep little state per layer.
fn meet_again() {
    if (IS_LOOPED && (LIGHTING != UNLIT || HAS_SURFACES)) {
        meet_cut(way.ray, moved_by);
        meet_brick(way.ray, way.field.scale);
    } else if (!IS_LOOPED) {
        met = way.met;
    }
}

// Takes the layer's part of a segment, after a look.
fn take_part(walk: Walk) {
    segment_middle = walk.middle;
    let part = part_of(walk);
    show_nothing();
    if (part.x < part.y && way.is_seen && is_own(0.5 * (part.x + part.y))) {
        meet_again();
        show_part(part.x, part.y);
    }
}
