//! What the pager asks of a store: geometry, statistics in memory, and decoded bricks.

use brickyard_volume::{BrickId, Geometry, Occupancy, OccupancyBins, Pyramid, VoxelType};

/// Why a brick could not be read. If that may pass, the pager tries again a few times; then it marks the brick failed and draws
/// an ancestor.
#[derive(Clone, Debug, thiserror::Error)]
#[error("{id}: {reason}")]
pub struct BrickError {
    /// The brick.
    pub id: BrickId,
    /// What went wrong, with the file where there is one.
    pub reason: String,
    /// Whether the same read may go well later: see [`brickyard_store::ReadError::is_passing`].
    pub is_passing: bool,
}

/// A paged volume. Calls come from many worker threads.
pub trait BrickSource: Send + Sync {
    /// Levels and brick grids.
    fn pyramid(&self) -> &Pyramid;
    /// Placement in the world.
    fn geometry(&self) -> &Geometry;
    /// Type of a voxel.
    fn voxel_type(&self) -> VoxelType;
    /// Least and greatest valid value over the whole store (all channels, all steps).
    fn value_range(&self) -> (f64, f64);
    /// Whether some voxel is NaN or infinite.
    fn has_non_finite(&self) -> bool;
    /// Number of time steps.
    fn times(&self) -> u32;
    /// Number of channels.
    fn channels(&self) -> u32;
    /// How occupancy masks bin values.
    fn occupancy_bins(&self) -> OccupancyBins;
    /// What the brick can show, apron included; [`Occupancy::ALL`] where it is not known. From memory: no I/O.
    fn occupancy(&self, id: BrickId) -> Occupancy;
    /// Tells the kernel that these bricks, and their aprons where they are stored, are about to be read.
    fn advise(&self, ids: &[BrickId]);
    /// Decodes the brick's core, `edge`^3 little-endian voxels, x fastest, into `out`. Voxels past the level's extent
    /// are unspecified.
    ///
    /// # Errors
    /// If the brick's bytes are missing, damaged or cannot be decoded.
    fn read_core(&self, id: BrickId, out: &mut [u8]) -> Result<(), BrickError>;
    /// Width of the aprons that are stored; 0 where there are none.
    fn stored_apron(&self) -> u32;
    /// Decodes the brick's stored apron, little-endian voxels in the order of [`brickyard_volume::Apron`], into `out`. Only
    /// asked for where aprons are stored.
    ///
    /// # Errors
    /// As [`BrickSource::read_core`], of the apron.
    fn read_apron(&self, id: BrickId, out: &mut [u8]) -> Result<(), BrickError>;
    /// Encoded bytes that [`BrickSource::read_core`] and [`BrickSource::read_apron`] have read so far, for whomever.
    fn bytes_read(&self) -> u64;
}
