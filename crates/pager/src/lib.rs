//! The pager: picks a view's bricks and the order in which they are drawn, read and evicted, within hard budgets. Emits plans as
//! values; independent of the GPU, file formats and windows.
//!
//! For each frame and volume, the view, the last [`Cut`] of the octree and the known visibility of its cells give the next cut. Its
//! visible cells become a [`DrawList`] over the resident bricks. Missing bricks, and those the next views may need, become an ordered
//! list of requests, which replaces the last one. Worker threads take requests from it, decode cores into the RAM cache, assemble
//! padded bricks, and send them to the next frame, which assigns slots and passes them to the renderer as uploads. The renderer returns
//! the visibility of the drawn cells. Everything before the workers is pure or a plain state machine; only [`Pager`] joins it with
//! them.

mod apron_copy;
mod assemble;
mod budget;
mod buffer_lru;
mod changes;
mod clock;
mod cut;
mod dither;
mod draw_list;
mod exact;
mod fade;
mod goal;
mod layers;
mod layout;
mod leave;
mod motion;
mod neighbourhood;
mod order;
mod paged_occupancy;
mod paged_volume;
mod pager;
mod plan;
mod planner;
#[cfg(test)]
mod properties;
mod ram_cache;
mod residency;
mod retry;
mod sameness;
mod slot_contents;
mod slots;
mod source;
mod split;
mod status;
mod step_ahead;
mod store_source;
#[cfg(test)]
mod test_source;
mod tier;
mod upload_budget;
mod visibility;
mod visible_cells;
mod workers;

pub use assemble::PaddedReader;
pub use budget::{PagerConfig, PagerError, Planning};
pub use clock::{Clock, Ending, MOST_COMING, Playback, Policy, ShownStep, Tally};
pub use cut::{Caps, Cut, View, cut_capacity};
pub use dither::PixelShare;
pub use draw_list::{DrawCell, DrawList, Slot};
pub use exact::{ExactError, ExactPasses, Next};
pub use layers::{BudgetRequest, Layer, VolumeNeeds, pools, share};
pub use paged_volume::DrawnCells;
pub use pager::{Frame, Pager, VolumeDraw};
pub use ram_cache::{DecodeCounters, KeptCores, RamCache};
pub use residency::Upload;
pub use slot_contents::{SlotContents, encoding_of};
pub use source::{BrickError, BrickSource};
pub use status::{Counters, Readiness, Status};
pub use upload_budget::UploadLimits;
