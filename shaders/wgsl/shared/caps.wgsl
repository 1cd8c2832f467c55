// Caps: where the first place behind a cut is past surfaces, the innermost of them stands on the cut. The rule is documented with its CPU
// twin, the volume crate's `cut_face`.
//!import context cut_face frame ray shade world

// The rank of a ray before its first place behind a cut.
const AT_CUT: i32 = -2;

// The rank of a ray with its cut met and its stretch from `start` on: `AT_CUT` if a cap may stand there, else -1, unknown.
fn first_rank(start: f32) -> i32 {
    if (!HAS_SURFACES) {
        return -1;
    }
    return select(-1, AT_CUT, is_at_cut(start));
}

// The lit colour of a cap at a distance, for a ray with its cut met.
fn cap_color(ray: Ray, t: f32, color: vec3f) -> vec3f {
    let place = to_world(ray.origin + ray.direction * t);
    return lit(SURFACE_LIGHTING, frame.lights, color, false, met.normal, to_world(ray.direction), place);
}
