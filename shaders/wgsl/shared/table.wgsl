// The buffer of the layers' transfer tables. The places of a layer hold media for `classify` or colours for `colors`, depending on the mode.
// Behind the last place are running integrals: for each entry, of three channels and of depth, the low and the high word. Then come the jitter
// mask and, last, entries over values and gradients.
//!import bindings

@group(0) @binding(TABLE) var<storage, read> table: array<vec2u>;
