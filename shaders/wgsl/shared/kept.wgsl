// What a shader that goes through its layers in loops keeps of each way from one turn to the next. What is indexed by a variable takes long to
// compile, by the square of what there is of it: so bricks and fields are read anew in each turn, and what a variant has no use for is neither
// kept nor restored.
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

// What all layers show of a segment, where none of them has surfaces.
var<private> shown_together: JointMedium;

// The layer's frame and numbers. `lighting` is that of layers that do not add.
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

// Everything, after a leaf has been found.
fn keep(i: u32) {
    all_kept[i].ray = way.ray;
    all_kept[i].stretch = way.stretch;
    keep_looked(i);
    keep_taken(i);
}

// What changes where the leaf is looked at.
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

// What changes where a segment is taken.
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

// What a layer shows of a segment, to be seen together with what others show.
fn join_shown() {
    if (!IS_READ && !IS_CUT) {
        shown_together = with_share(shown_together, way.shown, 1.0);
    }
}
