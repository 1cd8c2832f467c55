//! What the pager asks of a volume: geometry, what bricks can show, and decoded bricks. A store answers from its files; a program may
//! answer from its own arrays, or compute.

use brickyard_volume::{BrickId, BrickIndex, Geometry, Occupancy, OccupancyBins, PageId, Pyramid, VoxelType};

/// Why a brick could not be read. If the reason may pass, the pager tries again a few times; in the end it marks the brick failed and
/// draws an ancestor.
#[derive(Clone, Debug, thiserror::Error)]
#[error("{id}: {reason}")]
pub struct BrickError {
    /// The brick that could not be read.
    pub id: BrickId,
    /// What went wrong, naming the file if there is one.
    pub reason: String,
    /// Whether the same read may succeed later: see [`brickyard_store::ReadError::is_passing`].
    pub is_passing: bool,
}

impl BrickError {
    /// The error for a brick that is given up since `who` panicked on it, which has been printed.
    pub(crate) fn of_panic(id: BrickId, who: &str) -> Self {
        Self { id, reason: format!("{who} panicked"), is_passing: false }
    }
}

/// A paged volume: a pyramid of bricks that can be read one by one. Many worker threads call it at once. The methods that describe the volume
/// as a whole must be quick and always give the same answer.
///
/// The methods without a body are enough for a volume of one channel and one time step:
///
/// ```
/// use brickyard_pager::{BrickError, BrickSource};
/// use brickyard_volume::{BrickId, Extent, Geometry, Pyramid, VoxelType};
///
/// /// A sphere, computed brick by brick.
/// struct Sphere { pyramid: Pyramid, geometry: Geometry }
///
/// impl BrickSource for Sphere {
///     fn pyramid(&self) -> &Pyramid { &self.pyramid }
///     fn geometry(&self) -> &Geometry { &self.geometry }
///     fn voxel_type(&self) -> VoxelType { VoxelType::U8 }
///     fn value_range(&self) -> (f64, f64) { (0.0, 255.0) }
///     fn read_core(&self, id: BrickId, out: &mut [u8]) -> Result<(), BrickError> {
///         // A voxel of a coarser level stands for several of level 0.
///         let factor = self.pyramid.level(id.level).factor;
///         for (voxel, place) in out.iter_mut().zip(self.pyramid.core_voxels(id.index)) {
///             let from_centre: [f64; 3] =
///                 std::array::from_fn(|axis| (f64::from(place[axis]) + 0.5) * f64::from(factor[axis]) - 100.0);
///             let radius = from_centre.iter().map(|d| d * d).sum::<f64>().sqrt();
///             *voxel = (255.0 - 2.0 * radius).max(0.0) as u8;
///         }
///         Ok(())
///     }
/// }
///
/// let (extent, geometry) = (Extent::new(200, 200, 200), Geometry::default());
/// let sphere = Sphere { pyramid: Pyramid::new(extent, geometry.spacing.to_array(), 64), geometry };
/// # let whole = BrickId { time: 0, channel: 0, level: sphere.pyramid.coarsest(), index: Default::default() };
/// # let mut voxels = vec![0; 64 * 64 * 64];
/// # sphere.read_core(whole, &mut voxels)?;
/// # assert_eq!(voxels[25 + 64 * (25 + 64 * 25)], 248);
/// # Ok::<(), BrickError>(())
/// ```
pub trait BrickSource: Send + Sync {
    /// The volume's levels, and the grid of bricks of each.
    fn pyramid(&self) -> &Pyramid;
    /// The voxel spacing and the volume's position in the world.
    fn geometry(&self) -> &Geometry;
    /// The type of the voxels' values.
    fn voxel_type(&self) -> VoxelType;
    /// The least and greatest valid value of the volume, over all channels, time steps and levels. Values beyond them are shown as these.
    fn value_range(&self) -> (f64, f64);
    /// The least and greatest valid value of a channel, over all time steps and levels. Values beyond are shown as these. Slots of
    /// 32-bit types have 65,536 codes between them.
    fn channel_range(&self, _channel: u32) -> (f64, f64) {
        self.value_range()
    }
    /// Whether values are labels, which name things and are never mixed.
    fn is_labels(&self) -> bool {
        false
    }
    /// Whether some voxel may be NaN or infinite; such voxels count as having no value.
    fn has_non_finite(&self) -> bool {
        self.voxel_type().is_float()
    }
    /// The integer that stands in voxels without a value; `None` if every integer is a value. Ranges and occupancy leave it out.
    fn nodata(&self) -> Option<f64> {
        None
    }
    /// Number of time steps, at least one.
    fn times(&self) -> u32 {
        1
    }
    /// Number of channels, at least one.
    fn channels(&self) -> u32 {
        1
    }
    /// How occupancy masks divide a channel's values into bins.
    fn occupancy_bins(&self, _channel: u32) -> OccupancyBins {
        let (low, high) = self.value_range();
        OccupancyBins::over(low, high)
    }
    /// The value bins that the brick and its descendants can show, one voxel around them included; [`Occupancy::ALL`] if this is not known.
    /// The call may wait for a disk. Bricks that can show nothing under a transfer function are not read.
    fn occupancy(&self, _id: BrickId) -> Occupancy {
        Occupancy::ALL
    }
    /// Reads the occupancy of all bricks of a page, each at its [place](Pyramid::page_of).
    ///
    /// # Errors
    /// If the page cannot be read.
    fn read_occupancy(&self, page: PageId) -> Result<Vec<Occupancy>, BrickError> {
        let mut occupancy = vec![Occupancy::NONE; self.pyramid().paging(page.level).page_cells()];
        for (id, place) in self.pyramid().bricks_of_page(page) {
            occupancy[place] = self.occupancy(id);
        }
        Ok(occupancy)
    }
    /// Whether the source keeps hashes of its bricks' cores, by which bricks that are the same in several time steps are found.
    fn keeps_hashes(&self) -> bool {
        false
    }
    /// Reads the hashes of the cores of all bricks of a page, each at its [place](Pyramid::page_of). Cores of the same hash are taken for equal.
    /// Only called where hashes are kept.
    ///
    /// # Errors
    /// If the page cannot be read. Its bricks are taken for changed then.
    fn read_hashes(&self, page: PageId) -> Result<Vec<u128>, BrickError> {
        let id = BrickId { time: page.time, channel: page.channel, level: page.level, index: BrickIndex::default() };
        Err(BrickError { id, reason: "no hashes are kept".into(), is_passing: false })
    }
    /// Tells the source that these bricks, and their aprons where they are stored, are about to be read, so that it may ask the operating system
    /// to read ahead.
    fn advise(&self, _ids: &[BrickId]) {}
    /// Decodes the brick's core, `edge`^3 little-endian voxels, x fastest, into `out`. Voxels past the level's extent
    /// are unspecified.
    ///
    /// # Errors
    /// If the brick's bytes are missing, damaged or cannot be decoded.
    fn read_core(&self, id: BrickId, out: &mut [u8]) -> Result<(), BrickError>;
    /// The width of the stored aprons in voxels; 0 if there are none, and aprons are to be copied from neighbouring bricks.
    fn stored_apron(&self) -> u32 {
        0
    }
    /// Decodes the brick's stored apron, little-endian voxels in the order of [`brickyard_volume::Apron`], into `out`. Only
    /// called where aprons are stored.
    ///
    /// # Errors
    /// If the apron's bytes are missing, damaged or cannot be decoded.
    fn read_apron(&self, id: BrickId, _out: &mut [u8]) -> Result<(), BrickError> {
        Err(BrickError { id, reason: "no aprons are stored".into(), is_passing: false })
    }
    /// Encoded bytes that [`BrickSource::read_core`] and [`BrickSource::read_apron`] have read so far, for all callers together.
    fn bytes_read(&self) -> u64 {
        0
    }
    /// The most memory in bytes that the source itself takes while its bricks are read, however large the volume is. It is in the host budget of whatever
    /// reads them, so what is there once for many readers is no part of it.
    fn cache_bytes(&self) -> u64 {
        0
    }
}
