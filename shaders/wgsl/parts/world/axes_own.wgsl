// Map to the scene's world, from the volume's corner on, for a volume in its own world.
//!import frame

fn to_world(voxels: vec3f) -> vec3f {
    return voxels * frame.spacing;
}

// Of a gradient per voxel.
fn gradient_to_world(gradient: vec3f) -> vec3f {
    return gradient / frame.spacing;
}
