// A slab: the part of each pixel's stretch between two layers of meshes. The rule is documented in the volume crate's `mesh`.
//!import bindings frame hidden

@group(1) @binding(NEAR_LAYER) var near_layer: texture_depth_2d;
@group(1) @binding(FAR_LAYER) var far_layer: texture_depth_2d;
@group(1) @binding(FRONT) var front: texture_2d<f32>;

fn limited(stretch: vec2f, position: vec2f) -> vec2f {
    let pixel = vec2i(position);
    let near = textureLoad(near_layer, pixel, 0);
    let far = textureLoad(far_layer, pixel, 0);
    // There is no slab behind the last layer or behind an opaque front.
    let is_hidden = near >= 1.0 || is_opaque(textureLoad(front, pixel, 0).a);
    let end = select(stretch.y, min(stretch.y, far * frame.mesh_far), far < 1.0);
    return vec2f(max(stretch.x, near * frame.mesh_far), select(end, -1.0, is_hidden));
}
