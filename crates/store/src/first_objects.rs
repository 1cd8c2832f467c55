//! Files of a store at an address that a first picture needs, known from the root document alone, so that all come in one round trip: of each level that has
//! one page for a step and channel, those of ranges and of shards' fingerprints; and the coarsest level's shards, whole, with its aprons'. Of a store opened on this machine
//! before, the root document kept on disk tells them, and they come in the same round trip as its present state.

use crate::error::OpenError;
use crate::folder::MOST_DOCUMENT_BYTES;
use crate::json::parse_json;
use crate::layout::{Layout, ShardId};
use crate::metadata::{StoreInfo, parse_info, parse_layout};
use crate::ngff::Root;
use crate::side::SideArray;
use brickyard_import::zarr::first_documents;
use brickyard_objects::at;
use brickyard_volume::PageId;
use std::path::{Path, PathBuf};

const ROOT: &str = "zarr.json";
const LEVEL_0: &str = "0/zarr.json";

/// Channels whose files are read ahead: more are seldom shown together.
const MOST_CHANNELS: u32 = 4;

/// Most decoded bytes of a shard that is read whole before its length is known.
const MOST_SHARD_BYTES: u64 = 2 << 20;

/// Reads ahead the documents and files of a store at an address, as far as its documents are kept on disk. Whatever changed since is read as it is now.
pub(crate) fn look_ahead(path: &Path) {
    let Ok(Some(place)) = at(path) else { return };
    if place.join(ROOT).is_known() {
        return;
    }
    let kept = |name: &str| place.join(name).kept();
    let Some((root, level_0)) = kept(ROOT).zip(kept(LEVEL_0)) else { return };
    let layout = || -> Result<_, OpenError> {
        let (root_path, level_0_path) = (path.join(ROOT), path.join(LEVEL_0));
        let root = Root::parse(&root_path, &root)?.document;
        let info = parse_info(&root_path, &root)?;
        let level_0 = parse_json(&level_0_path, &level_0)?;
        Ok((parse_layout(&root_path, &root, &level_0_path, &level_0, &info)?, info))
    };
    if let Ok((layout, info)) = layout() {
        let objects = paths(Path::new(""), &layout, &info).into_iter().map(|path| path.to_string_lossy().into_owned());
        place.look_ahead(&first_documents().into_iter().chain(objects).collect::<Vec<_>>(), MOST_DOCUMENT_BYTES);
    }
}

/// The files of the first time step of a store at `path`, those of coarse levels first: connections that are there already take the first ones.
pub(crate) fn paths(path: &Path, layout: &Layout, info: &StoreInfo) -> Vec<PathBuf> {
    let channels = || 0..layout.channels.min(MOST_CHANNELS);
    let arrays = layout.levels().rev().flat_map(|level| {
        let aprons = info.apron().map(|_| SideArray::fingerprints(path, &layout.of_aprons(), level));
        let of_cores =
            [SideArray::ranges(path, layout, level, info.voxel_type), SideArray::fingerprints(path, layout, level)];
        of_cores.into_iter().chain(aprons).map(move |array| (level, array))
    });
    // A level that needs more pages is too fine.
    let few = arrays.filter(|(_, array)| array.steps_per_file() == 1 && array.paging().page_grid().volume() == 1);
    let pages = few.flat_map(|(level, array)| {
        channels().map(move |channel| array.page_path(PageId { time: 0, channel, level, z: 0, y: 0, x: 0 }))
    });
    let level = layout.pyramid.coarsest();
    let bricks = layout.pyramid.level(level).bricks.volume().saturating_mul(layout.shard_times.into());
    let brick_bytes = u64::from(info.edge).pow(3) * info.voxel_type.bytes() as u64;
    let is_small = layout.shard_grid(level).volume() == 1 && bricks.saturating_mul(brick_bytes) <= MOST_SHARD_BYTES;
    let of_channel = |channel| {
        let id = ShardId { group: 0, channel, level, z: 0, y: 0, x: 0 };
        let aprons = info.apron().map(|_| layout.of_aprons().shard_path(path, id));
        [layout.shard_path(path, id)].into_iter().chain(aprons)
    };
    let shards = channels().filter(|_| is_small).flat_map(of_channel);
    shards.chain(pages).collect()
}
