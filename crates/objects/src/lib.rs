//! Objects at addresses: `https://`, `http://`, `s3://`, `gs://` and `az://` lead to documents and files, read whole or by ranges of bytes.
//!
//! [`at`] finds the [`Objects`] of an address, one for each host or bucket in a process, and the name there; other paths have none, and are
//! read as files. Calls block their thread, never a runtime's. Costs a connection for each request under way, of which so many are allowed at a time.

mod address;
mod cache_folder;
mod cancellation;
#[cfg(feature = "remote")]
mod disk_cache;
mod fault;
mod link;
mod objects;
mod place;
#[cfg(feature = "remote")]
mod remote;
mod settings;
mod traffic;

pub use address::{Address, is_address, local_path};
pub use cache_folder::cache_folder;
pub use cancellation::Cancellation;
#[cfg(feature = "remote")]
pub use disk_cache::{Kept, clear, kept};
pub use fault::Fault;
pub use link::{Admission, Link};
pub use objects::{Object, Objects, Version};
pub use place::{Place, at};
pub use settings::{DEFAULT_CACHE_BYTES, Settings, cache_bytes, configure};
pub use traffic::{Traffic, traffic};
