//! A user's files: text, scenes, pictures and movies, each written whole, and paths to open.

#[cfg(feature = "movie")]
pub mod movie_file;
pub mod openable;
pub mod picture_file;
pub mod scene_file;
pub mod store_place;
pub mod text_file;
pub(crate) mod whole_file;
