//! A requested mesh: which surface, of which part of a store.

use brickyard_volume::{Level, VoxelBox};

/// Most iterations of smoothing: each needs a wider border of voxels around a block.
pub const MOST_SMOOTHING: u32 = 20;

/// Greatest distance of a decimated mesh, in voxels.
pub const MOST_DECIMATION_VOXELS: f64 = 4.0;

/// Most labels in a file.
pub const MOST_LABELS: usize = 1 << 16;

/// The surface to extract.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum MeshSurface {
    /// The border between values of at least this and lesser ones, by linear interpolation.
    Isosurface(f64),
    /// The border of one label.
    Label(i64),
    /// The borders of all labels but the background, an object for each.
    Labels,
}

/// Part of a store, its surface, and policy for an existing file.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MeshRequest {
    /// The surface to extract.
    pub surface: MeshSurface,
    /// The level to read.
    pub level: Level,
    /// The time step to read.
    pub time: u32,
    /// The channel to read.
    pub channel: u32,
    /// The box to read, in the level's voxels; `None` reads the whole level. Everything outside of it is outside of the surface.
    pub region: Option<VoxelBox>,
    /// Iterations of smoothing; at most [`MOST_SMOOTHING`].
    pub smoothing: u32,
    /// Decimation: vertices go as long as each of them stays within this distance of the mesh, in voxels (of their smallest edge); above 0 and at most
    /// [`MOST_DECIMATION_VOXELS`].
    pub decimation_voxels: Option<f64>,
    /// Whether an existing file may be replaced.
    pub overwrite: bool,
    /// Most anonymous memory for the extraction, in bytes, including the open store's.
    pub memory_bytes: u64,
}

impl MeshRequest {
    /// Requests a surface of level 0 of the first step and channel, whole, without smoothing, within 1 GiB.
    pub fn new(surface: MeshSurface) -> Self {
        let (level, region) = Default::default();
        let (smoothing, decimation_voxels) = (0, None);
        Self {
            surface,
            level,
            time: 0,
            channel: 0,
            region,
            smoothing,
            decimation_voxels,
            overwrite: false,
            memory_bytes: 1 << 30,
        }
    }
}
