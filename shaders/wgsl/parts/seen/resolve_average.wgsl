// The mean value, through the table's colours; opaque where something was sampled.
//!import colors gathered projected

fn seen(position: vec2f) -> vec4f {
    let sums = textureLoad(gathered, vec2i(position), 0).xy;
    let color = color_at(sums.x / max(sums.y, 1e-30));
    return select(vec4f(0.0), projected(color), sums.y > 0.0);
}
