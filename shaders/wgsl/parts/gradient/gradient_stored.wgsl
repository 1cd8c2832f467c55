// Stored differences of values: across two voxels along each axis. Twin of the volume crate's `gradients`.
//!import atlas field frame

const GRADIENT_SCALE: f32 = 256.0;

const IS_STORED: bool = true;

fn value_differences(field: Field, t: f32, middle: f32) -> vec3f {
    let texel = field.origin + field.along * clamp(t, field.reach.x, field.reach.y);
    let slot = floor(field.low / frame.slot_edge);
    // Two texels of the slot per node.
    let node = 0.5 * (texel - slot * frame.slot_edge - frame.first_gradient) + 0.5;
    let inside = clamp(node, vec3f(0.5), vec3f(frame.gradient_edge - 0.5));
    return sample_gradients(slot * frame.gradient_edge + inside) * (frame.gradient_scale / GRADIENT_SCALE);
}
