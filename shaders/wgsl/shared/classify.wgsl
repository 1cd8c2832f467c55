// Transfer table of media, sampled finely enough from the least to the greatest code for nearest look-up. A place is two words: colour in
// 11, 11 and 10 bits from the lowest, and depth. Entries over values and gradients hold colour likewise, and opacity.
//!import context frame table

struct Medium {
    // Straight.
    color: vec3f,
    // Halvings of the light per unit distance.
    depth: f32,
}

fn classify(value: f32) -> Medium {
    return medium_at(u32(clamp(value, 0.0, 1.0) * frame.last_place + 0.5));
}

fn medium_at(index: u32) -> Medium {
    return medium_of(table[FIRST_PLACE + index]);
}

fn medium_of(place: vec2u) -> Medium {
    return Medium(color_of(place.x), bitcast<f32>(place.y));
}

fn color_of(word: u32) -> vec3f {
    let color = vec3f(vec3u(word, word >> 11u, word >> 22u) & vec3u(2047u, 2047u, 1023u));
    return color * vec3f(1.0 / 2047.0, 1.0 / 2047.0, 1.0 / 1023.0);
}
