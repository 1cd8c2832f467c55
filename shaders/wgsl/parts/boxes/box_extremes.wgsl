// Box samples of coarse bricks: all texels touched by a segment's box count. Twin of the volume crate's `extremes`. `texel` is the segment's middle,
// `way` goes from one of its ends to the other, and `scale` is the brick's texels per level-0 voxel.
//!import atlas frame no_value pixel

const HAS_BOXES: bool = true;

fn take_box(pixel: Pixel, texel: vec3f, way: vec3f, scale: vec3f, length: f32) -> Pixel {
    let along = abs(way);
    let longest = max(max(along.x, along.y), max(along.z, 1.0));
    let half = 0.5 * along / longest + BOX_REACH * scale;
    // Rounding never leads into another slot.
    let slot = floor(texel / frame.slot_edge) * frame.slot_edge;
    let low = max(floor(texel - half), slot);
    let high = min(floor(texel + half), slot + frame.slot_edge - 1.0);
    var taken = pixel;
    for (var i = 0u; i < 8u; i++) {
        let bit = vec3u(i & 1u, (i >> 1u) & 1u, i >> 2u);
        taken = take_texel(taken, select(low, high, bit == vec3u(1u)), length);
    }
    // Most boxes touch only their corner texels.
    let is_wide = any(high > low + 1.0);
    for (var z = low.z; is_wide && z <= high.z; z += 1.0) {
        for (var y = low.y; y <= high.y; y += 1.0) {
            for (var x = low.x; x <= high.x; x += 1.0) {
                taken = take_texel(taken, vec3f(x, y, z), length);
            }
        }
    }
    return taken;
}

fn take_texel(pixel: Pixel, texel: vec3f, length: f32) -> Pixel {
    let value = texel_value(texel);
    if (has_value(value)) {
        return accumulate(pixel, value, length);
    }
    return pixel;
}
