// The scene's world, where a volume stands in its own: from its corner on.
//!import frame

fn to_world(voxels: vec3f) -> vec3f {
    return voxels * frame.spacing;
}

// Of a gradient by voxels.
fn gradient_to_world(gradient: vec3f) -> vec3f {
    return gradient / frame.spacing;
}
