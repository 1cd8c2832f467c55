// A colour in a projection: a medium of the layer's opacity, or as much light to add.
//!import frame

fn projected(color: vec3f) -> vec4f {
    return vec4f(color, 1.0 - frame.adds) * frame.opacity;
}
