//! Surfaces of stores as triangle meshes: isosurfaces and borders of labels, closed, with outward faces, in the scene's world.
//!
//! A level, or a box of it, is swept in blocks of 32³ cells (a cell lies between eight voxel centres). Threads turn blocks into patches of vertices and
//! triangles (`isosurface.rs`, `nets.rs`); patches are numbered and written in the blocks' order, so the file is the same for any number of threads, any
//! memory and any size of bricks. A patch names the vertices of earlier blocks by their place in these blocks' borders (`numbering.rs`), and the ranges of
//! bricks tell blocks without a surface, which are not read. Decimated patches wait on disk and are decimated once more, in other blocks
//! (`decimation.rs`). Memory is that of a few blocks and decoded bricks, at any size of volume or mesh.

mod block_grid;
mod bricks;
mod budget;
mod collapse;
mod cube;
mod decimation;
mod error;
mod extraction;
mod format;
mod glb;
mod isosurface;
mod label_boxes;
mod nets;
mod number_table;
mod numbering;
mod obj;
mod output;
mod patch;
mod piece;
mod pieces;
mod ply;
mod points;
mod report;
mod request;
mod smoothing;
mod stl;
#[cfg(test)]
mod testing;
#[cfg(test)]
mod tests;
mod world;

pub use error::MeshError;
pub use extraction::{check_mesh, mesh};
pub use report::{MeshObject, MeshReport, length_unit};
pub use request::{MOST_DECIMATION_VOXELS, MOST_LABELS, MOST_SMOOTHING, MeshRequest, MeshSurface};
