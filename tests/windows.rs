//! The window on displays of its own. The soak, first by name, runs beside the other tests.

mod soak;
mod window;
mod window_files;
