// Lighting under a gradient as the normal. Twin of the volume crate's `lighting`.
const AMBIENT: f32 = 0.1;
const DIFFUSE: f32 = 0.7;
const SPECULAR: f32 = 0.2;
// The greatest cosine between a gradient and a ray at which the gradient is a normal as it is.
const SIDEWAYS: f32 = 1e-4;
// The least difference across two voxels, as a share of the value, of a field that is not flat.
const FLAT_SHARE: f32 = 9.536743e-7;

// A cosine to the power of 10, the fall-off of reflections: four products instead of `pow`'s logarithm and exponential.
fn tenth_power(x: f32) -> f32 {
    let square = x * x;
    let fourth = square * square;
    return fourth * fourth * square;
}
