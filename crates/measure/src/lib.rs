//! Measurements of the engine, above the library: [flights](flight) along scripted paths, [playbacks](playing) of time steps,
//! [surveys](survey) of sampling methods, and plots of the results. Behind the command's `bench` and `quality`.

pub mod curve_plot;
pub mod flight;
mod paced_drawing;
pub mod playing;
mod processor_time;
pub mod scenario;
pub mod survey;
