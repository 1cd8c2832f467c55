// Shift of a pixel's lattice. The rule is documented with its CPU twin, the volume crate's `jitter`.
//!import context frame lattice table

const WHITE: u32 = 1u;
const BLUE: u32 = 2u;
const BLUE_EDGE: u32 = 32u;
const JITTER_STEPS: u32 = 256u;

// The shift, less than the first segment's length, of a ray that enters the shown region at `whole.x`.
fn jitter_shift(whole: vec2f, position: vec2f) -> f32 {
    if (frame.jitter == 0u && frame.jitter_phase == 0u) {
        return 0.0;
    }
    let steps = (jitter_steps(vec2u(position)) + frame.jitter_phase) % JITTER_STEPS;
    let share = f32(steps) / f32(JITTER_STEPS);
    return share * f32(enter_zone(tick_at(whole.x), 0u, whole).stride) * frame.step;
}

fn jitter_steps(pixel: vec2u) -> u32 {
    if (frame.jitter == 0u) {
        return 0u;
    }
    if (frame.jitter == WHITE) {
        return mix_bits(pixel.x + mix_bits(pixel.y + mix_bits(frame.jitter_seed))) >> 24u;
    }
    // In the table's buffer: four steps to a word, two words to an entry.
    let place = (pixel.y % BLUE_EDGE) * BLUE_EDGE + pixel.x % BLUE_EDGE;
    let words = table[FIRST_PLACE + frame.jitter_seed + (place >> 3u)];
    return (select(words.x, words.y, (place & 4u) != 0u) >> ((place & 3u) * 8u)) & 255u;
}

fn mix_bits(number: u32) -> u32 {
    var n = number;
    n = (n ^ (n >> 16u)) * 0x7feb352du;
    n = (n ^ (n >> 15u)) * 0x846ca68bu;
    return n ^ (n >> 16u);
}
