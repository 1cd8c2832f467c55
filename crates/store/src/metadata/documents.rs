//! Writing of documents from a layout, a geometry and the settings.

use super::{ChannelDisplay, ChannelStatistics, StoreInfo};
use crate::codec::Codec;
use crate::downsample::Downsample;
use crate::kind::Kind;
use crate::layout::Layout;
use crate::time;
use brickyard_volume::units::LengthUnit;
use brickyard_volume::{Apron, Geometry, Level, LevelGrid, VoxelType, channel};
use serde::Serialize;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

/// Builds the root group's document from the main pyramid's layout.
///
/// `attributes.brickyard.checksum` covers the rest of the document. Only `verify` compares it, against a regenerated
/// document; opening does not, since other tools may edit.
///
/// A second pyramid's multiscale is in `attributes.brickyard`, since some readers of `attributes.ome` do not stop at
/// the first one.
pub fn root_document(layout: &Layout, geometry: &Geometry, info: &StoreInfo) -> Value {
    let (step, start) = time::step_and_start(info.time.as_ref());
    let multiscale = |layout: &Layout, method: Downsample| {
        let mut multiscale = json!({
            "axes": axes(layout, geometry, time::unit(info.time.as_ref())),
            "datasets": datasets(layout, geometry, step, start),
            "type": method.name(),
        });
        if let Some(name) = &info.name {
            multiscale["name"] = json!(name);
        }
        json!([multiscale])
    };
    let mut ome = json!({ "version": "0.5", "multiscales": multiscale(layout, info.downsample.main()) });
    if info.kind == Kind::Image {
        ome["omero"] = omero(info);
    }
    if info.image_label {
        // Other programs may add what they know: colours, properties, the image.
        ome["image-label"] = json!({});
    }
    let mut ours = json!(info);
    if let Some(second) = info.downsample.second() {
        ours["multiscales"] = multiscale(&layout.of_second(second), second);
    }
    let mut document =
        json!({ "zarr_format": 3, "node_type": "group", "attributes": { "ome": ome, "brickyard": ours } });
    let checksum = xxhash_rust::xxh3::xxh3_64(document.to_string().as_bytes());
    document["attributes"]["brickyard"]["checksum"] = json!(format!("{checksum:016x}"));
    document
}

fn axes(layout: &Layout, geometry: &Geometry, time_unit: Option<&str>) -> Value {
    let axis = |name: &str| {
        let (kind, unit) = match name {
            "t" => ("time", time_unit),
            "c" => ("channel", None),
            _ => ("space", length_along(geometry, name)),
        };
        let mut axis = json!({ "name": name, "type": kind });
        if let Some(unit) = unit {
            axis["unit"] = json!(unit);
        }
        axis
    };
    layout.axes().into_iter().map(axis).collect()
}

/// The unit of an axis of space. OME-Zarr's are lengths; others are in `attributes.brickyard.axis_units`.
fn length_along<'a>(geometry: &'a Geometry, axis: &str) -> Option<&'a str> {
    let axis = ["x", "y", "z"].iter().position(|name| *name == axis)?;
    geometry.axis_unit(axis).filter(|unit| geometry.axis_units.is_none() || LengthUnit::named(unit).is_some())
}

fn datasets(layout: &Layout, geometry: &Geometry, step: f64, start: f64) -> Value {
    let dataset = |(k, level): (usize, &LevelGrid)| {
        let (scale, translation) = geometry.level_placement(level.factor);
        json!({
            "path": layout.level_path(Level(k as u8)),
            "coordinateTransformations": [
                { "type": "scale", "scale": layout.per_axis(step, 1.0, scale.to_array()) },
                { "type": "translation", "translation": layout.per_axis(start, 0.0, translation.to_array()) },
            ],
        })
    };
    layout.pyramid.levels().iter().enumerate().map(dataset).collect()
}

/// Display hints: names, contrast windows and colours.
fn omero(info: &StoreInfo) -> Value {
    let channel = |(c, display): (&ChannelStatistics, ChannelDisplay)| {
        let window = json!({ "min": c.range[0], "max": c.range[1], "start": c.window[0], "end": c.window[1] });
        let color = channel::hex(display.color);
        let mut channel = json!({ "color": color, "window": window, "active": display.is_visible });
        if let Some(name) = display.name {
            channel["label"] = json!(name);
        }
        channel
    };
    let displays = ChannelDisplay::of_channels(&info.channels);
    json!({ "channels": info.channels.iter().zip(displays).map(channel).collect::<Value>() })
}

/// The `zarr.json` document of a level's array.
pub fn level_document(layout: &Layout, level: Level, info: &StoreInfo) -> Value {
    let extent = layout.pyramid.level(level).extent.to_array();
    let shape = layout.per_axis(layout.times, layout.channels, extent);
    let shard = layout.per_axis(layout.shard_times, 1, layout.shard_bricks(level).to_array().map(|n| n * info.edge));
    let mut document = sharded_document(&shape, &shard, &layout.per_axis(1, 1, [info.edge; 3]), info);
    document["dimension_names"] = json!(layout.axes());
    if let Some(nodata) = info.nodata {
        // CF's name, used by xarray; Zarr's own fill value stands for absent bricks.
        document["attributes"]["_FillValue"] = json!(nodata);
    }
    document
}

/// The documents of a level's array, and of its apron array if there is one, with their paths.
pub(crate) fn voxel_documents(store: &Path, layout: &Layout, level: Level, info: &StoreInfo) -> Vec<(PathBuf, Value)> {
    let path = |layout: &Layout| store.join(layout.level_path(level)).join("zarr.json");
    let aprons = info.apron().map(|apron| {
        let layout = layout.of_aprons();
        (path(&layout), apron_document(&layout, level, apron, info))
    });
    [(path(layout), level_document(layout, level, info))].into_iter().chain(aprons).collect()
}

/// The document of a level's apron array: one row of voxels per brick.
fn apron_document(layout: &Layout, level: Level, apron: Apron, info: &StoreInfo) -> Value {
    let with_voxels = |per_axis: Vec<u32>| [per_axis, vec![apron.voxels() as u32]].concat();
    let bricks = layout.pyramid.level(level).bricks.to_array();
    let shape = with_voxels(layout.per_axis(layout.times, layout.channels, bricks));
    let shard = with_voxels(layout.per_axis(layout.shard_times, 1, layout.shard_bricks(level).to_array()));
    sharded_document(&shape, &shard, &with_voxels(layout.per_axis(1, 1, [1; 3])), info)
}

fn sharded_document(shape: &[u32], shard: &[u32], chunk: &[u32], info: &StoreInfo) -> Value {
    let codecs = sharding_codecs(chunk, brick_codecs(info.codec, info.voxel_type));
    let mut document = array_document(shape, shard, info.voxel_type.zarr_name(), codecs);
    document["fill_value"] = if info.voxel_type.is_float() { json!(0.0) } else { json!(0) };
    document
}

/// The codecs of a sharded array with these chunks.
pub(crate) fn sharding_codecs(chunk: &[u32], codecs: Value) -> Value {
    let index_codecs = json!([{ "name": "bytes", "configuration": { "endian": "little" } }, { "name": "crc32c" }]);
    let sharding = json!({
        "chunk_shape": chunk,
        "codecs": codecs,
        "index_codecs": index_codecs,
        "index_location": "end",
    });
    json!([{ "name": "sharding_indexed", "configuration": sharding }])
}

/// An array document with a regular grid and fill value 0.
pub(crate) fn array_document<T: Serialize>(shape: &[T], chunk_shape: &[T], data_type: &str, codecs: Value) -> Value {
    json!({
        "zarr_format": 3,
        "node_type": "array",
        "shape": shape,
        "data_type": data_type,
        "chunk_grid": { "name": "regular", "configuration": { "chunk_shape": chunk_shape } },
        "chunk_key_encoding": { "name": "default", "configuration": { "separator": "/" } },
        "fill_value": 0,
        "codecs": codecs,
        "attributes": {},
    })
}

/// The Zarr `bytes` codec for elements of `element_bytes` bytes.
pub(crate) fn bytes_codec(element_bytes: usize) -> Value {
    match element_bytes {
        1 => json!({ "name": "bytes" }),
        _ => json!({ "name": "bytes", "configuration": { "endian": "little" } }),
    }
}

fn brick_codecs(codec: Codec, voxel_type: VoxelType) -> Value {
    let bytes = bytes_codec(voxel_type.bytes());
    let crc = json!({ "name": "crc32c" });
    match codec.for_voxel_type(voxel_type) {
        Codec::Zstd(level) => {
            json!([bytes, { "name": "zstd", "configuration": { "level": level, "checksum": false } }, crc])
        }
        Codec::ShuffleZstd(level) => {
            // Blosc's own scale from 0 to 9; it maps n to Zstandard's level 2 n - 1.
            let blosc = json!({
                "cname": "zstd", "clevel": (level + 1).div_euclid(2).min(9), "shuffle": "shuffle",
                "typesize": voxel_type.bytes(), "blocksize": 0,
            });
            json!([bytes, { "name": "blosc", "configuration": blosc }, crc])
        }
        Codec::None => json!([bytes, crc]),
    }
}

/// The file content of a document.
pub fn document_bytes(document: &Value) -> Vec<u8> {
    let mut text = format!("{document:#}");
    text.push('\n');
    text.into_bytes()
}
