//! The wgpu renderer: an atlas of brick slots, uploads into it, the `sorted` and `raycast` compositors, and the picture read back.
//! Headless.
//!
//! ```text
//! codes -> upload -> atlas --.
//! draw list, settings --------> march -> resolve -> read-back -> Picture
//! ```
//! The march is instanced boxes, back to front (`sorted`), or a ray per pixel, front to back (`raycast`): same samples, same
//! picture. Where there are meshes, march and resolve go through the picture slab by slab: see `meshes`.
//! Several volumes have a renderer of their own, [`GpuEnsemble`], of the same parts.
//! One [`GpuRenderer`] is used from one thread: wgpu 30 can deadlock when one thread writes a texture while another submits.

mod adapter;
mod atlas;
mod compositor;
mod ensemble;
mod error;
mod frame;
mod gathering;
mod memory;
mod meshes;
mod passes;
mod pipelines;
mod raycast;
mod renderer;
mod sorted;
mod table;
mod targets;
mod tree;
mod upload;

pub use adapter::{AdapterReport, GpuFormats, GpuPreference, adapters};
pub use atlas::AtlasPlan;
pub use compositor::Compositor;
pub use ensemble::GpuEnsemble;
pub use error::GpuError;
pub use passes::Passes;
pub use renderer::{GpuOptions, GpuRenderer};
