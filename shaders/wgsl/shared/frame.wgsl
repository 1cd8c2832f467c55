// Settings of a frame, the same for all pixels. Twin of `FrameUniform` in layout.rs, which gives each field's unit.
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
    first_px: u32,
    adaptive_step: f32,
    // Of projections: 1 to add, 0 to mix; opacity, and the depth of a medium with this opacity.
    adds: f32,
    opacity: f32,
    reach: vec3f,
    flat_depth: f32,
    grid: vec4f,
    // Of isosurfaces, by ascending value: the normalised code at which each begins; colour and opacity.
    thresholds: array<vec4f, 2>,
    surfaces: array<vec4f, 8>,
    light_places: array<vec4f, 4>,
    // A voxel's vector along each axis in the scene's world, and the gradient of 1 per voxel there, but for its length. The first `w` is the
    // factor to a gradient per step.
    axes: array<vec4f, 3>,
    slopes: array<vec4f, 3>,
    zone_starts: array<vec4u, 4>,
    planes: array<vec4f, 14>,
    list_at: vec2u,
    // Difference of values below which the field is flat.
    flat: f32,
    spare: f32,
    // Of voxels read one by one: the number of the table's first code, the share of the table per number, and the greatest difference.
    first_slot: f32,
    per_slot: f32,
    farthest_slots: f32,
    // Factor from stored gradients to differences of values.
    gradient_scale: f32,
    plane_count: u32,
    jitter_phase: u32,
    // The code of a texel of 1; the table's first code and its last entry; and counts of `opaque_before` per code.
    slot_codes: f32,
    first_code: f32,
    last_entry: f32,
    counts_per_code: u32,
    // 1 if isosurfaces opened by a clip are capped.
    caps: u32,
    // The code at which the first isosurface begins.
    threshold_code: f32,
    // For loops over layers: where the layer's parts of the shared buffers begin (ranges, places of the table, counts), and flags.
    firsts: vec4u,
}

// Not a uniform: lavapipe compiles those that steer loops into the shader, and so would recompile it whenever the camera moves.
@group(0) @binding(FRAMES) var<storage, read> frames: array<Frame, LAYERS>;

// The layer's frame, read once by each entry point: in a loop, lavapipe re-reads storage each round, lane by lane, which made frames take 1.3
// times as long.
var<private> frame: Frame;
