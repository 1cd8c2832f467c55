// Bricks' macro-cells: boxes of 8^3 voxels of the brick's level, each with the least and greatest code (low and high half
// of a word) that a sample in it can have. Written when a brick is uploaded; what they mean is asked ray by ray.
//!import bindings context frame ray

const CELL_EDGE: f32 = 8.0;
@group(0) @binding(RANGES) var<storage, read> ranges: array<u32>;

// What a macro-cell of a brick can have.
fn cell_range(first: u32, cell: u32) -> u32 {
    return ranges[FIRST_RANGE + first + cell];
}

// A ray's way from macro-cell to macro-cell of a brick (Amanatides and Woo, A Fast Voxel Traversal Algorithm, 1987).
struct CellWalk {
    // The cell, and where the ray enters it.
    at: vec3f,
    enter: f32,
    // Where the ray passes the cell's far faces.
    passes: vec3f,
}

// From the cell at distance `t`, of a brick whose core begins at `low`, with `scale` brick voxels per level-0 voxel.
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

// The cell's place in its brick's ranges. Rounding can lead past the last cell, where what is in that one stands for it.
fn cell_index(cells: CellWalk) -> u32 {
    let along = f32(frame.macro_cells);
    let at = clamp(cells.at, vec3f(0.0), vec3f(along - 1.0));
    return u32((at.z * along + at.y) * along + at.x);
}
