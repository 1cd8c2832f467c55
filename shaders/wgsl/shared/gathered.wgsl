// The gathered picture.
//!import bindings

@group(0) @binding(GATHERED) var gathered: texture_2d<f32>;
