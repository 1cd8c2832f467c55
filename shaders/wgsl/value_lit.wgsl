// The colour of an expression's value, lit by the value's gradient in the middle of the segment.
//!import expression frame shade way world
fn value_color(color: vec3f, result: Result) -> vec3f {
    let place = to_world(way.ray.origin + way.ray.direction * segment_middle);
    let is_flat = all(result.gradient == vec3f(0.0));
    return lit(LIGHTING, frame.lights, color, is_flat, result.gradient, to_world(way.ray.direction), place);
}
