//! Interface of a volume to the pager: geometry, occupancy and decoded bricks. A store reads from files; a program may serve its own arrays or
//! compute.

use brickyard_store::FetchRoom;
use brickyard_volume::{BrickId, BrickIndex, Geometry, Occupancy, OccupancyBins, PageId, Pyramid, VoxelType};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::time::Duration;

/// Error from reading a brick. If it may pass, the pager retries a few times, then marks the brick failed and draws an ancestor.
#[derive(Clone, Debug, thiserror::Error)]
#[error("{id}: {reason}")]
pub struct BrickError {
    /// The unreadable brick.
    pub id: BrickId,
    /// The reason, with the file if there is one.
    pub reason: String,
    /// Whether the same read may succeed later: see [`brickyard_store::ReadError::is_passing`].
    pub is_passing: bool,
}

/// Reads a brick. A panic of `who`, which has been printed, becomes an error: it costs one brick, not a thread and all its waiters.
pub(crate) fn caught<T, E: From<BrickError>>(
    id: BrickId,
    who: &str,
    read: impl FnOnce() -> Result<T, E>,
) -> Result<T, E> {
    catch_unwind(AssertUnwindSafe(read)).unwrap_or_else(|_| {
        let reason = format!("{who} panicked; please report this");
        Err(BrickError { id, reason, is_passing: false }.into())
    })
}

/// A paged volume: a pyramid of bricks, read one by one, by many worker threads at once. Methods that describe the whole volume must be quick and
/// always return the same result.
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
    /// The levels, each with its grid of bricks.
    fn pyramid(&self) -> &Pyramid;
    /// Voxel spacing and position in the world.
    fn geometry(&self) -> &Geometry;
    /// Type of the voxel values.
    fn voxel_type(&self) -> VoxelType;
    /// Least and greatest valid value over all channels, time steps and levels. Values beyond are clamped.
    fn value_range(&self) -> (f64, f64);
    /// Least and greatest valid value of a channel over all time steps and levels. Values beyond are clamped. Slots of 32-bit types have
    /// 65,536 codes in between.
    fn channel_range(&self, _channel: u32) -> (f64, f64) {
        self.value_range()
    }
    /// Whether values are labels, which are never mixed.
    fn is_labels(&self) -> bool {
        false
    }
    /// Whether any voxel may be NaN or infinite; such voxels count as no data.
    fn has_non_finite(&self) -> bool {
        self.voxel_type().is_float()
    }
    /// Integer of voxels without a value; `None` if every integer is a value. Ranges and occupancy leave it out.
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
    /// Bins of the occupancy masks of a channel.
    fn occupancy_bins(&self, _channel: u32) -> OccupancyBins {
        let (low, high) = self.value_range();
        OccupancyBins::over(low, high)
    }
    /// Value bins in the brick, its descendants and one voxel around; [`Occupancy::ALL`] if unknown. May wait for a disk. Bricks invisible
    /// under a transfer function are not read.
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
    /// Whether the source keeps hashes of its cores, for finding equal bricks of several time steps.
    fn keeps_hashes(&self) -> bool {
        false
    }
    /// Reads the core hashes of all bricks of a page, each at its [place](Pyramid::page_of). Equal hashes mean equal cores. Only called
    /// where hashes are kept.
    ///
    /// # Errors
    /// If the page cannot be read. Its bricks then count as changed.
    fn read_hashes(&self, page: PageId) -> Result<Vec<u128>, BrickError> {
        let id = BrickId { time: page.time, channel: page.channel, level: page.level, index: BrickIndex::default() };
        Err(BrickError { id, reason: "no hashes are kept".into(), is_passing: false })
    }
    /// Threads that fetch coming bricks ahead of those who read them; none for a source at hand.
    fn fetchers(&self) -> u32 {
        0
    }
    /// Time until the bytes of a brick are at hand.
    fn latency(&self) -> Duration {
        Duration::ZERO
    }
    /// Fetches the encoded bytes of bricks, for reads that follow soon: waits until there is room, and takes as many then. Failures are left for the reads
    /// to report, as those of requests that the pager [cancels](brickyard_store::Cancellation). Only called where there are
    /// [fetchers](BrickSource::fetchers).
    fn fetch(&self, _take: &mut dyn FnMut(FetchRoom) -> Vec<BrickId>) {}
    /// Whether so much is being fetched that a new plan had better end what it does not want of it.
    fn is_backed_up(&self) -> bool {
        false
    }
    /// Announces coming reads of these bricks and their stored aprons, so the operating system can read ahead.
    fn advise(&self, _ids: &[BrickId]) {}
    /// Decodes the brick's core, `edge`^3 little-endian voxels, x fastest, into `out`. Voxels past the level's extent are unspecified.
    ///
    /// # Errors
    /// If the brick's bytes are missing, damaged or cannot be decoded.
    fn read_core(&self, id: BrickId, out: &mut [u8]) -> Result<(), BrickError>;
    /// Width of the stored aprons in voxels; 0 without any, in which case aprons are copied from neighbours.
    fn stored_apron(&self) -> u32 {
        0
    }
    /// Decodes the brick's stored apron, little-endian voxels in the order of [`brickyard_volume::Apron`], into `out`. Only called where aprons are
    /// stored.
    ///
    /// # Errors
    /// If the apron's bytes are missing, damaged or cannot be decoded.
    fn read_apron(&self, id: BrickId, _out: &mut [u8]) -> Result<(), BrickError> {
        Err(BrickError { id, reason: "no aprons are stored".into(), is_passing: false })
    }
    /// Encoded bytes read so far by [`BrickSource::read_core`] and [`BrickSource::read_apron`], over all callers.
    fn bytes_read(&self) -> u64 {
        0
    }
    /// Bounds what the source keeps in memory for later reads; the least that reads need stays. Called before a reader's first read.
    fn keep_at_most(&self, _bytes: u64) {}
    /// Peak memory in bytes of the source itself during reads, whatever the volume's size. Part of the reader's host budget, so memory
    /// shared by many readers is excluded.
    fn cache_bytes(&self) -> u64 {
        0
    }
}
