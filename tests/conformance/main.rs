//! The conformance suite of renderers: what every backend and compositor must show, over one fixture, through the face that sessions draw
//! by (`brickyard::backend::Renderer`). `volume`, `list` and `stage` do in memory what stores, pagers and sessions do; `shot` compares with
//! the oracle, which draws each picture once for all renderers; `scenery` is what is looked at. Each test says who takes it: the CPU takes
//! all; a rasteriser in software takes seconds to compile a shader, so of those with many each GPU compositor takes some.

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
