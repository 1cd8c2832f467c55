// Caps: where the first place behind a cut is past surfaces, the innermost of them stands on the cut. The rule is written down beside its CPU
// twin, the volume crate's `cut_face`.
//!import context cut_face frame ray shade world
// What a ray is past, as a rank, before its first place behind a cut.
const AT_CUT: i32 = -2;

// The rank of a ray whose stretch begins at `start`: `AT_CUT` if a cap may stand there, else -1, which is not known.
fn first_rank(ray: Ray, start: f32) -> i32 {
    if (!HAS_SURFACES || frame.caps == 0u) {
        return -1;
    }
    let cut = cut_face(ray);
    // What rounding leaves of a distance; behind it, a layer of meshes bounds the stretch.
    let is_here = abs(start - cut.w) <= 0.01 * frame.step + 1e-6 * abs(start);
    return select(-1, AT_CUT, is_here && any(cut.xyz != vec3f(0.0)));
}

// The lit colour of a cap at a distance.
fn cap_color(ray: Ray, t: f32, color: vec3f) -> vec3f {
    let normal = gradient_to_world(cut_face(ray).xyz);
    return lit(SURFACE_LIGHTING, frame.lights, color, false, normal, to_world(ray.direction), to_world(ray.origin + ray.direction * t));
}
