// Macro-cells of bricks: boxes of 8^3 voxels of the brick's level, each with the least and greatest code (low and high
// half of a word) of samples in it. Written when a brick is uploaded, and interpreted ray by ray.
//!import bindings context frame ray

const CELL_EDGE: f32 = 8.0;
@group(0) @binding(RANGES) var<storage, read> ranges: array<u32>;

// The range of codes of a brick's macro-cell.
fn cell_range(first: u32, cell: u32) -> u32 {
    return ranges[FIRST_RANGE + first + cell];
}

// A ray's walk through the macro-cells of a brick (Amanatides and Woo, A Fast Voxel Traversal Algorithm, 1987).
struct CellWalk {
    // The cell, and where the ray enters it.
    at: vec3f,
    enter: f32,
    // Where the ray passes the cell's far faces.
    passes: vec3f,
}

// The cell at distance `t`, in a brick with its core from `low` on and `scale` brick voxels per level-0 voxel.
fn first_cell(ray: Ray, t: f32, low: vec3f, scale: vec3f) -> CellWalk {
    let size = CELL_EDGE / scale;
    let at = clamp(floor((ray.origin + ray.direction * t - low) / size), vec3f(0.0), vec3f(f32(frame.macro_cells) - 1.0));
    let faces = low + (at + max(sign(ray.direction), vec3f(0.0))) * size;
    return CellWalk(at, t, (faces - ray.origin) * ray.inverse);
}

fn next_cell(ray: Ray, cells: CellWalk, scale: vec3f) -> CellWalk {
    let leave = min(min(cells.passes.x, cells.passes.y), cells.passes.z);
    let crosses = cells.passes == vec3f(leave);
    let at = cells.at + select(vec3f(0.0), sign(ray.direction), crosses);
    let further = select(vec3f(0.0), abs(CELL_EDGE / scale * ray.inverse), crosses);
    return CellWalk(at, leave, cells.passes + further);
}

// The cell's index in its brick's ranges. Rounding can lead past the last cell, which then stands in.
fn cell_index(cells: CellWalk) -> u32 {
    let along = f32(frame.macro_cells);
    let at = clamp(cells.at, vec3f(0.0), vec3f(along - 1.0));
    return u32((at.z * along + at.y) * along + at.x);
}
