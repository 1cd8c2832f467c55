//! The wgpu renderer: atlas, uploads, the sorted compositor, read-back.
