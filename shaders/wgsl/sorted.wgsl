// The sorted compositor: one box per cell, back to front; the back faces start a march through the cell.
//
// Every fragment recomputes the pixel's ray, its stretch in the whole volume and its lattice, and takes the samples whose
// points lie in its cell's half-open box: cells share no sample and leave none out, whatever the rasteriser does at edges.
//!import bindings dither frame world

// Twin of `CellInstance` in layout.rs.
struct Cell {
    region_min: vec3f,
    pixels_from: u32,
    region_max: vec3f,
    pixels_to: u32,
    // texel = voxel * texel_scale + texel_offset
    texel_scale: vec3f,
    spare: f32,
    texel_offset: vec3f,
    spare_2: f32,
}

@group(0) @binding(CELLS) var<storage, read> cells: array<Cell>;

struct Proxy {
    @builtin(position) position: vec4f,
    @location(0) @interpolate(flat) region_min: vec3f,
    @location(1) @interpolate(flat) region_max: vec3f,
    @location(2) @interpolate(flat) texel_scale: vec3f,
    @location(3) @interpolate(flat) texel_offset: vec3f,
    @location(4) @interpolate(flat) pixels: vec2u,
}

// Corner `i` of a cube as one strip of 14 vertices, a bit per vertex and axis.
@vertex
fn proxy(@builtin(vertex_index) i: u32, @builtin(instance_index) instance: u32) -> Proxy {
    frame = frames[layer];
    let cell = cells[instance];
    // Where the map to the world mirrors, the strip is mirrored back, so that back faces stay that.
    let mirrors = dot(cross(frame.axes[0].xyz, frame.axes[1].xyz), frame.axes[2].xyz) < 0.0;
    let bits = (vec3u(0x287au, 0x02afu, 0x31e3u) >> vec3u(i)) ^ vec3u(u32(mirrors), 0u, 0u);
    let corner = select(cell.region_min, cell.region_max, (bits & vec3u(1u)) == vec3u(1u));

    // Outward by an eighth of a pixel at the box's far side, so that snapping to the raster loses no pixel. The same for
    // all corners: the box stays a convex box, and a pixel gets one back face.
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
    // Nothing is clipped but what is behind the eye: there is no depth buffer.
    out.position = select(vec4f(x, y, w - frame.near, w), vec4f(x, y, 0.5, 1.0), frame.orthographic != 0u);
    out.region_min = cell.region_min;
    out.region_max = cell.region_max;
    out.texel_scale = cell.texel_scale;
    out.texel_offset = cell.texel_offset;
    out.pixels = vec2u(cell.pixels_from, cell.pixels_to);
    return out;
}

// Whether the entry draws a pixel: another one may have it.
fn has_pixel(in: Proxy) -> bool {
    let threshold = dither(in.position.xy);
    return threshold >= in.pixels.x && threshold < in.pixels.y;
}
