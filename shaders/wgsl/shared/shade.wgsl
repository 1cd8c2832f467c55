// Lighting of places in the field. Twin of the volume crate's `Lighting`. Code ruled out by `LIGHTING` is not part of the compiled
// shader.
//!import frame lighting

// Lighting models.
const UNLIT: u32 = 0u;
const PHONG: u32 = 1u;
const BLINN_PHONG: u32 = 2u;
const TONE: u32 = 3u;

const COOL: vec3f = vec3f(0.0, 0.0, 0.4);
const WARM: vec3f = vec3f(0.3, 0.3, 0.0);
const TONE_KEPT: vec2f = vec2f(0.3, 0.7);

fn toned(color: vec3f, cosine: f32) -> vec3f {
    return mix(COOL + color * TONE_KEPT.x, WARM + color * TONE_KEPT.y, 0.5 * (1.0 + cosine));
}

// The unit normal along a gradient of any length, turned to the eye. `view` is the ray's unit direction.
fn normal_of(gradient: vec3f, view: vec3f) -> vec3f {
    let along = normalize(gradient);
    return select(along, -along, dot(along, view) > SIDEWAYS);
}

// A colour lit at a place, under a unit normal; all in the space of `light_places`. `view` is the ray's unit direction.
fn lit(lighting: u32, lights: u32, color: vec3f, is_flat: bool, normal: vec3f, view: vec3f, place: vec3f) -> vec3f {
    if (is_flat) {
        if (lighting == TONE) {
            return toned(color, 1.0);
        }
        return color * (AMBIENT + DIFFUSE);
    }
    var diffuse = 0.0;
    var specular = 0.0;
    var facing = -1.0;
    for (var i = 0u; i < max(lights, 1u); i++) {
        var to_light = -view;
        if (lights > 0u) {
            to_light = normalize(frames[layer].light_places[i].xyz - place);
        }
        let cosine = dot(normal, to_light);
        facing = max(facing, cosine);
        if (cosine > 0.0 && lighting != TONE) {
            diffuse += cosine;
            var reflected = 0.0;
            if (lighting == PHONG) {
                reflected = dot(normal * (2.0 * cosine) - to_light, -view);
            } else {
                reflected = dot(normal, normalize(to_light - view));
            }
            specular += tenth_power(clamp(reflected, 0.0, 1.0));
        }
    }
    if (lighting == TONE) {
        return toned(color, facing);
    }
    return color * (AMBIENT + DIFFUSE * diffuse) + SPECULAR * specular;
}
