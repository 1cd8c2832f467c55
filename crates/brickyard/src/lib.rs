//! brickyard shows volumes that fit neither a 3D texture, nor GPU memory, nor RAM: it packs them into brick stores and
//! streams just the bricks that a view needs, inside budgets that the user sets, with a complete picture in every frame.
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
//! # A camera that moves
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
//! # In an application that draws with wgpu
//!
//! ```toml
//! brickyard = { path = "...", default-features = false, features = ["gpu"] }
//! ```
//!
//! The wgpu is version 30, re-exported as [`render::wgpu`]: a program that uses that one needs none of its own.
//! The application asks its adapter for a device with what [`Gpu::required`](render::Gpu::required) lists, and lends it: see
//! [`Session::on_gpu`]. Then each frame is a [`Session::step`] and a [`Session::draw_to`] with an encoder of the application's, and neither waits for the
//! GPU but where slots are made: in the first step, and in one whose scene asks for more. A picture is whole once `draw_to` has returned true and
//! the frame's [`status`](pager::Status::settled) says settled. `examples/embed.rs` is a whole program.
//!
//! # What lives how long, and what it costs
//!
//! | | lives | making it costs |
//! | --- | --- | --- |
//! | [`VolumeSource`] | as long as somebody looks at the volume; copies are handles | a store's metadata: milliseconds |
//! | [`Session`] | as long as the pictures have their budgets; one thread uses it | nothing before its first step |
//! | its backend, slots and workers | until a scene asks for more: wider aprons, another table, a larger picture, other layers | some 100 ms, and filling the slots from main memory; the device stays |
//! | [`Scene`] | a value: as many as one likes | nothing; a transfer function of 16-bit values 2 ms when it is first shown |
//! | [`Frame`] | until the next [`Session::step`] | a step: taking in what has come, cuts and plans, uploads; about a millisecond, and in a live session it never waits for a disk |
//! | [`Picture`](volume::Picture) | a value | [`Session::draw`] |
//!
//! # Cargo features
//!
//! All are on by default. A program that shows stores needs `gpu` alone (`default-features = false, features = ["gpu"]`), or none to draw on
//! the CPU.
//!
//! | feature | for |
//! | --- | --- |
//! | `gpu` | the wgpu backend and exact pictures in passes |
//! | `dicom`, `tiff` | reading such files, to pack them |
//! | `mesh` | reading STL, PLY, OBJ and glTF files |
//! | `lettering` | writing on pictures: which side of a patient is where, scale bars, colour bars, axes, a line of text |
//! | `movie` | movies: GIF, YUV4MPEG2, and MP4 by ffmpeg |
//! | `reference` | the oracle, which draws whole levels in 64-bit floats |
//!
//! # Where to find more
//!
//! [`session`] joins volumes, their pagers and a rendering backend; [`offline`] renders settled pictures with it. [`volume`] has the words: scenes, layers, cameras, transfer functions.
//! [`pager::BrickSource`] is what a program's own bricks take to be shown. Foreign files become stores by [`import::open`] and [`store::pack()`], and grow by [`store::Appender`];
//! [`openable`] says of a path whether it is a store or such a file, [`preview`] shows the file before it is packed, [`background`] packs beside that, and an [`opening`] does one after
//! the other for a window.
//! The parts are re-exported under their own names. `examples` has whole programs.

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

pub use brickyard_import as import;
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
