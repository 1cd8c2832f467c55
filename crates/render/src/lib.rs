//! The wgpu renderer: pools of brick slots for layers, uploads into them, the `sorted` and `raycast` compositors, and the picture read back.
//! Headless.
//!
//! ```text
//! codes -> upload -> atlas --.
//! draw list, settings --------> march -> resolve -> read-back -> Picture
//! ```
//! The march is instanced boxes, back to front (`sorted`), or a ray per pixel, front to back (`raycast`): same samples, same
//! picture. Where there are meshes, march and resolve go through the picture slab by slab: see `meshes`. What of several layers is
//! gathered one by one, and what together, is said in `gather_plan`.
//! Pipelines can be made ahead by a thread (`pipeline_cache`). All else of one [`GpuRenderer`] is done on one thread: wgpu 30 can deadlock when one thread writes a texture while another submits.

mod adapter;
mod answers;
mod atlas;
mod blit;
mod buffer_parts;
mod buffers;
mod compositor;
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
