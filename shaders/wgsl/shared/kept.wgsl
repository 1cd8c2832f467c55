// State that a shader with loops over layers keeps of each way between turns. Arrays with variable indices compile slowly, with the square of
// their size: so bricks and fields are read anew in each turn, and a variant's unused state is neither kept nor restored.
//!import context find joint_medium ray way

struct Kept {
    ray: Ray,
    stretch: vec2f,
    until: f32,
    is_seen: bool,
    found: vec3u,
    known: Known,
    ranks: vec3i,
    end: f32,
    crossing: f32,
    piece: vec2f,
    shown: Pixel,
    value: f32,
    length: f32,
    gradient: vec3f,
}

var<private> all_kept: array<Kept, LAYERS>;

// The media of all layers in a segment, if none of them has surfaces.
var<private> shown_together: JointMedium;

// Switches to a layer's frame and numbers. `lighting` is that of layers that do not add.
fn turn_to(i: u32, lighting: u32) {
    layer = i;
    frame = frames[i];
    FIRST_NODE = frame.list_at.x;
    FIRST_BRICK = frame.list_at.y;
    FIRST_RANGE = frame.firsts.x;
    FIRST_PLACE = frame.firsts.y;
    FIRST_COUNT = frame.firsts.z;
    set_flags(frame.firsts.w);
    LIGHTING = select(lighting, 0u, ADDS);
}

fn restore(i: u32) {
    let kept = all_kept[i];
    way.ray = kept.ray;
    way.stretch = kept.stretch;
    way.until = kept.until;
    way.is_seen = kept.is_seen;
    restore_found(kept.found);
    if (!IS_MIDDLE) {
        way.known = kept.known;
    }
    if (IS_CUT) {
        way.rank = kept.ranks.x;
        way.last = kept.ranks.y;
        way.cap = kept.ranks.z;
        way.end = kept.end;
        way.crossing = kept.crossing;
        way.piece = kept.piece;
        way.shown = kept.shown;
    }
}

// Keeps everything, after a leaf has been found.
fn keep(i: u32) {
    all_kept[i].ray = way.ray;
    all_kept[i].stretch = way.stretch;
    keep_looked(i);
    keep_taken(i);
}

// Keeps the state changed by a look at the leaf.
fn keep_looked(i: u32) {
    all_kept[i].until = way.until;
    all_kept[i].is_seen = way.is_seen;
    all_kept[i].found = kept_found();
    if (!IS_MIDDLE) {
        all_kept[i].known.length = way.known.length;
    }
    if (IS_CUT) {
        all_kept[i].ranks.x = way.rank;
    }
}

// Keeps the state changed by taking a segment.
fn keep_taken(i: u32) {
    if (!IS_MIDDLE) {
        all_kept[i].known = way.known;
    }
    if (IS_CUT) {
        all_kept[i].ranks = vec3i(way.rank, way.last, way.cap);
        all_kept[i].end = way.end;
        all_kept[i].crossing = way.crossing;
        all_kept[i].piece = way.piece;
        all_kept[i].shown = way.shown;
    }
    if (IS_READ) {
        all_kept[i].value = way.value;
        all_kept[i].length = way.length;
        all_kept[i].gradient = way.gradient;
    }
}

// Joins a layer's medium in a segment to those of the others.
fn join_shown() {
    if (!IS_READ && !IS_CUT) {
        shown_together = with_share(shown_together, way.shown, 1.0);
    }
}
