// No limit by meshes.
fn limited(stretch: vec2f, position: vec2f) -> vec2f {
    return stretch;
}
