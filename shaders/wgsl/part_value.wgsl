// What an expression reads of a layer's part of a segment: the value in the middle.
//!import field way
fn show_nothing() {
    way.value = -1.0;
    way.length = 0.0;
}

fn show_part(start: f32, end: f32) {
    way.value = inside(way.field, 0.5 * (start + end));
    way.length = end - start;
}
