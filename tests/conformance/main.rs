//! Conformance suite of renderers: pictures required of every backend and compositor, over one fixture, through the interface of sessions
//! (`brickyard::backend::Renderer`). `volume`, `list` and `stage` replace stores, pagers and sessions in memory; `shot` compares with the
//! oracle, which draws each picture once for all renderers; `scenery` has the subjects. Each test chooses its renderers: the CPU takes all;
//! a software rasteriser takes seconds to compile a shader, so each GPU compositor takes some of those with many.

mod cuts;
mod fog;
mod jitter;
mod joins;
mod layers;
mod levels;
mod list;
mod looks;
mod methods;
mod modes;
mod narrow;
mod scenery;
mod shot;
mod stage;
mod surfaces;
mod visibility;
mod volume;
