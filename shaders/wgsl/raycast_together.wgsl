// Several volumes: one ray per pixel, front to back along the lattice. In each segment every volume puts in what it has (see
// `volume.wgsl`), and all that is there is seen through together. Where none of them shows anything, the ray leaps to where the
// first of them may again. Surfaces cut a segment, and it is seen through piece by piece. The rule is written down beside its CPU
// twin, the volume crate's `look`.

// A ray's way through one volume.
struct Way {
    ray: Ray,
    // Where it is in what is shown of the volume.
    stretch: vec2f,
    // Where it leaves the leaf that it has come to last, and the macro-cell.
    leave: f32,
    until: f32,
    // Whether anything may be seen in them.
    is_leaf_seen: bool,
    is_seen: bool,
    brick: RayBrick,
    // Where there are surfaces (`IS_LAYERED`): its part of the segment, and what it has there, colour times depth or opacity, and depth.
    part: vec2f,
    color: vec3f,
    depth: f32,
    // Of its own surfaces, how many it is past, and how many at the part's end; negative where that is not known.
    rank: i32,
    last: i32,
    // Where the next one is passed; far away if none is.
    crossing: f32,
    // Ticks of the segments for which macro-cells were looked at.
    stride: u32,
}

// What a segment has.
struct Together {
    // Of volumes that mix: colour times depth, and depth.
    color: vec3f,
    depth: f32,
    // Of volumes that add.
    glow: vec3f,
    // Nothing is seen before.
    empty_until: f32,
    READ
}

fn see(pixel: Pixel, together: Together) -> Pixel {
    let left = exp2(-together.depth);
    let hidden = 1.0 - left;
    let nats = together.depth * 0.69314718;
    // Of thin media a difference would be what rounding leaves.
    let is_thin = nats < 1e-3;
    let dimmed = select(hidden / nats, 1.0 - 0.5 * nats, is_thin);
    let mixed = together.color * (0.69314718 * dimmed);
    let passed = select(left, 1.0 - nats * dimmed, is_thin);
    return Pixel(pixel.color + pixel.transmittance * (mixed + together.glow * dimmed), pixel.transmittance * passed);
}

@fragment
fn raycast(@builtin(position) position: vec4f) -> @location(0) vec4f {
    let threshold = dither(position.xy);
    var whole = vec2f(1e30, 0.0);
    BEGIN
    var pixel = pixel_start();
    var walk = enter_zone(tick_at(whole.x), 0u, whole);
    while (walk.start < whole.y && !is_final(pixel)) {
        if (is_zone_left(walk)) {
            walk = next_zone(walk, whole);
        }
        var together: Together;
        together.empty_until = 1e30;
        LOOK
        COMBINE
        SEE
        if (together.empty_until > walk.end) {
            walk = walk_past(walk, together.empty_until, whole);
        } else {
            walk = walk_on(walk, whole);
        }
    }
    return pixel_end(pixel);
}
