//! The `zarr.json` documents: written by pack, checked field by field on open.
//!
//! In the root group, `attributes.ome` follows OME-Zarr 0.5 and is authoritative for placement; `attributes.brickyard`
//! is [`StoreInfo`]: settings and statistics. Settings determine every array document, so opening compares with
//! generated ones. Unknown keys are ignored; other tools may add theirs.

use crate::codec::Codec;
use crate::downsample::{Downsample, Reductions};
use crate::error::OpenError;
use crate::json::not_json;
pub use crate::kind::Kind;
use crate::layout::{Layout, check_edges, check_shard_bricks, check_size};
use crate::time;
pub use crate::version::FORMAT_VERSION;
use brickyard_volume::channel;
use brickyard_volume::{
    Apron, ChannelLook, Extent, Foreground, Geometry, LabelColor, Level, MAX_APRON, OccupancyBins, Orientation,
    Placement, Pyramid, TimeAxis, VoxelType,
};
use glam::DVec3;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Number of bins of a [`Histogram`].
pub const HISTOGRAM_BINS: usize = 256;

/// Percentiles of a channel's valid voxels: the values not exceeded by these shares of them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Percentiles {
    /// 0.1th percentile.
    #[serde(rename = "0.1")]
    pub p0_1: f64,
    /// 1st percentile.
    #[serde(rename = "1")]
    pub p1: f64,
    /// 5th percentile.
    #[serde(rename = "5")]
    pub p5: f64,
    /// 50th percentile, the median.
    #[serde(rename = "50")]
    pub p50: f64,
    /// 95th percentile.
    #[serde(rename = "95")]
    pub p95: f64,
    /// 99th percentile.
    #[serde(rename = "99")]
    pub p99: f64,
    /// 99.9th percentile.
    #[serde(rename = "99.9")]
    pub p99_9: f64,
}

/// Histogram of a channel's valid level-0 voxels in [`HISTOGRAM_BINS`] equal bins. The last bin includes its upper
/// edge.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Histogram {
    /// Lower edge of the first bin, in data units.
    pub low: f64,
    /// Width of a bin in data units; positive.
    pub width: f64,
    /// Number of valid voxels in each of the [`HISTOGRAM_BINS`] bins.
    pub counts: Vec<u64>,
}

impl Histogram {
    /// The value below `share` of the counts, assuming even spread within bins.
    fn quantile(&self, share: f64) -> f64 {
        let total: u64 = self.counts.iter().sum();
        let mut rest = share * total as f64;
        for (bin, &count) in self.counts.iter().enumerate() {
            if rest <= count as f64 && count > 0 {
                return self.low + (bin as f64 + rest / count as f64) * self.width;
            }
            rest -= count as f64;
        }
        self.low + self.counts.len() as f64 * self.width
    }
}

/// Level-0 statistics of one channel over all time steps. A voxel is valid if it is finite and not the no-data value
/// ([`StoreInfo::nodata`]).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ChannelStatistics {
    /// Least and greatest valid value; `[0, 0]` if there is none.
    pub range: [f64; 2],
    /// Number of valid voxels.
    pub count: u64,
    /// Number of NaN voxels.
    pub nan: u64,
    /// Number of voxels at positive infinity.
    pub pos_inf: u64,
    /// Number of voxels at negative infinity.
    pub neg_inf: u64,
    /// Number of voxels with the no-data value.
    #[serde(default, skip_serializing_if = "is_default")]
    pub nodata: u64,
    /// Mean of the valid voxels; 0 if there are none.
    pub mean: f64,
    /// Percentiles of the valid voxels.
    pub percentiles: Percentiles,
    /// Histogram of the valid voxels.
    pub histogram: Histogram,
    /// The values `[low, high]` shown as black and white by default.
    pub window: [f64; 2],
    /// The bins of the channel's occupancy masks.
    pub bins: OccupancyBins,
    /// The channel's name, if the source gave one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub name: Option<String>,
    /// The channel's colour, if the source gave one: red, green and blue.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub color: Option<[u8; 3]>,
}

impl ChannelStatistics {
    /// The value not exceeded by `percent` of the valid voxels, 0 to 100. Exact for the range's ends and each of
    /// [`Percentiles`]; in between, off by less than a histogram bin and within the two nearest.
    pub fn percentile(&self, percent: f64) -> f64 {
        let Percentiles { p0_1, p1, p5, p50, p95, p99, p99_9 } = self.percentiles;
        let inner = [(0.1, p0_1), (1.0, p1), (5.0, p5), (50.0, p50), (95.0, p95), (99.0, p99), (99.9, p99_9)];
        let known: Vec<(f64, f64)> = [&[(0.0, self.range[0])], &inner[..], &[(100.0, self.range[1])]].concat();
        let above = known.partition_point(|(known, _)| *known < percent);
        match known.get(above) {
            Some((exact, value)) if *exact == percent || above == 0 => *value,
            Some((_, value)) => {
                let below = known[above - 1].1;
                self.histogram.quantile(percent / 100.0).clamp(below, value.max(below))
            }
            None => self.range[1],
        }
    }

    /// The values worth showing first; `None` if nearly all voxels are equal.
    pub fn foreground(&self) -> Option<Foreground> {
        let Histogram { low, width, counts } = &self.histogram;
        Foreground::of_histogram(*low, *width, counts)
    }

    /// Adopts the source's name, colour and window, as far as given.
    pub fn take_look(&mut self, look: &ChannelLook) {
        (self.name, self.color) = (look.name.clone(), look.color);
        self.window = look.window.unwrap_or(self.window);
    }

    /// Whether any voxel of the channel is NaN or infinite.
    pub fn has_non_finite(&self) -> bool {
        self.nan + self.pos_inf + self.neg_inf > 0
    }
}

/// Default display of a channel.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ChannelDisplay {
    /// The channel's name; `None` if it has none.
    pub name: Option<String>,
    /// The channel's colour: red, green and blue.
    pub color: [u8; 3],
    /// The values shown as black and as the full colour.
    pub window: (f64, f64),
    /// Whether the channel is shown with the others.
    pub is_visible: bool,
}

impl ChannelDisplay {
    /// The default displays of the channels with these statistics.
    pub fn of_channels(statistics: &[ChannelStatistics]) -> Vec<Self> {
        let channels = statistics.len();
        let display = |(i, channel): (usize, &ChannelStatistics)| Self {
            name: channel.name.clone().or_else(|| (channels > 1).then(|| format!("channel {i}"))),
            color: channel.color.unwrap_or_else(|| channel::default_color(i, channels)),
            window: channel.window.into(),
            is_visible: true,
        };
        statistics.iter().enumerate().map(display).collect()
    }
}

/// The root group's `brickyard` attribute: the store's settings and statistics.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct StoreInfo {
    /// Format version: [`FORMAT_VERSION`].
    pub version: u32,
    /// Voxels along the edge of a brick's core.
    pub edge: u32,
    /// Most voxels along a shard's edge.
    pub shard: u32,
    /// Time steps per shard; at most all.
    #[serde(default = "one", skip_serializing_if = "is_one")]
    pub shard_times: u32,
    /// Type of a voxel.
    pub voxel_type: VoxelType,
    /// Compression of the bricks.
    pub codec: Codec,
    /// Reduction behind the coarser levels.
    pub downsample: Reductions,
    /// The meaning of the store's values.
    pub kind: Kind,
    /// The integer for no data; `None` if undefined. Floats use NaN instead.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub nodata: Option<i64>,
    /// The source's no-data value of floats, NaN in the store and for appended steps; `None` if undefined, or for
    /// integers.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub blanked: Option<f64>,
    /// Width of the stored aprons in voxels; 0 if none are stored.
    #[serde(default, skip_serializing_if = "is_default")]
    pub aprons: u32,
    /// Voxel spacing `[x, y, z]` behind the levels' factors. Positions in the world are in `attributes.ome`.
    pub spacing: [f64; 3],
    /// Whether the source gave a spacing.
    pub calibrated: bool,
    /// Orientation of the volume in a patient, if given by the source.
    #[serde(default)]
    pub orientation: Option<Orientation>,
    /// Acquisition times of the steps, if given by the source or user. `attributes.ome` takes precedence for step,
    /// start and unit: see [`Store::time_axis`](crate::Store::time_axis).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub time: Option<TimeAxis>,
    /// Time steps of an appendable store, whose arrays may have one more from an interrupted commit. `None` if all
    /// steps were packed at once, so the arrays' shape counts.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub times: Option<u32>,
    /// Statistics, one per channel.
    pub channels: Vec<ChannelStatistics>,
    /// The identity given by the packed source.
    pub source: String,
    /// A joint hash of the source and the settings.
    pub settings_fingerprint: String,
    /// Whether the store is finished; always true then.
    pub complete: bool,
}

fn one() -> u32 {
    1
}

fn is_one(n: &u32) -> bool {
    *n == 1
}

fn is_default<T: Default + PartialEq>(value: &T) -> bool {
    *value == T::default()
}

impl StoreInfo {
    /// The shape of the stored aprons; `None` if none are stored.
    pub fn apron(&self) -> Option<Apron> {
        (self.aprons > 0).then_some(Apron { edge: self.edge, width: self.aprons })
    }

    fn check(&self, path: &Path, channels: u32) -> Result<(), OpenError> {
        let invalid = |field: &str, expected: &str, found: String| {
            Err(OpenError::invalid(path, format!("attributes.brickyard.{field}"), expected, found))
        };
        if let Err((field, expected)) = check_edges(self.edge, self.shard) {
            return invalid(field, &expected, if field == "edge" { self.edge } else { self.shard }.to_string());
        }
        if self.aprons > MAX_APRON {
            return invalid("aprons", &format!("at most {MAX_APRON} voxels"), self.aprons.to_string());
        }
        if let Some(nodata) =
            self.nodata.filter(|&nodata| self.voxel_type.is_float() || !self.voxel_type.holds(nodata as f64))
        {
            return invalid("nodata", &format!("an integer within {}", self.voxel_type), nodata.to_string());
        }
        if let Some(blanked) = self.blanked.filter(|&blanked| !self.voxel_type.is_float() || !blanked.is_finite()) {
            return invalid("blanked", "a finite number, in a store of floats", blanked.to_string());
        }
        if !self.spacing.iter().all(|s| s.is_finite() && *s > 0.0) {
            return invalid("spacing", "three positive numbers", format!("{:?}", self.spacing));
        }
        if self.channels.len() != channels as usize {
            return invalid("channels", &format!("{channels} entries"), self.channels.len().to_string());
        }
        for (i, channel) in self.channels.iter().enumerate() {
            let (range, counts, bins) = (channel.range, channel.histogram.counts.len(), channel.bins);
            if range[0] > range[1] {
                return invalid(&format!("channels[{i}].range"), "low <= high", format!("{range:?}"));
            }
            if counts != HISTOGRAM_BINS {
                return invalid(&format!("channels[{i}].histogram.counts"), "256 counts", counts.to_string());
            }
            if !(bins.low.is_finite() && bins.width.is_finite() && bins.width > 0.0) {
                return invalid(
                    &format!("channels[{i}].bins"),
                    "a finite low and a positive width",
                    format!("{bins:?}"),
                );
            }
        }
        Ok(())
    }
}

/// Builds the root group's document from the main pyramid's layout.
///
/// `attributes.brickyard.checksum` covers the rest of the document. Only `verify` compares it, against a regenerated
/// document; opening does not, since other tools may edit.
///
/// A second pyramid's multiscale is in `attributes.brickyard`, since some readers of `attributes.ome` do not stop at
/// the first one.
pub fn root_document(layout: &Layout, geometry: &Geometry, info: &StoreInfo) -> Value {
    let multiscale = |layout: &Layout, method: Downsample| {
        json!([{
            "axes": axes(layout, geometry, time::unit(info.time.as_ref())),
            "datasets": datasets(layout, geometry, time::step_and_start(info.time.as_ref())),
            "type": method.name(),
        }])
    };
    let mut ome = json!({ "version": "0.5", "multiscales": multiscale(layout, info.downsample.main()) });
    if info.kind == Kind::Image {
        ome["omero"] = omero(info);
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
            _ => ("space", geometry.unit.as_deref()),
        };
        let mut axis = json!({ "name": name, "type": kind });
        if let Some(unit) = unit {
            axis["unit"] = json!(unit);
        }
        axis
    };
    layout.axes().into_iter().map(axis).collect()
}

fn datasets(layout: &Layout, geometry: &Geometry, (step, start): (f64, f64)) -> Value {
    let dataset = |(k, level): (usize, &brickyard_volume::LevelGrid)| {
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

/// Compares an array document with the expected one; an error names the first differing field. In a store with appended
/// steps an array `may_be_longer`: an interrupted append may have added some.
pub(crate) fn check_array(path: &Path, expected: &Value, found: &Value, may_be_longer: bool) -> Result<(), OpenError> {
    const FIELDS: [&str; 8] =
        ["zarr_format", "node_type", "shape", "data_type", "chunk_grid", "chunk_key_encoding", "fill_value", "codecs"];
    for field in FIELDS {
        let (want, have) = (&expected[field], &found[field]);
        // 0 and 0.0 are the same fill value.
        let same = want == have || (want.as_f64().is_some() && want.as_f64() == have.as_f64());
        let or_more = may_be_longer && field == "shape";
        if !(same || or_more && is_longer(want, have)) {
            let or_more = if or_more { ", or a greater first number" } else { "" };
            return Err(OpenError::invalid(path, field, format!("{want}{or_more}"), have));
        }
    }
    Ok(())
}

/// Whether a shape has at least the expected number of time steps, its first axis, and is the same otherwise.
fn is_longer(expected: &Value, found: &Value) -> bool {
    let times_and_rest = |shape: &Value| {
        let (times, rest) = shape.as_array()?.split_first()?;
        Some((times.as_u64(), rest.to_vec()))
    };
    let (Some(expected), Some(found)) = (times_and_rest(expected), times_and_rest(found)) else { return false };
    expected.1 == found.1 && expected.0 <= found.0
}

/// The remedy for a store written by another program.
pub(crate) const OTHERS_STORE: &str =
    "export it to .npy, .raw, NIfTI or TIFF with the program that wrote it, and pack that";

/// Reads settings and statistics from the root document.
pub(crate) fn parse_info(path: &Path, root: &Value) -> Result<StoreInfo, OpenError> {
    let attributes = &root["attributes"];
    let ours = &attributes["brickyard"];
    if ours.is_null() {
        let feature = "a Zarr without brickyard's side data".into();
        return Err(OpenError::Unsupported { path: path.into(), feature, advice: OTHERS_STORE });
    }
    match ours["version"].as_u64() {
        Some(version) if version == u64::from(FORMAT_VERSION) => {}
        Some(version) if version < u64::from(FORMAT_VERSION) => {
            let store = path.parent().unwrap_or(path).to_path_buf();
            let source = ours["source"].as_str().unwrap_or("its source").to_owned();
            return Err(OpenError::OldFormat { store, version, source_name: source });
        }
        _ => {
            let feature = format!("store format version {} (this program reads {FORMAT_VERSION})", ours["version"]);
            let advice = "open it with a later version of brickyard";
            return Err(OpenError::Unsupported { path: path.into(), feature, advice });
        }
    }
    serde_json::from_value(ours.clone())
        .map_err(|error| OpenError::invalid(path, "attributes.brickyard", "the settings of a store", not_json(&error)))
}

/// Derives the layout from level 0's shape and the settings, and checks both.
pub(crate) fn parse_layout(
    root_path: &Path,
    root: &Value,
    level_path: &Path,
    level_0: &Value,
    info: &StoreInfo,
) -> Result<Layout, OpenError> {
    let names: Vec<&str> = match root["attributes"]["ome"]["multiscales"][0]["axes"].as_array() {
        Some(axes) => axes.iter().filter_map(|a| a["name"].as_str()).collect(),
        None => Vec::new(),
    };
    if !matches!(names[..], ["z", "y", "x"] | ["c", "z", "y", "x"] | ["t", "z", "y", "x"] | ["t", "c", "z", "y", "x"]) {
        let field = "attributes.ome.multiscales[0].axes";
        return Err(OpenError::invalid(root_path, field, "names [t,] [c,] z, y, x", format!("{names:?}")));
    }
    let shape: Option<Vec<u32>> = serde_json::from_value(level_0["shape"].clone()).ok();
    let Some(shape) = shape.filter(|s| s.len() == names.len() && s.iter().all(|&n| n > 0)) else {
        let expected = format!("{} positive integers below 2^32", names.len());
        return Err(OpenError::invalid(level_path, "shape", expected, &level_0["shape"]));
    };
    let size = |name: &str| names.iter().position(|n| *n == name).map_or(1, |i| shape[i]);
    let times = committed_times(root_path, info, &names, level_path, size("t"))?;
    let channels = size("c");
    let extent = Extent::new(size("x"), size("y"), size("z"));
    if let Err((field, expected)) = check_size(extent, times, channels) {
        return Err(OpenError::invalid(level_path, field, expected, &level_0["shape"]));
    }
    info.check(root_path, channels)?;
    let pyramid = Pyramid::new(extent, info.spacing, info.edge);
    let layout = Layout::new(pyramid, times, channels, info.shard).with_shard_times(info.shard_times);
    let unfit = |field: &str, expected| {
        let found = if field == "shard" { info.shard } else { info.shard_times };
        OpenError::invalid(root_path, format!("attributes.brickyard.{field}"), expected, found)
    };
    if layout.shard_times != info.shard_times {
        return Err(unfit("shard_times", format!("1 to {times}, the number of time steps")));
    }
    check_shard_bricks(&layout).map_err(|(field, expected)| unfit(field, expected))?;
    Ok(if names[0] == "t" { layout.with_time() } else { layout })
}

/// The root document's number of time steps, if given, otherwise level 0's.
fn committed_times(
    root_path: &Path,
    info: &StoreInfo,
    axes: &[&str],
    level_path: &Path,
    times_of_level: u32,
) -> Result<u32, OpenError> {
    let Some(times) = info.times else { return Ok(times_of_level) };
    if axes[0] != "t" || times == 0 {
        let expected = if times == 0 { "at least 1" } else { "none without an axis t" };
        return Err(OpenError::invalid(root_path, "attributes.brickyard.times", expected, times));
    }
    if times_of_level < times {
        let expected = format!("at least {times} time steps, by attributes.brickyard.times of the root document");
        return Err(OpenError::invalid(level_path, "shape", expected, times_of_level));
    }
    Ok(times)
}

/// Reads the placement from the pyramid's multiscale, and checks every level's against level 0's.
pub(crate) fn parse_geometry(path: &Path, root: &Value, layout: &Layout) -> Result<Geometry, OpenError> {
    let owner = if layout.second().is_some() { "brickyard" } else { "ome" };
    let multiscale = &root["attributes"][owner]["multiscales"][0];
    let field = |k: usize, what: &str| format!("attributes.{owner}.multiscales[0].datasets[{k}]{what}");
    let datasets = multiscale["datasets"].as_array().map_or(&[][..], |d| d);
    let levels = layout.pyramid.levels();
    if datasets.len() != levels.len() {
        let field = format!("attributes.{owner}.multiscales[0].datasets");
        return Err(OpenError::invalid(path, field, format!("{} levels", levels.len()), datasets.len()));
    }
    let mut placements = Vec::new();
    for (k, dataset) in datasets.iter().enumerate() {
        let expected = layout.level_path(Level(k as u8));
        if dataset["path"] != json!(expected) {
            return Err(OpenError::invalid(path, field(k, ".path"), expected, &dataset["path"]));
        }
        let axes = layout.axes().len();
        let transforms = &dataset["coordinateTransformations"];
        let scale = spatial(transforms, "scale", axes).filter(|s| s.min_element() > 0.0);
        let Some((scale, translation)) = scale.zip(spatial(transforms, "translation", axes)) else {
            let expected = format!("a positive scale and a translation of {axes} numbers");
            return Err(OpenError::invalid(path, field(k, ".coordinateTransformations"), expected, transforms));
        };
        placements.push((scale, translation));
    }
    let axis = multiscale["axes"].as_array().and_then(|a| a.last());
    let unit = axis.and_then(|x| x["unit"].as_str()).map(str::to_owned);
    let geometry = Geometry { spacing: placements[0].0, origin: placements[0].1, unit };
    for (k, (level, found)) in levels.iter().zip(&placements).enumerate() {
        let expected = geometry.level_placement(level.factor);
        // Written in full precision; another tool may have rounded to about seven digits.
        let tolerance = expected.0.max_element() * 1e-5 + geometry.origin.abs().max_element() * 1e-6;
        let near = |a: DVec3, b: DVec3| (a - b).abs().max_element() <= tolerance;
        if !(near(expected.0, found.0) && near(expected.1, found.1)) {
            let show = |(s, t): &(DVec3, DVec3)| format!("scale {s} and translation {t} (x, y, z)");
            let field = field(k, ".coordinateTransformations");
            return Err(OpenError::invalid(path, field, show(&expected), show(found)));
        }
    }
    Ok(geometry)
}

/// Displays from the store's OME metadata, editable by other tools, with unusable entries replaced by the packed ones.
pub(crate) fn parse_displays(root: &Value, info: &StoreInfo) -> Vec<ChannelDisplay> {
    let display = |(i, packed): (usize, ChannelDisplay)| {
        let said = &root["attributes"]["ome"]["omero"]["channels"][i];
        let end = |name: &str| said["window"][name].as_f64().filter(|value| value.is_finite());
        let window = end("start").zip(end("end")).filter(|(start, end)| start <= end);
        let label = said["label"].as_str().map(str::trim).filter(|label| !label.is_empty());
        ChannelDisplay {
            name: label.map(str::to_owned).or_else(|| info.channels[i].name.clone()),
            color: said["color"].as_str().and_then(channel::from_hex).unwrap_or(packed.color),
            window: window.unwrap_or(packed.window),
            is_visible: said["active"].as_bool().unwrap_or(packed.is_visible),
        }
    };
    ChannelDisplay::of_channels(&info.channels).into_iter().enumerate().map(display).collect()
}

/// Label colours from the store's OME metadata, sorted by label; the last entry wins, unusable ones are dropped.
pub(crate) fn parse_label_colors(root: &Value) -> Vec<LabelColor> {
    let said = root["attributes"]["ome"]["image-label"]["colors"].as_array();
    let color = |entry: &Value| {
        let rgba: Vec<u64> = entry["rgba"].as_array()?.iter().filter_map(Value::as_u64).collect();
        let &[r, g, b, _] = &rgba[..] else { return None };
        let is_color = [r, g, b].iter().all(|&part| part <= 255);
        let color = [r, g, b].map(|part| part as f64 / 255.0);
        is_color.then_some((entry["label-value"].as_i64()?, color))
    };
    let colors: BTreeMap<i64, [f64; 3]> = said.into_iter().flatten().filter_map(color).collect();
    colors.into_iter().map(|(label, color)| LabelColor { label, color }).collect()
}

/// The placement from the volume's own world of spacing and origin to the patient's, if the store has an orientation.
pub(crate) fn parse_placement(path: &Path, info: &StoreInfo, geometry: &Geometry) -> Result<Placement, OpenError> {
    let Some(orientation) = &info.orientation else { return Ok(Placement::default()) };
    let field = "attributes.brickyard.orientation";
    let bad = |error| OpenError::invalid(path, field, "an invertible map, together with the spacing", error);
    orientation.placement(geometry).map_err(bad)
}

/// The x, y and z of the first transformation of this kind.
fn spatial(transforms: &Value, kind: &str, axes: usize) -> Option<DVec3> {
    let transform = transforms.as_array()?.iter().find(|t| t["type"] == kind)?;
    let numbers: Vec<f64> = transform[kind].as_array()?.iter().filter_map(Value::as_f64).collect();
    let [.., z, y, x] = numbers[..] else { return None };
    let v = DVec3::new(x, y, z);
    (numbers.len() == axes && v.is_finite()).then_some(v)
}
