//! Documents of arrays made again: all follow from the root document and the volume's extent.

use super::RepairError;
use crate::error::OpenError;
use crate::folder::Folder;
use crate::json::read_json;
use crate::layout::Layout;
use crate::metadata::{StoreInfo, document_bytes, parse_geometry, parse_info, parse_layout};
use crate::ngff::Root;
use crate::pack::disk::{Disk, DiskError};
use crate::pack::output::parent;
use crate::side::array_documents;
use crate::verify::documents::array_change;
use brickyard_import::{SourceInfo, is_of_process};
use brickyard_volume::Level;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

/// Damaged or missing documents, with their contents.
pub(super) fn damaged(folder: &Folder, source: &SourceInfo) -> Result<Vec<(PathBuf, Value)>, RepairError> {
    let store = folder.path();
    let root_path = store.join("zarr.json");
    let root = Root::read(folder, &root_path)?.document;
    let info = parse_info(&root_path, &root)?;
    let layout = layout(folder, &root, &info, source)?;
    parse_geometry(&root_path, &root, &layout, &info)?;
    let second = info.downsample.second().map(|method| layout.of_second(method));
    let mut damaged = Vec::new();
    for (layout, first) in [(&layout, 0)].into_iter().chain(second.as_ref().map(|second| (second, 1))) {
        for level in layout.levels().filter(|level| *level >= Level(first)) {
            for (path, expected) in array_documents(store, layout, level, &info) {
                let is_sound = match read_json(folder, &path) {
                    Ok(found) => array_change(&expected, found, info.times).is_none(),
                    Err(OpenError::Io { path, error }) if is_of_process(&error) => {
                        return Err(OpenError::Io { path, error }.into());
                    }
                    Err(_) => false,
                };
                if !is_sound {
                    damaged.push((path, expected));
                }
            }
        }
    }
    Ok(damaged)
}

/// Writes a document durably.
pub(super) fn write(disk: &Disk, path: &Path, document: &Value) -> Result<(), DiskError> {
    disk.create_parent(path)?;
    disk.write(path, &document_bytes(document))?;
    disk.sync_dir(parent(path))
}

/// The layout by level 0's document, or if it is damaged, by the source's shape. The statistics tell a wrong shape, as
/// they count all voxels.
fn layout(folder: &Folder, root: &Value, info: &StoreInfo, source: &SourceInfo) -> Result<Layout, RepairError> {
    let [root_path, path] = ["zarr.json", "0/zarr.json"].map(|name| folder.path().join(name));
    let of_document = read_json(folder, &path);
    let axes = root["attributes"]["ome"]["multiscales"][0]["axes"].as_array();
    let size = |axis: &Value| match axis["name"].as_str() {
        Some("t") => source.times,
        Some("c") => source.channels,
        Some("z") => source.extent.z,
        Some("y") => source.extent.y,
        _ => source.extent.x,
    };
    let of_source = json!({ "shape": axes.into_iter().flatten().map(size).collect::<Vec<u32>>() });
    let parse = |level_0: &Value| parse_layout(&root_path, root, &path, level_0, info);
    let is_whole = |layout: &Layout| {
        let voxels = layout.pyramid.levels()[0].extent.volume().checked_mul(layout.times.into());
        info.channels.iter().all(|channel| {
            let counts = [channel.count, channel.nan, channel.pos_inf, channel.neg_inf, channel.nodata];
            counts.iter().try_fold(0u64, |sum, count| sum.checked_add(*count)) == voxels
        })
    };
    let of_document = of_document.ok().and_then(|document| parse(&document).ok());
    if let Some(layout) = of_document.clone().filter(is_whole) {
        return Ok(layout);
    }
    if let Some(layout) = parse(&of_source).ok().filter(is_whole).or(of_document) {
        return Ok(layout);
    }
    let what = format!("its shape is {}, which is not that of the counted voxels", source.extent);
    Err(RepairError::Unlike { store: folder.path().into(), what })
}
