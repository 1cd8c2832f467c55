//! Out-of-core volume rendering: brickyard shows volumes larger than a 3D texture, GPU memory or RAM. It packs them
//! into brick stores and streams the bricks of a view within fixed budgets; every frame is a complete picture.
//!
//! # A picture
//!
//! ```no_run
//! use brickyard::{Mode, Session, SessionOptions};
//!
//! let mut session = Session::open("head-ct.zarr", SessionOptions::default())?;
//! let scene = session.default_scene(Mode::Dvr);
//! session.render(&scene, (640, 480))?.save("out.png")?;
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # A moving camera
//!
//! ```no_run
//! use brickyard::{Mode, Session, SessionOptions};
//!
//! let mut session = Session::open("head-ct.zarr", SessionOptions { live: true, ..SessionOptions::default() })?;
//! let mut scene = session.default_scene(Mode::Dvr);
//! for turn in 0..100 {
//!     let frame = session.step(&scene, (640, 480))?;
//!     let picture = session.draw(&frame)?;
//!     println!("{} pixels, {:.0} % of the bricks are there", picture.rgb.len(), 100.0 * frame.status.completeness);
//!     scene.camera = Some(frame.scene.camera.orbited(f64::from(turn)));
//! }
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # In a wgpu application
//!
//! ```toml
//! brickyard = { path = "...", default-features = false, features = ["gpu"] }
//! ```
//!
//! The crate uses wgpu 30 and re-exports it as [`render::wgpu`]; programs need no wgpu dependency of their own. The
//! application requests a device with the features and limits in [`Gpu::required`](render::Gpu::required) and lends it
//! to [`Session::on_gpu`]. Each frame is then a [`Session::step`] and a [`Session::draw_to`] with the application's
//! encoder. Neither waits for the GPU, except while slots are created: in the first step, and when a scene needs more.
//! A picture is complete once `draw_to` has returned true and the frame's [`status`](pager::Status::settled) is
//! settled. `examples/embed.rs` is a whole program.
//!
//! # Lifetimes and costs
//!
//! | | lives | making it costs |
//! | --- | --- | --- |
//! | [`VolumeSource`] | as long as anybody looks at the volume; copies are handles | a store's metadata: milliseconds |
//! | [`Session`] | as long as the pictures have their budgets; one thread uses it | nothing before its first step |
//! | its backend, slots and workers | until a scene needs more: wider aprons, another table, a larger picture, other layers | some 100 ms, and filling the slots from main memory; the device stays |
//! | [`Scene`] | a value: as many as you like | nothing; a transfer function of 16-bit values takes 2 ms when first shown |
//! | [`Frame`] | until the next [`Session::step`] | a step: collecting arrived bricks, cuts and plans, uploads; about a millisecond, and never a wait for the disk in a live session |
//! | [`Picture`](volume::Picture) | a value | [`Session::draw`] |
//!
//! # Cargo features
//!
//! All are on by default. To show stores, `gpu` alone suffices (`default-features = false, features = ["gpu"]`);
//! drawing on the CPU needs none.
//!
//! | feature | for |
//! | --- | --- |
//! | `gpu` | the wgpu backend and exact pictures in passes |
//! | `dicom`, `pictures`, `tiff` | importing these files |
//! | `mesh` | reading STL, PLY, OBJ and glTF files |
//! | `lettering` | writing on pictures: patient sides, scale bars, colour bars, axes, a line of text |
//! | `movie` | movies: GIF, YUV4MPEG2, and MP4 by ffmpeg |
//! | `reference` | the oracle, which draws whole levels in 64-bit floats |
//!
//! # Where to find more
//!
//! [`session`] joins volumes, their pagers and a rendering backend; [`offline`] renders settled pictures with it.
//! [`volume`] has scenes, layers, cameras and transfer functions. A program's own bricks implement
//! [`pager::BrickSource`]. Foreign files become stores by [`import::open`] and [`store::pack()`], and stores grow by
//! [`store::Appender`]; [`export::export()`] writes them as files of other formats. [`openable`] tells stores from
//! foreign files, [`preview`] shows a file before it is packed, [`background`] packs it meanwhile, and an [`opening`]
//! does both in turn for a window. The parts are re-exported under their own names. `examples` has whole programs.

mod files;
pub mod memory;
mod pictures;
pub mod session;
pub mod stats;
mod window;

#[cfg(feature = "movie")]
pub use files::movie_file;
pub use files::{openable, picture_file, scene_file, store_place, text_file};
#[cfg(feature = "gpu")]
pub use pictures::exact;
#[cfg(feature = "lettering")]
pub use pictures::lettering;
#[cfg(feature = "reference")]
pub use pictures::oracle;
#[cfg(feature = "lettering")]
pub use pictures::overlay;
pub use pictures::{offline, tiles};
pub use session::{backend, channels, doubtful_extremes, first_look, frame_governor, unlike_sizes};
pub use window::{background, curve, following, opening, pick, preview, probe};

pub use brickyard_export as export;
pub use brickyard_extract as extract;
pub use brickyard_import as import;
pub use brickyard_objects as addresses;
pub use brickyard_pager as pager;
#[cfg(feature = "reference")]
pub use brickyard_reference as reference;
#[cfg(feature = "gpu")]
pub use brickyard_render as render;
pub use brickyard_software as software;
pub use brickyard_store as store;
pub use brickyard_volume as volume;

pub use offline::Rendered;
pub use pager::{BrickError, BrickSource};
pub use session::{Frame, Session, SessionError, SessionOptions, VolumeSource};
pub use volume::{Camera, Mode, Scene, SceneLayer};
