//! The pager: decides which bricks a view wants, in which order they are drawn, read and evicted, inside hard budgets.
//! Emits plans as values; knows nothing of the GPU, file formats or windows.
//!
//! How a frame passes through: the view gives a [`Cut`] of the octree; its cells become a [`DrawList`] over the bricks that
//! are resident in slots; what is missing becomes an ordered list of requests that replaces the last one. Worker threads
//! take from it, decode cores into the RAM cache, assemble padded bricks, and send them to the next frame, which gives them
//! slots and hands them to the renderer as uploads. Everything up to the workers is pure or a plain state machine; only
//! [`Pager`] joins the two.

mod assemble;
mod blocks;
mod budget;
mod cut;
mod draw_list;
mod layout;
mod order;
mod pager;
mod parts;
mod plan;
mod planner;
#[cfg(test)]
mod properties;
mod ram_cache;
mod residency;
mod shelf;
mod sight;
mod slots;
mod source;
mod split;
mod store_source;
#[cfg(test)]
mod test_source;
mod workers;

pub use assemble::PaddedReader;
pub use budget::{PagerConfig, PagerError};
pub use cut::{Cut, View, cut_capacity};
pub use draw_list::{DrawCell, DrawList, Slot};
pub use pager::{Counters, Frame, Pager, Status};
pub use planner::Planning;
pub use ram_cache::{DecodeCounters, RamCache};
pub use residency::Upload;
pub use source::{BrickError, BrickSource};
