// The raycast compositor: one ray per pixel, front to back through the leaves of the draw list's octree.
//
// A ray goes from segment to segment of its lattice. The leaf that holds a segment's midpoint takes it and those that follow
// up to where the ray leaves the leaf; so every segment is sampled at most once, whatever is rounded. Leaves where nothing
// is drawn, bricks and macro-cells that cannot change the pixel are leapt over.

// Twin of `RayBrick` in layout.rs.
struct RayBrick {
    // texel = voxel * texel_scale + texel_offset
    texel_scale: vec3f,
    // Of the brick's first macro-cell in `ranges`; NO_RANGES where all of them are seen.
    first_range: u32,
    texel_offset: vec3f,
    // Of all the brick's macro-cells together.
    range: u32,
    // Low corner of the brick's core, level-0 voxels.
    low: vec3f,
    spare: u32,
}

const NO_RANGES: u32 = 0xffffffffu;
@group(0) @binding(1) var<storage, read> bricks: array<RayBrick>;

@fragment
fn raycast(@builtin(position) position: vec4f) -> @location(0) vec4f {
    let ray = pixel_ray(position.xy);
    let whole = clip(ray, frame.shown_low, frame.shown_high);
    let t_in = max(whole.x, 0.0);
    let t_out = whole.y;
    var pixel = pixel_start();
    if (t_in < t_out) {
        var walk = walk_from(t_in);
        var part = segment(walk, t_in, t_out);
        var middle = 0.5 * (part.x + part.y);
        loop {
            let place = find_place(ray.origin + ray.direction * middle);
            let leave = min(clip(ray, place.low, place.low + place.size).y, t_out);
            var brick: RayBrick;
            var is_brick_seen = place.number != 0u;
            if (is_brick_seen) {
                mark(place.number - 1u, pixel);
                brick = bricks[place.number - 1u];
                is_brick_seen = sees(pixel, brick.range);
            }
            // Each stretch takes at least the segment it starts with, even where rounding puts its end before it.
            loop {
                var end = leave;
                var is_seen = is_brick_seen;
                if (is_seen && brick.first_range != NO_RANGES) {
                    let cell = macro_cell(ray.origin + ray.direction * middle, brick.low, brick.texel_scale);
                    end = min(end, clip(ray, cell.low, cell.low + cell.size).y);
                    is_seen = sees(pixel, ranges[brick.first_range + cell.index]);
                }
                if (!is_seen) {
                    walk = walk_past(walk, end);
                    part = segment(walk, t_in, t_out);
                    middle = 0.5 * (part.x + part.y);
                } else {
                    loop {
                        let point = ray.origin + ray.direction * middle;
                        let value = sample_atlas(point * brick.texel_scale + brick.texel_offset);
                        if (part.y > part.x && value >= 0.0) {
                            pixel = accumulate(pixel, value, part.y - part.x);
                        }
                        walk = walk_on(walk);
                        part = segment(walk, t_in, t_out);
                        middle = 0.5 * (part.x + part.y);
                        if (middle >= end || is_final(pixel)) {
                            break;
                        }
                    }
                }
                if (middle >= leave || is_final(pixel)) {
                    break;
                }
            }
            if (part.x >= t_out || is_final(pixel)) {
                break;
            }
        }
    }
    return pixel_end(pixel);
}
