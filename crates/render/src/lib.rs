//! The wgpu renderer: an atlas of brick slots, uploads into it, the `sorted` compositor, and the picture read back. Headless.
//!
//! ```text
//! codes -> upload -> atlas --.
//! draw list, settings --------> march (instanced boxes, back to front) -> resolve -> read-back -> Picture
//! ```
//! One [`GpuRenderer`] is used from one thread: wgpu 30 can deadlock when one thread writes a texture while another submits.

mod adapter;
mod atlas;
mod error;
mod frame;
mod memory;
mod pipelines;
mod renderer;
mod targets;
mod upload;

pub use adapter::{AdapterReport, GpuFormats, GpuPreference, adapters};
pub use atlas::AtlasPlan;
pub use error::GpuError;
pub use renderer::{GpuOptions, GpuRenderer};
