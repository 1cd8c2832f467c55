//! brickyard shows volumes that fit neither a 3D texture, nor GPU memory, nor RAM: it packs them into brick stores and
//! streams just the bricks that a view needs, inside budgets that the user sets, with a complete picture in every frame.
//!
//! This crate ties the parts together: [`session::Session`] joins stores, their pagers and a rendering backend;
//! [`offline`] renders settled pictures with it, [`flight`] measures it along scripted paths, [`survey`] compares ways to sample. The parts are re-exported under their own names.

pub mod backend;
pub mod exact;
mod fit;
pub mod flight;
mod losses;
pub mod memory;
pub mod offline;
mod options;
pub mod oracle;
pub mod picture_file;
pub mod quality;
mod resolve;
pub mod scenario;
pub mod session;
mod session_error;
pub mod stats;
pub mod survey;
mod tables;
pub mod tiles;
mod volume_source;

pub use brickyard_import as import;
pub use brickyard_pager as pager;
pub use brickyard_reference as reference;
pub use brickyard_render as render;
pub use brickyard_software as software;
pub use brickyard_store as store;
pub use brickyard_volume as volume;
