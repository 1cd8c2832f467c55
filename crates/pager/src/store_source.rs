//! A brick store as a source of the pager: each method delegates to [`Store`].

use crate::source::{BrickError, BrickSource};
use brickyard_store::{FetchRoom, Kind, ReadError, Store};
use brickyard_volume::{BrickId, BrickIndex, Geometry, Occupancy, OccupancyBins, PageId, Pyramid, VoxelType};
use std::time::Duration;

impl BrickSource for Store {
    fn pyramid(&self) -> &Pyramid {
        self.pyramid()
    }

    fn geometry(&self) -> &Geometry {
        self.geometry()
    }

    fn voxel_type(&self) -> VoxelType {
        self.voxel_type()
    }

    fn value_range(&self) -> (f64, f64) {
        self.value_range()
    }

    fn channel_range(&self, channel: u32) -> (f64, f64) {
        self.channel_range(channel)
    }

    fn is_labels(&self) -> bool {
        self.info().kind == Kind::Labels
    }

    fn has_non_finite(&self) -> bool {
        self.has_non_finite()
    }

    fn nodata(&self) -> Option<f64> {
        self.nodata()
    }

    fn times(&self) -> u32 {
        self.times()
    }

    fn channels(&self) -> u32 {
        self.channels()
    }

    fn occupancy_bins(&self, channel: u32) -> OccupancyBins {
        self.occupancy_bins(channel)
    }

    fn occupancy(&self, id: BrickId) -> Occupancy {
        self.occupancy(id).unwrap_or_else(|error| {
            tracing::warn!(%error, "the brick counts as visible");
            Occupancy::ALL
        })
    }

    fn read_occupancy(&self, page: PageId) -> Result<Vec<Occupancy>, BrickError> {
        let places = self.pyramid().paging(page.level).page_cells();
        if self.is_foreign() {
            let mut occupancy = vec![Occupancy::NONE; places];
            for (id, place) in self.pyramid().bricks_of_page(page) {
                occupancy[place] = BrickSource::occupancy(self, id);
            }
            return Ok(occupancy);
        }
        let ranges = self.read_ranges(page).map_err(|error| page_error(self, page, &error))?;
        let bins = self.occupancy_bins(page.channel);
        Ok((0..places).map(|place| ranges.occupancy(place, bins)).collect())
    }

    fn keeps_hashes(&self) -> bool {
        !self.is_foreign()
    }

    fn read_hashes(&self, page: PageId) -> Result<Vec<u128>, BrickError> {
        self.read_hashes(page).map_err(|error| page_error(self, page, &error))
    }

    fn fetchers(&self) -> u32 {
        self.fetchers()
    }

    fn latency(&self) -> Duration {
        self.latency()
    }

    fn fetch(&self, take: &mut dyn FnMut(FetchRoom) -> Vec<BrickId>) {
        self.fetch(take);
    }

    fn is_backed_up(&self) -> bool {
        self.is_backed_up()
    }

    fn advise(&self, ids: &[BrickId]) {
        self.advise(ids);
    }

    fn read_core(&self, id: BrickId, out: &mut [u8]) -> Result<(), BrickError> {
        self.read_core(id, out).map_err(|error| brick_error(id, &error))
    }

    fn stored_apron(&self) -> u32 {
        self.apron().map_or(0, |apron| apron.width)
    }

    fn read_apron(&self, id: BrickId, out: &mut [u8]) -> Result<(), BrickError> {
        self.read_apron(id, out).map_err(|error| brick_error(id, &error))
    }

    fn bytes_read(&self) -> u64 {
        self.bytes_read()
    }

    fn keep_at_most(&self, bytes: u64) {
        self.keep_at_most(bytes);
    }

    fn cache_bytes(&self) -> u64 {
        self.cache_bytes()
    }
}

/// Attributes a page's error to the page's first brick.
fn page_error(store: &Store, page: PageId, error: &ReadError) -> BrickError {
    let corner = store.pyramid().paging(page.level).cells([page.x, page.y, page.z]).min;
    let index = BrickIndex::from_array(corner.to_array());
    brick_error(BrickId { time: page.time, channel: page.channel, level: page.level, index }, error)
}

fn brick_error(id: BrickId, error: &ReadError) -> BrickError {
    let reason = match &error {
        // The error already names its brick.
        ReadError::CorruptBrick { path, id: damaged, error } if *damaged == id => {
            format!("{}: {error}", path.display())
        }
        error => error.to_string(),
    };
    BrickError { id, reason, is_passing: error.is_passing() }
}
