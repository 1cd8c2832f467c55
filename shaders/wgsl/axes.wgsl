fn along_axes(axes: array<vec4f, 3>, along: vec3f) -> vec3f {
    return axes[0].xyz * along.x + axes[1].xyz * along.y + axes[2].xyz * along.z;
}
