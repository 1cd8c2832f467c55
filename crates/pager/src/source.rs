//! What the pager asks of a store: geometry, what bricks can show, and decoded bricks.

use brickyard_volume::{BrickId, Geometry, Occupancy, OccupancyBins, PageId, Pyramid, VoxelType};

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
    /// How occupancy masks bin a channel's values.
    fn occupancy_bins(&self, channel: u32) -> OccupancyBins;
    /// What the brick and its descendants can show, one voxel around them included; [`Occupancy::ALL`] where it is not known. May
    /// wait for a disk.
    fn occupancy(&self, id: BrickId) -> Occupancy;
    /// The same of all bricks of a page, each at its [place](Pyramid::page_of).
    ///
    /// # Errors
    /// If it cannot be read.
    fn read_occupancy(&self, page: PageId) -> Result<Vec<Occupancy>, BrickError> {
        let mut occupancy = vec![Occupancy::NONE; self.pyramid().paging(page.level).page_cells()];
        for (id, place) in self.pyramid().bricks_of_page(page) {
            occupancy[place] = self.occupancy(id);
        }
        Ok(occupancy)
    }
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
    /// The most memory that the source itself takes while it is read, whatever its size.
    fn cache_bytes(&self) -> u64 {
        0
    }
}
