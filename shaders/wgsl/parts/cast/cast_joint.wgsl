// Several layers: one ray per pixel, front to back along their common lattice. In each segment every layer takes its part (`way`), and all
// parts are seen together. Where no layer shows anything, the ray skips to the first that may again. The rule is documented with its CPU
// twin, the volume crate's `compositing`.
//!import asking dither frame jitter lattice layers limits see way

fn cast_ray(position: vec2f) -> vec4f {
    let threshold = dither(position);
    let all = set_out_all(position);
    let shift = jitter_shift(all, position);
    let whole = limited(all, position) + shift;
    shift_all(shift);
    var light = Light(vec3f(0.0), 1.0);
    var walk = enter_zone(tick_at(whole.x), 0u, whole);
    // Leaves; in a leaf, skips to a visible macro-cell; there, segments. Each has its own loop, because software rasterisers run the whole
    // body of a loop for every ray. Behind a transmittance of 1/4096, everything adds less than a sixteenth of an 8-bit code.
    while (walk.start < whole.y && light.transmittance >= 1.0 / 4096.0) {
        if (is_zone_left(walk)) {
            walk = next_zone(walk, whole);
        }
        find_all(walk, threshold, light.transmittance);
        var is_in = true;
        while (is_in) {
            var is_empty = true;
            while (is_empty) {
                look_all(walk);
                let empty = empty_until_all(walk);
                is_empty = empty > walk.end;
                if (is_empty) {
                    walk = walk_past(walk, empty, whole);
                    is_in = walk.start < whole.y && !is_zone_left(walk) && !is_any_due(walk);
                }
                is_empty = is_empty && is_in;
            }
            // At least one segment, even if rounding puts the end of the find before it: every round advances.
            var is_on = is_in;
            while (is_on) {
                take_all(walk);
                light = see_all(light);
                walk = walk_on(walk, whole);
                is_in = walk.start < whole.y && !is_zone_left(walk) && !is_any_due(walk) && light.transmittance >= 1.0 / 4096.0;
                is_on = is_in && !is_any_elsewhere(walk) && empty_until_all(walk) <= walk.end;
            }
        }
    }
    return vec4f(light.color, 1.0 - light.transmittance);
}
