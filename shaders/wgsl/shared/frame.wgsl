// What is the same for all of a frame. Twin of `FrameUniform` in layout.rs, where each field's unit is given.
//!import bindings context

struct Frame {
    eye: vec3f,
    step: f32,
    forward: vec3f,
    slack: f32,
    right: vec3f,
    half_width: f32,
    up: vec3f,
    half_height: f32,
    clip_x: vec3f,
    near: f32,
    clip_y: vec3f,
    pixel_share: f32,
    clip_w: vec3f,
    per_unit_distance: f32,
    extent: vec3f,
    last_code: f32,
    spacing: vec3f,
    orthographic: u32,
    texel: vec3f,
    invert: f32,
    background: vec3f,
    tree_depth: u32,
    size_px: vec2f,
    last_place: f32,
    sum_unit: f32,
    root_size: vec3f,
    macro_cells: u32,
    shown_low: vec3f,
    slot_edge: f32,
    shown_high: vec3f,
    lights: u32,
    surface_color: vec3f,
    threshold: f32,
    lean: vec2f,
    jitter: u32,
    jitter_seed: u32,
    mesh_far: f32,
    gradient_edge: f32,
    first_gradient: f32,
    grid_at: u32,
    first_row: u32,
    adaptive_step: f32,
    // Of projections: what adds is 1, what mixes 0; opacity, and the depth of a medium of that opacity.
    adds: f32,
    opacity: f32,
    reach: vec3f,
    flat_depth: f32,
    grid: vec4f,
    // Of surfaces, in the order of their values: the normalised code from which on a place is past each; colour and opacity.
    thresholds: array<vec4f, 2>,
    surfaces: array<vec4f, 8>,
    light_places: array<vec4f, 4>,
    // What a voxel along each axis is in the scene's world, and a gradient of 1 to a voxel there, but for its length. The first `w` is
    // what that has to be multiplied by to be by the step.
    axes: array<vec4f, 3>,
    slopes: array<vec4f, 3>,
    zone_starts: array<vec4u, 4>,
    planes: array<vec4f, 14>,
    list_at: vec2u,
    // The difference of values below which the field is flat.
    flat: f32,
    spare: f32,
    // Of voxels read one by one: the number of the table's first code, how much of the table is between a number and the next, and the greatest
    // difference.
    first_slot: f32,
    per_slot: f32,
    farthest_slots: f32,
    // What stored gradients have to be multiplied by to be differences of values.
    gradient_scale: f32,
    plane_count: u32,
    jitter_phase: u32,
    // The codes of a texel of 1; the table's first code, and its last entry; and counts of `opaque_before` from a code to the next.
    slot_codes: f32,
    first_code: f32,
    last_entry: f32,
    counts_per_code: u32,
    // 1 if isosurfaces are capped where a clip opens them.
    caps: u32,
    // The code at which the first isosurface begins.
    threshold_code: f32,
    // Of several layers that loops go over, where the layer's parts of the shared buffers begin (ranges, places of the table, counts), and flags.
    firsts: vec4u,
}

// Not a uniform: lavapipe builds those that steer loops into the shader, and compiles it anew whenever the camera moves.
@group(0) @binding(FRAMES) var<storage, read> frames: array<Frame, LAYERS>;

// The layer's. Read once, by each entry point: in a loop, lavapipe reads storage anew each round, lane by lane, which made frames take 1.3
// times as long.
var<private> frame: Frame;
