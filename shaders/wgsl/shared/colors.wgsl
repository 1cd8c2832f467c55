// Transfer table of a projection: colours, sampled finely enough from the least to the greatest code for nearest look-up. A place is 64 bits: 21
// for each part of the colour, from the lowest, and one for any opacity at all. A pixel's colour is off by less than a thousandth of a display
// code.
//!import context frame table

fn place_of(value: f32) -> vec2u {
    return table[FIRST_PLACE + u32(clamp(value, 0.0, 1.0) * frame.last_place + 0.5)];
}

fn color_at(value: f32) -> vec3f {
    let place = place_of(value);
    let color = vec3u(place.x, place.x >> 21u | place.y << 11u, place.y >> 10u) & vec3u(2097151u);
    return vec3f(color) * (1.0 / 2097151.0);
}

fn is_shown(value: f32) -> bool {
    return place_of(value).y >> 31u == 1u;
}
