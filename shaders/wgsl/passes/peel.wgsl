// The next layer of the meshes: the nearest triangle behind the layer before, and the first among equally near ones.
//
// Distances are not interpolated by the rasteriser: each fragment intersects its pixel's ray with its triangle's plane, so that a
// layer lies exactly on the ray's samples and has the same distance whenever it is computed.
//!import MeshLook MeshVertex bindings frame hidden lighting ray

const PLAIN_COLOR: f32 = 0.8;
const HAS_COLOR: u32 = 1u;
const HAS_COLORS: u32 = 2u;
const HAS_NORMALS: u32 = 4u;
const IS_LIT: u32 = 8u;

@group(0) @binding(VERTICES) var<storage, read> vertices: array<MeshVertex>;
@group(0) @binding(CORNERS) var<storage, read> corners: array<u32>;
@group(0) @binding(LOOKS) var<storage, read> looks: array<MeshLook>;
@group(1) @binding(NEAR_LAYER) var near_layer: texture_depth_2d;
@group(1) @binding(NEAR_NUMBER) var near_number: texture_2d<u32>;
@group(1) @binding(FRONT) var front: texture_2d<f32>;

struct Corner {
    @builtin(position) position: vec4f,
    @location(0) @interpolate(flat) triangle: u32,
    @location(1) @interpolate(flat) look: u32,
}

@vertex
fn corner(@builtin(vertex_index) i: u32, @builtin(instance_index) look: u32) -> Corner {
    frame = frames[layer];
    let from_eye = vertices[corners[i]].place / frame.spacing - frame.eye;
    let x = dot(from_eye, frame.clip_x);
    let y = dot(from_eye, frame.clip_y);
    let w = dot(from_eye, frame.clip_w);
    // Only places behind the eye are clipped; fragments write their own depths.
    let in_perspective = vec4f(x, y, w - frame.near, w);
    return Corner(select(in_perspective, vec4f(x, y, w / frame.mesh_far, 1.0), frame.orthographic != 0u), i / 3u, look);
}

struct Layer {
    // Premultiplied.
    @location(0) color: vec4f,
    // One more than the triangle's index, counted over all meshes.
    @location(1) number: u32,
    @builtin(frag_depth) depth: f32,
}

@fragment
fn peel(in: Corner) -> Layer {
    frame = frames[layer];
    let pixel = vec2i(in.position.xy);
    let ray = pixel_ray(in.position.xy);
    let origin = ray.origin * frame.spacing;
    let direction = ray.direction * frame.spacing;
    let a = vertices[corners[3u * in.triangle]];
    let b = vertices[corners[3u * in.triangle + 1u]];
    let c = vertices[corners[3u * in.triangle + 2u]];

    // Möller and Trumbore, Fast, Minimum Storage Ray/Triangle Intersection, 1997.
    let to_b = b.place - a.place;
    let to_c = c.place - a.place;
    let from_a = origin - a.place;
    let across = cross(direction, to_c);
    let area = dot(to_b, across);
    let inverse = 1.0 / select(area, 1e-30, abs(area) < 1e-30);
    let turned = cross(from_a, to_b);
    // The rasteriser's coverage may exceed the triangle by a hair: there its edge is seen.
    let of_b = clamp(dot(from_a, across) * inverse, 0.0, 1.0);
    let of_c = clamp(dot(direction, turned) * inverse, 0.0, 1.0 - of_b);
    let weights = vec3f(1.0 - of_b - of_c, of_b, of_c);
    let ends = vec3f(dot(a.place - origin, direction), dot(b.place - origin, direction), dot(c.place - origin, direction));
    let nearest = min(min(ends.x, ends.y), ends.z);
    let farthest = max(max(ends.x, ends.y), ends.z);
    let t = clamp(dot(to_c, turned) * inverse, nearest, farthest);

    let number = in.triangle + 1u;
    let depth = t / frame.mesh_far;
    let near = textureLoad(near_layer, pixel, 0);
    let is_before = depth < near || (depth == near && number <= textureLoad(near_number, pixel, 0).x);
    if (t <= 0.0 || is_before || is_opaque(textureLoad(front, pixel, 0).a)) {
        discard;
    }

    let look = looks[in.look];
    var color = vec3f(PLAIN_COLOR);
    if ((look.flags & HAS_COLORS) != 0u) {
        color = weights.x * unpack4x8unorm(a.color).xyz + weights.y * unpack4x8unorm(b.color).xyz
            + weights.z * unpack4x8unorm(c.color).xyz;
    }
    color = select(color, look.color, (look.flags & HAS_COLOR) != 0u);
    var normal = vec3f(0.0);
    if ((look.flags & HAS_NORMALS) != 0u) {
        normal = weights.x * a.normal + weights.y * b.normal + weights.z * c.normal;
    }
    if (dot(normal, normal) == 0.0) {
        normal = cross(to_b, to_c);
    }
    let size = length(normal);
    let cosine = min(abs(dot(normal, direction)) / max(size, 1e-30), 1.0);
    // A triangle without area has no normal, and shows its colour as if it faced the eye.
    let share = AMBIENT + DIFFUSE * select(1.0, cosine, size > 0.0);
    let white = select(0.0, SPECULAR * tenth_power(cosine), size > 0.0);
    color = select(color, share * color + white, (look.flags & IS_LIT) != 0u);
    return Layer(vec4f(color, 1.0) * look.opacity, number, depth);
}
