// The sampling lattice: ticks of `frame.step` from the eye; in zone z a segment is 2^z ticks long. The rule itself is
// written down beside its CPU twin, the volume crate's `Lattice`.
const ZONES: u32 = 16u;
const NEVER: u32 = 1u << 30u;

struct Walk {
    // First tick of the current segment.
    tick: u32,
    // Ticks of a segment in this zone.
    stride: u32,
    // First tick of the next zone.
    zone_end: u32,
}

fn zone_start(zone: u32) -> u32 {
    return select(NEVER, frame.zone_starts[(zone >> 2u) & 3u][zone & 3u], zone < ZONES);
}

fn enter_zone(tick: u32, first_zone: u32) -> Walk {
    var zone = first_zone;
    while (zone + 1u < ZONES && zone_start(zone + 1u) <= tick) {
        zone++;
    }
    return Walk(tick, 1u << zone, zone_start(zone + 1u));
}

// The segment that holds distance `t`.
fn walk_from(t: f32) -> Walk {
    let tick = min(u32(max(t / frame.step, 0.0)), NEVER);
    var walk = enter_zone(tick, 0u);
    walk.tick &= ~(walk.stride - 1u);
    return walk;
}

fn walk_on(walk: Walk) -> Walk {
    let tick = walk.tick + walk.stride;
    if (tick < walk.zone_end) {
        return Walk(tick, walk.stride, walk.zone_end);
    }
    return enter_zone(tick, firstTrailingBit(walk.stride));
}

// Start and end of the segment, cut to the ray's stretch in the volume.
fn segment(walk: Walk, t_in: f32, t_out: f32) -> vec2f {
    let start = f32(walk.tick) * frame.step;
    let end = f32(walk.tick + walk.stride) * frame.step;
    return vec2f(max(start, t_in), min(end, t_out));
}

// The first segment past `walk` whose midpoint lies past `t`; not past the zone's end, from where one may go on.
fn walk_past(walk: Walk, t: f32) -> Walk {
    let next = walk_on(walk);
    let ticks = t / frame.step + 0.5 * f32(walk.stride);
    let tick = min(u32(max(ticks, 0.0)), NEVER) & ~(walk.stride - 1u);
    if (tick <= next.tick) {
        return next;
    }
    if (tick < walk.zone_end) {
        return Walk(tick, walk.stride, walk.zone_end);
    }
    return enter_zone(walk.zone_end, firstTrailingBit(walk.stride));
}
