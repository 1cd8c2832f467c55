// What a place shows of its colour under its gradient as a normal. Twin of the volume crate's `lighting`.
const AMBIENT: f32 = 0.1;
const DIFFUSE: f32 = 0.7;
const SPECULAR: f32 = 0.2;
// The cosine between a gradient and a ray up to which the gradient is a normal as it is.
const SIDEWAYS: f32 = 1e-4;
// The share of a value that a difference across two voxels has at least where the field is not flat.
const FLAT_SHARE: f32 = 9.536743e-7;

// A cosine to the power of 10 by which reflections fade: four products, where `pow` is a logarithm and an exponential.
fn tenth_power(x: f32) -> f32 {
    let square = x * x;
    let fourth = square * square;
    return fourth * fourth * square;
}
