// A layer's media in its part of a segment, piece by piece between its own surfaces.
//!import caps differences layers medium search joint_medium way

fn show_nothing() {
    way.crossing = 1e30;
    way.piece = vec2f(0.0, 1.0);
    way.shown = pixel_start();
}

fn show_part(start: f32, end: f32) {
    way.end = end;
    way.cap = 0;
    if (HAS_SURFACES) {
        let is_at_cut = way.rank == AT_CUT && start <= way.stretch.x;
        if (way.rank < 0) {
            way.rank = rank_of(inside(way.field, start));
        }
        way.cap = select(0, max(way.rank, 0), is_at_cut);
        way.last = rank_of(inside(way.field, end));
        way.rank = select(way.last, way.rank, way.rank >= 0 && way.last >= 0);
    }
    if (way.cap > 0) {
        // Before everything of other layers behind the cut.
        way.crossing = start - CAP_TIE * frame.step;
        way.piece = vec2f(start);
        return;
    }
    show_piece(start);
}

// Shows the piece from `start` to the layer's next surface or the part's end.
fn show_piece(start: f32) {
    var end = way.end;
    way.crossing = 1e30;
    if (HAS_SURFACES && way.rank != way.last) {
        end = locate(way.field, start, way.end, threshold_of(next_surface()), way.last > way.rank);
        way.crossing = end;
        way.known.length = 0.0;
    }
    way.piece = vec2f(start, end);
    if (HAS_FOG) {
        let taken = take_fog(pixel_start(), way.known, way.field, way.ray, start, end);
        way.shown = taken.pixel;
        way.known = taken.known;
    }
}

// The next surface passed in the segment.
fn next_surface() -> u32 {
    return u32(max(way.rank - select(1, 0, way.last > way.rank), 0));
}

// Blends the next surface in front of everything behind it, and goes on to the next piece.
fn pass_surface(light: Light) -> Light {
    let t = way.piece.y;
    let is_cap = way.cap > 0;
    let surface = select(next_surface(), u32(max(way.cap - 1, 0)), is_cap);
    let look = frames[layer].surfaces[surface];
    var color: vec3f;
    if (is_cap) {
        meet_again();
        color = cap_color(way.ray, t, look.rgb);
        way.cap = 0;
    } else {
        let gradient = differences(way.field, t, threshold_of(surface));
        color = shade(SURFACE_LIGHTING, way.field, way.ray, t, look.rgb, gradient, 0.0);
        way.rank += select(-1, 1, way.last > way.rank);
    }
    way.known.length = 0.0;
    show_piece(t);
    return Light(light.color + light.transmittance * look.a * color, light.transmittance * (1.0 - look.a));
}
