// Isosurfaces, in fog or alone: each cuts its segment into one in front of it and one behind. The rule is documented with its CPU
// twin, the volume crate's `surface`.
//!import caps differences medium search

// Takes a segment, given the known field of the one before in the same brick.
fn take(before: Pixel, so_far: Known, field: Field, ray: Ray, start: f32, end: f32) -> Taken {
    var taken = Taken(before, so_far);
    if (taken.pixel.rank < 0) {
        let is_at_cut = taken.pixel.rank == AT_CUT;
        taken.pixel.rank = rank_of(inside(field, start));
        if (is_at_cut && taken.pixel.rank > 0) {
            let look = frames[layer].surfaces[taken.pixel.rank - 1];
            taken.pixel = with_surface(taken.pixel, cap_color(ray, start, look.rgb), look.a);
        }
    }
    let last = rank_of(inside(field, end));
    let is_known = taken.pixel.rank >= 0 && last >= 0;
    let passed = select(0, abs(last - taken.pixel.rank), is_known);
    let is_up = last > taken.pixel.rank;
    var piece_start = start;
    for (var k = 0; k <= passed; k++) {
        let surface = u32(max(taken.pixel.rank - select(1, 0, is_up), 0));
        var piece_end = end;
        if (k < passed) {
            piece_end = locate(field, piece_start, end, threshold_of(surface), is_up);
        }
        if (HAS_FOG) {
            if (passed > 0) {
                taken.known.length = 0.0;
            }
            taken = take_fog(taken.pixel, taken.known, field, ray, piece_start, piece_end);
        }
        if (k < passed) {
            taken.pixel = add_surface(taken.pixel, field, ray, piece_end, surface);
            taken.pixel.rank += select(-1, 1, is_up);
            piece_start = piece_end;
        }
    }
    if (passed > 0) {
        taken.known.length = 0.0;
    }
    taken.pixel.rank = last;
    return taken;
}

fn add_surface(pixel: Pixel, field: Field, ray: Ray, t: f32, surface: u32) -> Pixel {
    let look = frames[layer].surfaces[surface];
    let value = threshold_of(surface);
    return with_surface(pixel, shade(SURFACE_LIGHTING, field, ray, t, look.rgb, differences(field, t, value), 0.0), look.a);
}

fn with_surface(pixel: Pixel, color: vec3f, opacity: f32) -> Pixel {
    return Pixel(pixel.color + pixel.transmittance * opacity * color, pixel.transmittance * (1.0 - opacity), pixel.rank);
}
