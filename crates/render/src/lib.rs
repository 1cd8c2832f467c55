//! The wgpu renderer: pools of brick slots for layers, uploads into them, the `sorted` and `raycast` compositors, and
//! picture read-back. Headless.
//!
//! ```text
//! codes -> upload -> atlas --.
//! draw list, settings --------> march -> resolve -> read-back -> Picture
//! ```
//! The march is instanced boxes, back to front (`sorted`), or a ray per pixel, front to back (`raycast`): same samples,
//! same picture. With meshes, march and resolve go through the picture slab by slab: see `meshes`. `gather_plan`
//! decides which layers are gathered one by one and which together.
//!
//! A thread can compile pipelines ahead (`pipeline_cache`). All other work of a [`GpuRenderer`] runs on one thread:
//! wgpu 30 can deadlock when one thread writes a texture while another submits.

mod adapter;
mod answers;
mod atlas;
mod blit;
mod buffer_parts;
mod buffers;
mod compositor;
mod compositor_parts;
mod error;
mod frame;
mod frame_pass;
mod gather_plan;
mod gpu;
mod layer;
mod layouts;
mod leaf_octree;
mod mapping;
mod march;
mod memory;
mod meshes;
mod pace;
mod pipeline_cache;
mod pipelines;
mod pool;
mod raycast;
mod renderer;
mod showing;
mod sorted;
mod targets;
mod transfer_table;
mod upload;
mod variant;

pub use adapter::{AdapterReport, GpuFormats, GpuPreference, adapters};
pub use answers::Answer;
pub use atlas::AtlasPlan;
pub use blit::Target;
pub use compositor::Compositor;
pub use error::GpuError;
pub use frame_pass::Passes;
pub use gpu::Gpu;
pub use renderer::{Compiled, GpuOptions, GpuRenderer};
pub use wgpu;
