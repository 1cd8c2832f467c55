// A sample in the middle of each segment.
//!import atlas boxes bricks field lattice no_value pixel sight traverse

const SPANS: bool = false;
const REACHES: bool = false;

fn pixel_first(seen: Sight) -> Pixel {
    return pixel_start();
}

fn pixel_skipping(pixel: Pixel) -> Pixel {
    return pixel;
}

fn take_run(
    pixel: ptr<function, Pixel>, walk: ptr<function, Walk>, brick: RayBrick, field: Field, ray: Ray, stretch: vec2f, until: f32
) {
    let base = (*walk).middle;
    let texel = (ray.origin + ray.direction * base) * brick.texel_scale + brick.texel_offset;
    let along = ray.direction * brick.texel_scale;
    // A loop of its own: on lavapipe every part of a loop's body costs time in each round, even under an `if` not taken.
    let is_coarse = HAS_BOXES && any(brick.texel_scale < vec3f(1.0));
    while (is_coarse && (*walk).middle < until && !is_zone_left(*walk) && !is_final(*pixel)) {
        let length = (*walk).end - (*walk).start;
        *pixel = take_box(*pixel, texel + along * ((*walk).middle - base), along * length, brick.texel_scale, length);
        *walk = walk_on(*walk, stretch);
    }
    while ((*walk).middle < until && !is_zone_left(*walk) && !is_final(*pixel)) {
        let value = sample_atlas(texel + along * ((*walk).middle - base));
        if (has_value(value)) {
            *pixel = accumulate(*pixel, value, (*walk).end - (*walk).start);
        }
        *walk = walk_on(*walk, stretch);
    }
}

fn pixel_last(pixel: Pixel, field: Field, ray: Ray) -> vec4f {
    return pixel_end(pixel);
}
