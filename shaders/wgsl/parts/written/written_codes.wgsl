// Writes colours as they are.
fn written(color: vec3f) -> vec3f {
    return color;
}
