//! Labels that are further apart than 16 bits reach, as a source of 16-bit codes: each brick is read from the volume and coded by the
//! look of a layer. Costs a search among the labels that the look names for each voxel that is read.

use brickyard_pager::{BrickError, BrickSource};
use brickyard_volume::labels::BACKGROUND;
use brickyard_volume::{BrickId, Geometry, LabelCodes, Occupancy, OccupancyBins, PageId, Pyramid, VoxelType};
use std::sync::Arc;

/// A volume of labels whose bricks are read as codes.
pub(crate) struct CodedLabels {
    labels: Arc<dyn BrickSource>,
    codes: Arc<LabelCodes>,
}

/// A volume, read as these codes if there are any.
pub(crate) fn coded(source: &Arc<dyn BrickSource>, codes: Option<&Arc<LabelCodes>>) -> Arc<dyn BrickSource> {
    match codes {
        Some(codes) => Arc::new(CodedLabels { labels: source.clone(), codes: codes.clone() }),
        None => source.clone(),
    }
}

impl CodedLabels {
    /// Reads voxels of the volume with `read`, and writes their codes, little-endian, to `out`.
    fn read_codes(
        &self,
        out: &mut [u8],
        read: impl FnOnce(&mut [u8]) -> Result<(), BrickError>,
    ) -> Result<(), BrickError> {
        let mut voxels = vec![0; out.len() / 2 * self.labels.voxel_type().bytes()];
        read(&mut voxels)?;
        let nodata = self.labels.nodata().map(|value| value.round() as i64);
        // Neighbours are mostly of one label.
        let mut last = (BACKGROUND, self.codes.code(BACKGROUND));
        for (i, code) in out.chunks_exact_mut(2).enumerate() {
            let label = self.labels.voxel_type().read(&voxels, i).round() as i64;
            if label != last.0 {
                // What holds no data is hidden, as the background is.
                last = (label, self.codes.code(if nodata == Some(label) { BACKGROUND } else { label }));
            }
            code.copy_from_slice(&last.1.to_le_bytes());
        }
        Ok(())
    }
}

impl BrickSource for CodedLabels {
    fn pyramid(&self) -> &Pyramid {
        self.labels.pyramid()
    }
    fn geometry(&self) -> &Geometry {
        self.labels.geometry()
    }
    fn voxel_type(&self) -> VoxelType {
        VoxelType::U16
    }
    fn value_range(&self) -> (f64, f64) {
        (0.0, u16::MAX.into())
    }
    fn is_labels(&self) -> bool {
        true
    }
    fn times(&self) -> u32 {
        self.labels.times()
    }
    fn channels(&self) -> u32 {
        self.labels.channels()
    }
    // Views ask for bins of labels, not of codes.
    fn occupancy_bins(&self, channel: u32) -> OccupancyBins {
        self.labels.occupancy_bins(channel)
    }
    fn occupancy(&self, id: BrickId) -> Occupancy {
        self.labels.occupancy(id)
    }
    fn read_occupancy(&self, page: PageId) -> Result<Vec<Occupancy>, BrickError> {
        self.labels.read_occupancy(page)
    }
    fn advise(&self, ids: &[BrickId]) {
        self.labels.advise(ids);
    }
    fn read_core(&self, id: BrickId, out: &mut [u8]) -> Result<(), BrickError> {
        self.read_codes(out, |voxels| self.labels.read_core(id, voxels))
    }
    fn stored_apron(&self) -> u32 {
        self.labels.stored_apron()
    }
    fn read_apron(&self, id: BrickId, out: &mut [u8]) -> Result<(), BrickError> {
        self.read_codes(out, |voxels| self.labels.read_apron(id, voxels))
    }
    fn bytes_read(&self) -> u64 {
        self.labels.bytes_read()
    }
    fn cache_bytes(&self) -> u64 {
        // Each of the threads that read, of which there is one for each processor, holds the voxels of a brick.
        let threads = std::thread::available_parallelism().map_or(1, usize::from) as u64;
        let edge = u64::from(self.labels.pyramid().edge());
        self.labels.cache_bytes() + threads * edge.pow(3) * self.labels.voxel_type().bytes() as u64
    }
}
