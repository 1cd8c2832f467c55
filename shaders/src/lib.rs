//! The WGSL of the renderer, by concern, composed.
