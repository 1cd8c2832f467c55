// What a projection shows of a colour: a medium of the layer's opacity, or what adds that much.
//!import frame

fn projected(color: vec3f) -> vec4f {
    return vec4f(color, 1.0 - frame.adds) * frame.opacity;
}
