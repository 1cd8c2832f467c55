// Several layers: one ray per pixel, front to back along the lattice that all of them share. In each segment every layer takes its
// part (`way`), and all that is there is seen together. Where none of them shows anything, the ray leaps to where the first of them
// may again. The rule is written down beside its CPU twin, the volume crate's `look`.
//!import frame dither lattice jitter limits way see layers
fn cast_ray(position: vec2f) -> vec4f {
    let threshold = dither(position);
    let all = set_out_all(position);
    let shift = jitter_shift(all, position);
    let whole = limited(all, position) + shift;
    shift_all(shift);
    var light = Light(vec3f(0.0), 1.0);
    var walk = enter_zone(tick_at(whole.x), 0u, whole);
    // Whatever lies behind adds less than a sixteenth of an 8-bit code.
    while (walk.start < whole.y && light.transmittance >= 1.0 / 4096.0) {
        if (is_zone_left(walk)) {
            walk = next_zone(walk, whole);
        }
        empty_until = 1e30;
        take_all(walk, threshold, light.transmittance);
        if (empty_until > walk.end) {
            walk = walk_past(walk, empty_until, whole);
        } else {
            light = see_all(light);
            walk = walk_on(walk, whole);
        }
    }
    return vec4f(light.color, 1.0 - light.transmittance);
}
