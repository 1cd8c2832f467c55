// The sampling lattice: ticks of `frame.step` from the eye; in zone z a segment is 2^z ticks long. The rule is
// documented with its CPU twin, the volume crate's `Lattice`.
//!import frame

const ZONES: u32 = 16u;
const NEVER: u32 = 1u << 30u;

// A segment along a ray, and its zone.
struct Walk {
    // Its first tick.
    tick: u32,
    // Ticks of a segment in this zone.
    stride: u32,
    // First tick of the next zone.
    zone_end: u32,
    // The segment, cut to the ray's stretch in the volume, and its midpoint.
    start: f32,
    end: f32,
    middle: f32,
}

fn zone_start(zone: u32) -> u32 {
    return select(NEVER, frames[layer].zone_starts[(zone >> 2u) & 3u][zone & 3u], zone < ZONES);
}

// The segment at a tick, in the tick's zone, which is `first_zone` or a later one; `stretch` is the ray's.
fn enter_zone(tick: u32, first_zone: u32, stretch: vec2f) -> Walk {
    var zone = first_zone;
    while (zone + 1u < ZONES && zone_start(zone + 1u) <= tick) {
        zone++;
    }
    let stride = 1u << zone;
    let aligned = tick & ~(stride - 1u);
    let start = max(f32(aligned) * frame.step, stretch.x);
    let end = min(f32(aligned + stride) * frame.step, stretch.y);
    return Walk(aligned, stride, zone_start(zone + 1u), start, end, 0.5 * (start + end));
}

// The tick at distance `t`; its end lies past `t` in spite of rounding.
fn tick_at(t: f32) -> u32 {
    let tick = min(u32(max(t / frame.step, 0.0)), NEVER);
    return select(tick, tick + 1u, f32(tick + 1u) * frame.step <= t);
}

// Whether the walk is at the end of its zone: then `next_zone` has to follow.
fn is_zone_left(walk: Walk) -> bool {
    return walk.tick >= walk.zone_end;
}

fn next_zone(walk: Walk, stretch: vec2f) -> Walk {
    return enter_zone(walk.tick, firstTrailingBit(walk.stride), stretch);
}

// The next segment.
fn walk_on(walk: Walk, stretch: vec2f) -> Walk {
    let tick = walk.tick + walk.stride;
    let end = min(f32(tick + walk.stride) * frame.step, stretch.y);
    return Walk(tick, walk.stride, walk.zone_end, walk.end, end, 0.5 * (walk.end + end));
}

// The next segment, in the next zone after the last of a zone.
fn walk_across(walk: Walk, stretch: vec2f) -> Walk {
    var next = walk_on(walk, stretch);
    if (is_zone_left(next)) {
        next = next_zone(next, stretch);
    }
    return next;
}

// The first segment after this one whose midpoint lies past `t`; no further than the zone's end.
fn walk_past(walk: Walk, t: f32, stretch: vec2f) -> Walk {
    let ticks = t / frame.step + 0.5 * f32(walk.stride);
    let aligned = min(u32(max(ticks, 0.0)), NEVER) & ~(walk.stride - 1u);
    let tick = min(max(aligned, walk.tick + walk.stride), walk.zone_end);
    let start = f32(tick) * frame.step;
    let end = min(f32(tick + walk.stride) * frame.step, stretch.y);
    return Walk(tick, walk.stride, walk.zone_end, start, end, 0.5 * (start + end));
}
