// The projection of a layer that lies over others: it covers what adds, and what mixes is dimmed by its opacity when all is resolved.
//!import frame fullscreen seen

struct Sums {
    @location(0) mixed: vec4f,
    @location(1) top: vec4f,
}

@fragment
fn resolve(@builtin(position) position: vec4f) -> Sums {
    frame = frames[layer];
    return Sums(vec4f(0.0), seen(position.xy));
}
