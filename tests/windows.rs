//! The window on its own displays. The soak, first by name, runs beside the other tests.

mod soak;
mod window;
mod window_files;
