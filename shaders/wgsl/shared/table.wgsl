// The buffer with the layers' transfer tables. What a layer's places hold depends on the mode: media for `classify`, colours for `colors`. Behind
// the last place are running integrals: for each entry, of three channels and of depth, the low and the high word. Behind those is the mask
// of jitter, and behind all are entries over values and gradients.
//!import bindings

@group(0) @binding(TABLE) var<storage, read> table: array<vec2u>;
