//! The CPU renderer: the pager's draw list over slots in RAM, on all cores.
//!
//! It does what the `raycast` compositor of the GPU does, by the same sampling rule ([`brickyard_volume::lattice`]), and is
//! the default where there is no GPU. A frame passes through in this order:
//! 1. `frame`: the draw list, reversed to front to back, becomes cells with their place on the picture and in slot space.
//! 2. `tile`: the picture's tiles go to the threads; a tile takes its cells one by one and its rays through each, so that
//!    neighbouring rays find a brick's voxels in the first-level cache.
//! 3. `ray`: finds the segments of a ray that belong to a cell, exactly once for all cells together.
//! 4. `macrocells`: of those, the stretches in which something can be seen.
//! 5. `sample` and `blend`: the samples of a run, in packets of eight, are interpolated, classified and blended in loops that
//!    compile to vector code (AVX2 where the machine has it, chosen at run time).
//!
//! For surfaces `surface` stands where `blend` stands for sums: it finds where a run's samples change sides. For all methods but the plain
//! one, and where there is lighting, `medium` does; `cubic` filters where `sample` does not.
//!
//! Where there are meshes (`meshes`), a tile does steps 2 to 5 for each slab between two layers of triangles.
//! Several volumes have a renderer of their own, `ensemble`, of the same parts.
//!
//! A pixel depends on the frame alone, not on the number of threads nor on AVX2: sums are always taken in the same order,
//! and no fused multiply-add is used.

mod blend;
mod cubic;
mod ensemble;
mod frame;
mod gradients;
mod layers;
mod macrocells;
mod medium;
mod meshes;
mod packet;
mod ray;
mod renderer;
mod sample;
mod steps;
mod surface;
mod tile;

pub use ensemble::{EnsembleOptions, SoftwareEnsemble};
pub use renderer::{SoftwareError, SoftwareOptions, SoftwareRenderer};
