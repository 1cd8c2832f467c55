//! The brick store: an OME-Zarr image (0.5 or 0.6) with side data; pack, open, read, verify.
//!
//! The format, from the bottom up: [`codec`] turns a brick's core into checked bytes (with `blosc` for shuffled data),
//! [`shard`] frames many of them in one file, [`side`] holds statistics per brick and fingerprints per shard,
//! [`layout`] maps bricks to files, and [`metadata`] writes and checks the `zarr.json` documents. [`Store`] reads all
//! of them.

pub mod append;
mod arrived;
mod blosc;
mod chunks;
pub mod codec;
mod counts;
mod data_file;
pub mod downsample;
mod edit;
pub mod error;
mod first_objects;
mod folder;
mod foreign;
mod held;
mod index;
mod inside;
mod json;
mod kind;
pub mod layout;
mod level_bricks;
mod level_source;
pub mod metadata;
mod mutex;
mod ngff;
mod nodata;
pub mod pack;
mod ranged_file;
mod remake;
mod repair;
mod replace;
mod scratch;
pub mod shard;
mod shard_file;
pub mod side;
mod side_file;
mod stats;
mod store;
#[cfg(test)]
mod test_store;
mod time;
mod turns;
mod upgrade;
mod value_counts;
mod value_table;
pub mod verify;
mod version;

pub use append::{AppendError, AppendOptions, AppendReport, Appender};
pub use arrived::FetchRoom;
pub use brickyard_objects::Cancellation;
pub use codec::{BrickCodec, Codec};
pub use downsample::{Downsample, Reductions};
pub use edit::{ChannelEdit, Edit, EditChange, EditError, EditReport, edit, edit_within, rehearse_edit};
pub use error::{CodecError, OpenError, ReadError, ShardError, UnfitOutput};
pub use foreign::{ImageIndexError, KeptImages, MOST_KEPT_BYTES, Making, clear_images, is_foreign, kept_images};
pub use index::{Changes, IndexError, IndexReport, index};
pub use inside::check_outside;
pub use layout::{Layout, ShardId};
pub use level_bricks::LevelBricks;
pub use level_source::LevelSource;
pub use metadata::{ChannelDisplay, ChannelStatistics, Histogram, Kind, Percentiles, StoreInfo};
pub use ngff::Ngff;
pub use pack::{
    Exists, Holder, PackError, PackOptions, PackPlan, PackReport, Progress, estimate, pack, plan, rehearse,
    settings_fingerprint,
};
pub use remake::RemakeError;
pub use repair::{RepairError, RepairReport, recorded_settings, repair};
pub use replace::{Destination, creator, remove_unfinished};
pub use scratch::Scratch;
pub use shard::Fingerprint;
pub use shard_file::IoMode;
pub use store::Store;
pub use upgrade::{UpgradeError, UpgradeReport, rehearse_upgrade, upgrade};
pub use verify::{MOST_PROBLEMS, VerifyError, VerifyProblem, VerifyReport, compare_within, verify, verify_within};
