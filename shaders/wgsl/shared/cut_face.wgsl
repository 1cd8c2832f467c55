// Where a ray enters the shown region through a clip plane or a side of the clip box, whose normal then lights the first voxel. Twin of the volume
// crate's `cut_face`.
//!import context frame ray world

const CUT_ALONE: f32 = 0.5;
const CUT_GONE: f32 = 1.5;

// A ray's entry cut, from `cut_face`; its unit normal, turned to the eye; and texels of a brick behind it per distance along the ray.
struct Met {
    cut: vec4f,
    normal: vec3f,
    rate: f32,
}

// The ray's cut, found once: every part of a loop's body costs time in each round.
var<private> met: Met;

fn meet_cut(ray: Ray, eye: f32) {
    met.cut = cut_face(ray, eye);
    // Without a cut everything is far behind it.
    met.cut.w = select(met.cut.w, -1e30, all(met.cut.xyz == vec3f(0.0)));
    met.normal = -normalize(gradient_to_world(met.cut.xyz));
}

// Needed before lighting in a brick with `scale` texels per level-0 voxel.
fn meet_brick(ray: Ray, scale: vec3f) {
    met.rate = rate_in(met.cut, ray, scale);
}

fn rate_in(cut: vec4f, ray: Ray, scale: vec3f) -> f32 {
    let rate = dot(cut.xyz, ray.direction) / length(cut.xyz / scale);
    return select(rate, 1.0, all(cut.xyz == vec3f(0.0)));
}

// The met cut's share of the normal at a distance.
fn met_share(t: f32) -> f32 {
    return clamp((CUT_GONE - (t - met.cut.w) * met.rate) / (CUT_GONE - CUT_ALONE), 0.0, 1.0);
}

// The gradient in voxel space of the height above the cut, and the entry distance; no gradient for an entry without a cut. `eye` is the distance of
// the eye, which lies ahead of the ray's origin where the lattice is moved.
fn cut_face(ray: Ray, eye: f32) -> vec4f {
    var cut = vec4f(0.0, 0.0, 0.0, eye);
    for (var a = 0u; a < 3u; a++) {
        let is_up = ray.direction[a] > 0.0;
        let side = (select(frame.shown_high[a], frame.shown_low[a], is_up) - ray.origin[a]) * ray.inverse[a];
        let cut_off = select(frame.extent[a] - frame.shown_high[a], frame.shown_low[a], is_up);
        var slope = vec3f(0.0);
        slope[a] = select(0.0, sign(ray.direction[a]), cut_off > 0.0);
        cut = select(cut, vec4f(slope, side), side > cut.w);
    }
    for (var i = 0u; i < frame.plane_count; i++) {
        let plane = frames[layer].planes[i];
        let rise = dot(plane.xyz, ray.direction);
        let t = -(dot(plane.xyz, ray.origin - frame.eye) + plane.w) / max(rise, 1e-20);
        cut = select(cut, vec4f(plane.xyz, t), rise > 1e-20 && t > cut.w);
    }
    return cut;
}

// Whether a ray's stretch from `start` begins on the met cut, and caps are enabled.
fn is_at_cut(start: f32) -> bool {
    // Rounding moves a distance by less; behind the cut, a layer of meshes bounds the stretch.
    let is_here = abs(start - met.cut.w) <= 0.01 * frame.step + 1e-6 * abs(start);
    return frame.caps != 0u && is_here && any(met.cut.xyz != vec3f(0.0));
}

// A place's unit normal, if it is not flat, mixed with the met cut's; both turned to the eye.
fn cut_normal(share: f32, is_flat: bool, normal: vec3f, view: vec3f) -> vec3f {
    return normalize(mix(select(normal, -view, is_flat), met.normal, share));
}
