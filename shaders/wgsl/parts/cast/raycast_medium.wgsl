// Segments evaluated from end to end, each in the brick that owns it; the known field carries over from one segment of a run to the next.
//!import bricks caps cut_face field lattice medium sight take traverse

const SPANS: bool = CURVE != MIDDLE || HAS_SURFACES;
const REACHES: bool = false;

fn pixel_first(seen: Sight) -> Pixel {
    meet_cut(seen.ray, seen.eye);
    var pixel = pixel_start();
    pixel.rank = first_rank(seen.stretch.x);
    return pixel;
}

fn pixel_skipping(pixel: Pixel) -> Pixel {
    return Pixel(pixel.color, pixel.transmittance, max(select(pixel.rank, -1, HAS_INVALID), -1));
}

fn take_run(
    pixel: ptr<function, Pixel>, walk: ptr<function, Walk>, brick: RayBrick, field: Field, ray: Ray, stretch: vec2f, until: f32
) {
    var known: Known;
    while ((*walk).middle < until && !is_zone_left(*walk) && !is_final(*pixel)) {
        let taken = take(*pixel, known, field, ray, (*walk).start, (*walk).end);
        *pixel = taken.pixel;
        known = taken.known;
        *walk = walk_on(*walk, stretch);
    }
}

fn pixel_last(pixel: Pixel, field: Field, ray: Ray) -> vec4f {
    return pixel_end(pixel);
}
