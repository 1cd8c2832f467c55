//! A block's part of a mesh.

use crate::numbering::{Class, Ranks};
use glam::DVec3;

/// A vertex of a patch: the block's own, or one of a predecessor.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PatchVertex {
    /// Place in the world.
    pub(crate) place: DVec3,
    pub(crate) class: Class,
    /// Rank among the vertices of its class.
    pub(crate) rank: u32,
    /// Whether decimation keeps it: more than two labels meet there, or the surface is no disc.
    pub(crate) is_fixed: bool,
}

/// A block's vertices and triangles, of outward orientation.
#[derive(Debug, Default)]
pub(crate) struct Patch {
    pub(crate) vertices: Vec<PatchVertex>,
    pub(crate) ranks: Ranks,
    /// Places among the vertices.
    pub(crate) triangles: Vec<[u32; 3]>,
    /// The label beyond each triangle; empty for isosurfaces.
    pub(crate) sheets: Vec<i64>,
}

impl Patch {
    /// Bytes of memory.
    pub(crate) fn held_bytes(&self) -> u64 {
        let vectors = size_of::<PatchVertex>() * self.vertices.capacity()
            + size_of::<[u32; 3]>() * self.triangles.capacity()
            + size_of::<i64>() * self.sheets.capacity();
        vectors as u64
    }
}
