// The sampler of atlases.
//!import bindings

@group(0) @binding(ATLAS_SAMPLER) var atlas_sampler: sampler;
