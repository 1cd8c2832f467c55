//! Pages of side data made again from cores: ranges, hashes and fingerprints.

use super::survey::of_file;
use crate::chunks::Chunks;
use crate::error::ReadError;
use crate::layout::ShardId;
use crate::nodata;
use crate::shard::Fingerprint;
use crate::side::{PageFile, PageFiles, SideArray, core_hash};
use crate::stats::{Measure, join};
use crate::store::{Store, bricks_of, grown};
use brickyard_volume::{BrickId, Level, PageId, VoxelBox};
use std::collections::HashMap;

/// A page of fingerprints: of the shards made again, and of the files of the others.
pub(super) fn fingerprints(
    store: &Store,
    chunks: &Chunks,
    page: PageId,
    made: &HashMap<ShardId, Fingerprint>,
) -> Result<Option<PageFile>, ReadError> {
    let array = SideArray::fingerprints(store.path(), chunks.layout(), page.level);
    let paging = array.paging();
    let mut fingerprints = vec![Fingerprint::default(); paging.page_cells()];
    for shard in bricks_of(paging.cells([page.x, page.y, page.z]), 1) {
        let [x, y, z] = shard.to_array();
        let id = ShardId { group: page.time, channel: page.channel, level: page.level, z, y, x };
        let found = match made.get(&id) {
            Some(made) => Some(*made),
            None => of_file(store, chunks, id)?,
        };
        let Some(found) = found else { return Ok(None) };
        fingerprints[paging.locate(shard.to_array()).1] = found;
    }
    Ok(Some(array.page_file(page, bytemuck::cast_slice(&fingerprints))))
}

/// The file of a page of hashes, with the pages of other steps in it.
pub(super) fn hashes(store: &Store, page: PageId) -> Result<Option<PageFile>, ReadError> {
    let array = SideArray::hashes(store.path(), store.layout(), page.level);
    let mut core = vec![0; store.core_bytes()];
    file_of(store, &array, page, |page| {
        let mut bytes = vec![0; array.page_bytes()];
        for (id, place) in store.pyramid().bricks_of_page(page) {
            store.read_core(id, &mut core)?;
            bytes[place * 16..][..16].copy_from_slice(&core_hash(&core).to_le_bytes());
        }
        Ok(bytes)
    })
}

/// The file of a page of ranges, with the pages of other steps in it. Finer levels' pages must be sound.
pub(super) fn ranges<T: Measure>(store: &Store, page: PageId) -> Result<Option<PageFile>, ReadError> {
    let array = SideArray::ranges(store.path(), store.layout(), page.level, store.voxel_type());
    let nodata = store.info().nodata.map(|nodata| T::from_f64_rounded(nodata as f64));
    file_of(store, &array, page, |page| {
        let mut bytes = vec![0; array.page_bytes()];
        for (id, place) in store.pyramid().bricks_of_page(page) {
            let core = store.pyramid().brick_box(id.level, id.index);
            let padded = grown(core, 1, store.pyramid().level(id.level).extent.full_box());
            let mut ends = Vec::with_capacity(4);
            for (region, of_child) in [(core, false), (padded, true)] {
                let mut range = range_of::<T>(store, id, region, nodata)?;
                for child in store.pyramid().children(id.level, id.index) {
                    let child = BrickId { level: Level(id.level.0 - 1), index: child, ..id };
                    let (page, place) = store.sides().ranges_of(child)?;
                    range = join(range, if of_child { page.reach(place) } else { page.core(place) });
                }
                let of_range = range.map(|(low, high)| [low, high].map(T::from_f64_rounded));
                ends.extend(of_range.unwrap_or(T::NO_ENDS));
            }
            bytes[place * size_of_val(&ends[..])..][..size_of_val(&ends[..])]
                .copy_from_slice(bytemuck::cast_slice(&ends));
        }
        Ok(bytes)
    })
}

fn range_of<T: Measure>(
    store: &Store,
    id: BrickId,
    region: VoxelBox,
    nodata: Option<T>,
) -> Result<Option<(f64, f64)>, ReadError> {
    let mut voxels = vec![T::default(); region.extent().volume() as usize];
    store.read_box(id.time, id.channel, id.level, region, bytemuck::cast_slice_mut(&mut voxels))?;
    Ok(nodata::range(&voxels, nodata).to_f64())
}

/// The file of a page: this page made by `make`, those of other steps as they are, or made, too.
fn file_of(
    store: &Store,
    array: &SideArray,
    page: PageId,
    mut make: impl FnMut(PageId) -> Result<Vec<u8>, ReadError>,
) -> Result<Option<PageFile>, ReadError> {
    let (slot, _, filled) = array.place_in_file(page);
    let first = page.time - slot as u32;
    let (mut files, mut file) = (PageFiles::default(), None);
    for time in first..first + filled as u32 {
        let page = PageId { time, ..page };
        let bytes = array.read_page(store.folder(), page).or_else(|_| make(page))?;
        file = files.add(array, page, &bytes);
    }
    Ok(file)
}
