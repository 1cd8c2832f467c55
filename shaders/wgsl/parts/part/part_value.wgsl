// An expression's input from a layer's part of a segment: the value in the middle, and the gradient there if the expression is lit.
//!import context differences field frame no_value shade way world

fn show_nothing() {
    way.value = NO_VALUE;
    way.length = 0.0;
}

fn show_part(start: f32, end: f32) {
    let middle = 0.5 * (start + end);
    way.value = inside(way.field, middle);
    way.length = end - start;
    way.gradient = vec3f(0.0);
    // Labels are even between their borders.
    if (LIGHTING != UNLIT && !IS_LABELS) {
        let across = differences(way.field, middle, way.value);
        let is_flat = length(across) < frame.flat;
        way.gradient = select(gradient_to_world(across * way.field.scale) * frame.slopes[0].w, vec3f(0.0), is_flat);
    }
}
