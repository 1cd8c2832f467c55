// The sorted compositor: one box per cell, back to front; the back faces start a march through the cell.
//
// Every fragment recomputes the pixel's ray, its stretch in the whole volume and its lattice, and takes the samples in its cell's
// half-open box: cells share no sample and omit none, whatever the rasteriser does at edges.
//!import Cell CellBrick bindings context dither frame ray world

@group(0) @binding(CELLS) var<storage, read> cells: array<Cell>;
// For each cell, one per layer.
@group(0) @binding(CELL_BRICKS) var<storage, read> cell_bricks: array<CellBrick>;

struct Proxy {
    @builtin(position) position: vec4f,
    @location(0) @interpolate(flat) region_min: vec3f,
    @location(1) @interpolate(flat) region_max: vec3f,
    @location(2) @interpolate(flat) pixels: vec2u,
    @location(3) @interpolate(flat) first_brick: u32,
    // The first brick. (If fragments read it from storage, lavapipe would re-read it in each round of a loop.)
    @location(4) @interpolate(flat) texel_scale: vec3f,
    @location(5) @interpolate(flat) texel_offset: vec3f,
}

// Corner `i` of a cube as one strip of 14 vertices, a bit per vertex and axis.
@vertex
fn proxy(@builtin(vertex_index) i: u32, @builtin(instance_index) instance: u32) -> Proxy {
    frame = frames[layer];
    let cell = cells[instance];
    // If the map to the world mirrors, the strip is mirrored back to keep its back faces.
    let mirrors = dot(cross(frame.axes[0].xyz, frame.axes[1].xyz), frame.axes[2].xyz) < 0.0;
    let bits = (vec3u(0x287au, 0x02afu, 0x31e3u) >> vec3u(i)) ^ vec3u(u32(mirrors), 0u, 0u);
    let corner = select(cell.region_min, cell.region_max, (bits & vec3u(1u)) == vec3u(1u));

    // Outward by an eighth of a pixel at the box's far side, so that snapping to the raster loses no pixel. All corners move alike: the
    // box stays convex, and a pixel gets one back face.
    let half_size = (cell.region_max - cell.region_min) * 0.5;
    let centre = cell.region_min + half_size - frame.eye;
    let edges = vec3f(length(frame.axes[0].xyz), length(frame.axes[1].xyz), length(frame.axes[2].xyz));
    let distance = length(to_world(centre)) + dot(half_size, edges);
    let grow = frame.pixel_share * select(distance, 1.0, frame.orthographic != 0u) * frame.reach + frame.slack;
    let from_eye = corner - frame.eye + select(-grow, grow, corner == cell.region_max);

    var out: Proxy;
    let x = dot(from_eye, frame.clip_x);
    let y = dot(from_eye, frame.clip_y);
    let w = dot(from_eye, frame.clip_w);
    // Only places behind the eye are clipped: there is no depth buffer.
    out.position = select(vec4f(x, y, w - frame.near, w), vec4f(x, y, 0.5, 1.0), frame.orthographic != 0u);
    out.region_min = cell.region_min;
    out.region_max = cell.region_max;
    out.pixels = vec2u(cell.pixels_from, cell.pixels_to);
    out.first_brick = instance * LAYERS;
    out.texel_scale = cell_bricks[out.first_brick].texel_scale;
    out.texel_offset = cell_bricks[out.first_brick].texel_offset;
    return out;
}

// The drawn cell.
struct Box {
    // Bounds of its segments' midpoints.
    low: vec3f,
    high: vec3f,
    centre: vec3f,
    first_brick: u32,
}

var<private> drawn: Box;

fn box_of(in: Proxy) -> Box {
    // The volume's own faces are no borders: a point rounded past one still belongs to the cell inside.
    let low = select(in.region_min, vec3f(-1e30), in.region_min <= vec3f(0.0));
    let high = select(in.region_max, vec3f(1e30), in.region_max >= frame.extent);
    return Box(low, high, (in.region_min + in.region_max) * 0.5, in.first_brick);
}

fn is_in_box(box: Box, point: vec3f) -> bool {
    return all(point >= box.low) && all(point < box.high);
}

// The part of a stretch with midpoints of the cell's segments: its box, widened by the rounding of points. Empty where the entry does
// not draw the pixel.
fn own_stretch(in: Proxy, ray: Ray, stretch: vec2f) -> vec2f {
    let own = clip(ray, in.region_min - frame.slack, in.region_max + frame.slack);
    let first = max(own.x, stretch.x);
    return vec2f(first, select(first, min(own.y, stretch.y), has_pixel(in)));
}

// Whether this entry draws a pixel, and not another.
fn has_pixel(in: Proxy) -> bool {
    let threshold = dither(in.position.xy);
    return threshold >= in.pixels.x && threshold < in.pixels.y;
}
