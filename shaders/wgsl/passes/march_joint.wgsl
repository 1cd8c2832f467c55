// Adds up the segments of a cell of layers with a common grid: in each segment every layer takes its part (`way`), and all parts are seen
// together. The rule is documented with its CPU twin, the volume crate's `compositing`.
//!import frame jitter lattice layers limits see sorted way

@fragment
fn march(in: Proxy) -> @location(0) vec4f {
    let all = set_out_all(in.position.xy);
    let shift = jitter_shift(all, in.position.xy);
    let whole = limited(all, in.position.xy) + shift;
    shift_all(shift);
    drawn = box_of(in);
    // All layers have the same ray.
    let own = own_stretch(in, way.ray, whole);
    var light = Light(vec3f(0.0), 1.0);
    var walk = enter_zone(tick_at(own.x), 0u, whole);
    find_all(walk, 0u, 1.0);
    while (own.x < own.y && walk.start < own.y && light.transmittance >= 1.0 / 4096.0) {
        take_all(walk);
        light = see_all(light);
        walk = walk_across(walk, whole);
    }
    return vec4f(light.color, 1.0 - light.transmittance);
}
