// A pixel's ray in voxel space, with t in world units: `origin + t * direction`. It depends only on the pixel's coordinates, so
// that the fragments of all cells get the same ray bit for bit.
//!import frame

struct Ray {
    origin: vec3f,
    direction: vec3f,
    // One over each component of `direction`.
    inverse: vec3f,
}

fn ray_along(origin: vec3f, direction: vec3f) -> Ray {
    let safe = parallel_safe(direction);
    return Ray(origin, safe, 1.0 / safe);
}

// `pixel` is in pixels, centres at halves, row 0 on top.
fn pixel_ray(pixel: vec2f) -> Ray {
    // `lean` is 0 where rays are parallel.
    let u = (2.0 * pixel.x - frame.size_px.x) / frame.size_px.x + frame.lean.x;
    let v = (frame.size_px.y - 2.0 * pixel.y) / frame.size_px.y + frame.lean.y;
    let offset = frame.right * u + frame.up * v;
    if (frame.orthographic != 0u) {
        return ray_along(frame.eye + offset, frame.forward);
    }
    // Forward, right and up are orthogonal in the world, so the world length needs their lengths alone.
    let across = vec2f(u * frame.half_width, v * frame.half_height);
    let length = sqrt(1.0 + dot(across, across));
    return ray_along(frame.eye, (frame.forward + offset) / length);
}

// Leaves no component zero: a ray along a box's face gets slabs of (-huge, huge) or an empty one, never 0 * inf. At 1e-30 voxels
// per world unit the ray still does not move along that axis in f32.
fn parallel_safe(direction: vec3f) -> vec3f {
    return select(direction, vec3f(1e-30), abs(direction) < vec3f(1e-30));
}

// The stretch (from, to) of the ray inside a box; empty if from >= to.
fn clip(ray: Ray, low: vec3f, high: vec3f) -> vec2f {
    let a = (low - ray.origin) * ray.inverse;
    let b = (high - ray.origin) * ray.inverse;
    let near = min(a, b);
    let far = max(a, b);
    return vec2f(max(max(near.x, near.y), near.z), min(min(far.x, far.y), far.z));
}

// The shown stretch (from, to) of the ray: before the eye, in the shown box, on the inner sides of the clip planes. Empty if from
// >= to. The rule is documented with its CPU twin, the volume crate's `Clip`.
fn shown(ray: Ray) -> vec2f {
    let boxed = clip(ray, frame.shown_low, frame.shown_high);
    var stretch = vec2f(max(boxed.x, 0.0), boxed.y);
    for (var i = 0u; i < frame.plane_count; i++) {
        // Not from the private copy, which would stay in memory when indexed.
        let plane = frames[layer].planes[i];
        let height = dot(plane.xyz, ray.origin - frame.eye) + plane.w;
        let rise = dot(plane.xyz, ray.direction);
        // A ray along the plane passes it too far away to matter, ahead or behind: all or nothing is shown.
        let t = -height / select(rise, 1e-20, abs(rise) < 1e-20);
        let enters = rise > -1e-20;
        stretch = vec2f(select(stretch.x, max(stretch.x, t), enters), select(min(stretch.y, t), stretch.y, enters));
    }
    return stretch;
}
