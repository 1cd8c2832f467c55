// A search of each segment from end to end; the ray's side carries over from brick to brick, also across skipped stretches.
//!import bricks field lattice sight surface traverse

const SPANS: bool = true;
const REACHES: bool = true;

fn pixel_first(seen: Sight) -> Pixel {
    return pixel_before(seen);
}

fn pixel_skipping(pixel: Pixel) -> Pixel {
    return Pixel(pixel.transmittance, select(pixel.side, 0.0, HAS_INVALID), pixel.start, pixel.end);
}

fn take_run(
    pixel: ptr<function, Pixel>, walk: ptr<function, Walk>, brick: RayBrick, field: Field, ray: Ray, stretch: vec2f, until: f32
) {
    if (abs((*pixel).side) < 1.0 && (*walk).middle < until) {
        *pixel = begin(*pixel, field, (*walk).start, stretch.x);
    }
    while ((*walk).middle < until && !is_zone_left(*walk) && !is_final(*pixel)) {
        *pixel = search(*pixel, field, (*walk).start, (*walk).end);
        *walk = walk_on(*walk, stretch);
    }
}

fn pixel_last(pixel: Pixel, field: Field, ray: Ray) -> vec4f {
    return pixel_in(pixel, field, ray);
}
