// Surfaces of one of several volumes, #. The rule is that of `surfaces.wgsl`; but fog of other volumes, and their surfaces, may
// come between two of them, so each is passed when it is the next of all.
const HAS_SURFACES_#: bool = true;

// Whether a surface may be among codes in a range: if they are not all past as many as the ray.
fn is_passed_#(low: u32, high: u32) -> bool {
    let rank = rank_of_code_#(low);
    return rank_of_code_#(high) != rank || (way_#.rank >= 0 && way_#.rank != rank);
}

// Whether ranges of macro-cells hold for all of a segment.
fn is_covered_#() -> bool {
    return overhang(way_#.ray, way_#.brick.texel_scale, way_#.stride) == 0.0;
}

// What was leapt over may have had no value.
fn start_surfaces_#(is_leapt: bool) {
    way_#.crossing = 1e30;
    way_#.rank = select(way_#.rank, -1, HAS_INVALID_# && is_leapt);
}

// Looks for surfaces in the volume's part of a segment.
fn find_surfaces_#(start: f32, end: f32) {
    let field = field_#();
    if (way_#.rank < 0) {
        way_#.rank = rank_of_#(inside_#(field, start));
    }
    way_#.last = rank_of_#(inside_#(field, end));
    way_#.part = vec2f(start, end);
    if (way_#.rank >= 0 && way_#.last >= 0 && way_#.rank != way_#.last) {
        way_#.crossing = next_crossing_#(start);
    } else {
        way_#.rank = way_#.last;
    }
}

// Of surfaces that are passed in the segment, the next.
fn next_surface_#() -> u32 {
    return u32(max(way_#.rank - select(1, 0, way_#.last > way_#.rank), 0));
}

fn threshold_#(surface: u32) -> f32 {
    return frames[#u].thresholds[surface / 4u][surface % 4u];
}

fn next_crossing_#(start: f32) -> f32 {
    return locate_#(field_#(), start, way_#.part.y, threshold_#(next_surface_#()), way_#.last > way_#.rank);
}

// Passes the next surface, if it is at distance `t`.
fn pass_#(before: Pixel, t: f32) -> Pixel {
    if (way_#.crossing > t) {
        return before;
    }
    let surface = next_surface_#();
    let look = frames[#u].surfaces[surface];
    let color = shade_#(SURFACE_LIGHTu, t, look.rgb, differences_#(field_#(), t, threshold_#(surface)));
    way_#.rank += select(-1, 1, way_#.last > way_#.rank);
    way_#.crossing = 1e30;
    if (way_#.rank != way_#.last) {
        way_#.crossing = next_crossing_#(t);
    }
    return Pixel(before.color + before.transmittance * look.a * color, before.transmittance * (1.0 - look.a));
}
