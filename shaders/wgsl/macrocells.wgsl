// Bricks' macro-cells: boxes of 8^3 voxels of the brick's level, each with the least and greatest code (low and high half
// of a word) that a sample in it can have. Written when a brick is uploaded; what they mean is asked sample by sample.
const CELL_EDGE: f32 = 8.0;
@group(0) @binding(7) var<storage, read> ranges: array<u32>;

struct MacroCell {
    low: vec3f,
    size: vec3f,
    // In its brick's ranges.
    index: u32,
}

// The macro-cell at a point of a brick whose core begins at `low`, with `scale` brick voxels per level-0 voxel.
fn macro_cell(point: vec3f, low: vec3f, scale: vec3f) -> MacroCell {
    let size = CELL_EDGE / scale;
    let along = f32(frame.macro_cells);
    let at = clamp(floor((point - low) / size), vec3f(0.0), vec3f(along - 1.0));
    return MacroCell(low + at * size, size, u32((at.z * along + at.y) * along + at.x));
}
