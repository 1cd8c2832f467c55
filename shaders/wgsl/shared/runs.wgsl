// The raycast compositor of one layer: one ray per pixel, front to back through the leaves of the draw list's octree.
//
// A ray goes from segment to segment of its lattice. The leaf around a segment's midpoint takes it and the following ones
// until the ray leaves the leaf, so that every segment is sampled at most once, however places are rounded. Empty leaves,
// and bricks and macro-cells that cannot change the pixel, are skipped.
//!import bricks macrocells pixel sees

// Consecutive visible macro-cells of a brick along the ray.
struct Run {
    // From and to; behind the eye if there is none.
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
        let is_seen = at.enter < leave && sees(pixel, cell_range(brick.first_range, cell_index(at)));
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
