//! The pager: decides which bricks a view wants, in which order they are drawn, read and evicted, inside hard budgets.
//! Emits plans as values; knows nothing of the GPU, file formats or windows.

mod draw_list;
mod source;

pub use draw_list::{DrawCell, DrawList, Slot};
pub use source::{BrickError, BrickSource};
