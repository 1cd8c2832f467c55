// The colour of an expression's value, lit by its gradient in the middle of the segment.
//!import cut_face expression frame shade way world

fn value_color(color: vec3f, result: Result) -> vec3f {
    let place = to_world(way.ray.origin + way.ray.direction * segment_middle);
    let view = to_world(way.ray.direction);
    let is_flat = all(result.gradient == vec3f(0.0));
    meet_again();
    meet_brick(way.ray, vec3f(1.0));
    let share = met_share(segment_middle);
    var normal = normal_of(result.gradient, view);
    if (share > 0.0) {
        normal = cut_normal(share, is_flat, normal, view);
    }
    return lit(LIGHTING, frame.lights, color, is_flat && share <= 0.0, normal, view, place);
}
