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
    // Pixels with this threshold or a greater one draw the next brick instead.
    pixels_to: u32,
}

const NO_RANGES: u32 = 0xffffffffu;
@group(0) @binding(1) var<storage, read> bricks: array<RayBrick>;

// Where the ray leaves a box that it is in.
fn leaving(ray: Ray, low: vec3f, size: vec3f) -> f32 {
    let t = (select(low, low + size, ray.direction > vec3f(0.0)) - ray.origin) * ray.inverse;
    return min(min(t.x, t.y), t.z);
}

// Which brick a leaf's number stands for in a pixel. While one fades in, pixels that it does not have yet draw the next one.
fn brick_number(leaf: u32, threshold: u32) -> u32 {
    let first = leaf - 1u;
    return first + u32(threshold >= bricks[first].pixels_to);
}

// Macro-cells of a brick that are seen, one after the other along the ray.
struct Run {
    // From where to where; behind the eye if there is none.
    enter: f32,
    end: f32,
    // The first cell past it.
    cells: CellWalk,
}

// The next run from a cell on, before the ray leaves the leaf.
fn next_run(ray: Ray, pixel: Pixel, brick: RayBrick, first: CellWalk, leave: f32) -> Run {
    var run = Run(leave, -1.0, first);
    var is_in_run = false;
    var is_searching = true;
    while (is_searching) {
        let at = run.cells;
        let is_seen = at.enter < leave && sees(pixel, ranges[brick.first_range + cell_index(at)]);
        run.enter = select(run.enter, at.enter, is_seen && !is_in_run);
        run.end = select(run.end, at.enter, is_in_run);
        is_searching = at.enter < leave && (is_seen || !is_in_run);
        is_in_run = is_seen;
        if (is_searching) {
            run.cells = next_cell(ray, at, brick.texel_scale);
        }
    }
    return run;
}
