//! Files of a user: text, scenes, pictures and movies that are written whole, and paths that can be opened.

#[cfg(feature = "movie")]
pub mod movie_file;
pub mod openable;
pub mod picture_file;
pub mod scene_file;
pub mod store_place;
pub mod text_file;
pub(crate) mod whole_file;
