//! The CPU renderer: draw lists of layers over slots in RAM, on all cores.
//!
//! The counterpart of the GPU's `raycast` compositor, by the same sampling rule ([`brickyard_volume::lattice`]), and
//! the default without a GPU. The stages of a frame, in order:
//! 1. `frame`: each layer's draw list, reversed to front to back, becomes cells in picture and slot coordinates.
//! 2. `tile`: the picture's tiles go to the threads. With meshes (`meshes`), a tile repeats all further stages for each
//!    slab between two layers of triangles.
//! 3. `march`: a layer drawn alone, or projected, takes the tile's rays through its cells one by one, so that
//!    neighbouring rays find a brick's voxels in the first-level cache. `compositing`: each of several mixed layers
//!    adds its media to some of a ray's segments (`gather`), and light then passes through all of them together
//!    (`media`, `mixture`), cell by cell if the layers share a cut, else ray by ray. If the layers share a cut and are
//!    plain fog (`channels`), some rays go side by side and are located once for all layers.
//! 4. `ray` and `stretch`: the segments of a ray belonging to a cell. All cells together have each segment exactly
//!    once.
//! 5. `macrocells`: the possibly visible ones of these segments.
//! 6. `sample` (or `cubic`) and `modes`: the samples of a run, in packets of eight, are interpolated, classified and
//!    blended in loops that compile to vector code (AVX2 if available, chosen at run time: `unit`). For lit samples of
//!    the plain method, `lit` finds the gradients (`differences`, `sobel`, `gradients`) and lights the colours
//!    (`shade`) by packets, too. For all other methods, and for surfaces in fog, `path` and `pieces` turn segments into
//!    media (`medium`). `surface` finds one opaque surface.
//!
//! A pixel depends on the frame alone, not on the number of threads nor on AVX2: sums are always taken in the same
//! order, and no fused multiply-add is used.

mod boxes;
mod channels;
mod choice;
mod compositing;
mod cubic;
mod depths;
mod differences;
mod frame;
mod gather;
mod gradients;
mod lit;
mod macrocells;
mod march;
mod media;
mod medium;
mod meshes;
mod mixture;
mod modes;
mod options;
mod outline;
mod packet;
mod painting;
mod path;
mod pieces;
mod ray;
mod reading;
mod renderer;
mod row;
mod sample;
mod shade;
mod slots;
mod sobel;
mod steps;
mod stretch;
mod surface;
mod ticks;
mod tile;
mod tiles;
mod transfer_table;
mod unit;

pub use options::SoftwareOptions;
pub use painting::{KeptTiles, Painting};
pub use renderer::{SoftwareError, SoftwareRenderer};
