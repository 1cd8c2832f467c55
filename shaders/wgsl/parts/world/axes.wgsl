// The scene's world, where a volume may be placed by any affine map: from its corner on.
//!import frame

fn to_world(voxels: vec3f) -> vec3f {
    return along_axes(frame.axes, voxels);
}

// Of a gradient by voxels, of any length.
fn gradient_to_world(gradient: vec3f) -> vec3f {
    return along_axes(frame.slopes, gradient);
}

fn along_axes(axes: array<vec4f, 3>, along: vec3f) -> vec3f {
    return axes[0].xyz * along.x + axes[1].xyz * along.y + axes[2].xyz * along.z;
}
