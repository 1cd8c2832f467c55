// Map to the scene's world, from the volume's corner on, for any affine placement.
//!import frame

fn to_world(voxels: vec3f) -> vec3f {
    return along_axes(frame.axes, voxels);
}

// Of a gradient per voxel; the result has any length.
fn gradient_to_world(gradient: vec3f) -> vec3f {
    return along_axes(frame.slopes, gradient);
}

fn along_axes(axes: array<vec4f, 3>, along: vec3f) -> vec3f {
    return axes[0].xyz * along.x + axes[1].xyz * along.y + axes[2].xyz * along.z;
}
