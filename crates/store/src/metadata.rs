//! The `zarr.json` documents: written by pack (`metadata/documents.rs`), checked field by field on open
//! (`metadata/parse.rs`); and the settings and statistics in them.
//!
//! In the root group, `attributes.ome` follows OME-Zarr 0.5 (in a store of 0.6, `ngff.rs` converts it) and is authoritative for placement; `attributes.brickyard`
//! is [`StoreInfo`]: settings and statistics. Settings determine every array document, so opening compares with
//! generated ones. Unknown keys are ignored; other tools may add theirs.

mod documents;
mod parse;

use crate::codec::Codec;
use crate::downsample::Reductions;
use crate::error::OpenError;
pub use crate::kind::Kind;
use crate::layout::check_edges;
pub use crate::version::FORMAT_VERSION;
use brickyard_volume::units::{axis_unit, free_unit};
use brickyard_volume::{
    Apron, ChannelLook, Foreground, MAX_APRON, OccupancyBins, Orientation, TimeAxis, VoxelType, channel,
};
pub(crate) use documents::{array_document, bytes_codec, sharding_codecs, voxel_documents};
pub use documents::{document_bytes, level_document, root_document};
pub(crate) use parse::{
    OTHERS_STORE, check_array, check_own, parse_displays, parse_geometry, parse_info, parse_label_colors, parse_layout,
    parse_placement, parse_unchecked_geometry,
};
use serde::{Deserialize, Serialize};
use std::path::Path;

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
    /// The unit of the channel's values, if the source or user gave one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub unit: Option<String>,
}

impl Percentiles {
    /// The window without a source's: of the middle 99.8 % of the values, or of all in this range where these are one.
    pub(crate) fn usual_window(&self, range: [f64; 2]) -> [f64; 2] {
        if self.p0_1 < self.p99_9 { [self.p0_1, self.p99_9] } else { range }
    }
}

impl ChannelStatistics {
    /// The window without a source's.
    pub(crate) fn usual_window(&self) -> [f64; 2] {
        self.percentiles.usual_window(self.range)
    }

    /// These statistics with the name, colour and unit of former ones, and their window if a source gave it: if it is not the `usual` one of their values.
    pub(crate) fn with_looks_of(self, former: &Self, usual: [f64; 2]) -> Self {
        let window = if former.window == usual { self.window } else { former.window };
        Self { window, name: former.name.clone(), color: former.color, unit: former.unit.clone(), ..self }
    }

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

    /// Adopts the source's name, colour, unit and window, as far as given.
    pub fn take_look(&mut self, look: &ChannelLook) {
        (self.name, self.color, self.unit) = (look.name.clone(), look.color, look.unit.clone());
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
    /// The unit of the channel's values; `None` if unknown.
    pub unit: Option<String>,
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
            unit: channel.unit.clone(),
        };
        statistics.iter().enumerate().map(display).collect()
    }
}

/// The root group's `brickyard` attribute: the store's settings and statistics.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct StoreInfo {
    /// Format version: [`FORMAT_VERSION`].
    pub version: u32,
    /// The volume's name in `attributes.ome.multiscales`; `None` if it has none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub name: Option<String>,
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
    /// Whether `attributes.ome` says so of labels (`image-label`); older stores of labels do not.
    #[serde(default, skip_serializing_if = "is_default")]
    pub image_label: bool,
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
    /// Units of x, y and z where these are not one unit of length; `attributes.ome` has those of length among them, and
    /// takes precedence: see [`Store::geometry`](crate::Store::geometry).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub axis_units: Option<[String; 3]>,
    /// Whether the source gave a spacing.
    pub calibrated: bool,
    /// Orientation of the volume in a patient, if given by the source.
    #[serde(default)]
    pub orientation: Option<Orientation>,
    /// Axes along which the voxels come in the reverse order of their files', as the coordinates there descend.
    #[serde(default, skip_serializing_if = "is_default")]
    pub turned: [bool; 3],
    /// Axes along which a flip put the voxels in reverse order besides.
    #[serde(default, skip_serializing_if = "is_default")]
    pub flipped: [bool; 3],
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
    /// The value for no data in the source's voxels: an integer as stored, or the float now NaN.
    pub(crate) fn source_nodata(&self) -> Option<f64> {
        self.nodata.map(|nodata| nodata as f64).or(self.blanked)
    }

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
        for (axis, unit) in ["x", "y", "z"].into_iter().zip(self.axis_units.iter().flatten()) {
            if let Err(expected) = axis_unit(unit) {
                return invalid("axis_units", &expected, format!("{unit:?} along {axis}"));
            }
        }
        if self.channels.len() != channels as usize {
            return invalid("channels", &format!("{channels} entries"), self.channels.len().to_string());
        }
        for (i, channel) in self.channels.iter().enumerate() {
            let (range, counts, bins) = (channel.range, channel.histogram.counts.len(), channel.bins);
            if range[0] > range[1] {
                return invalid(&format!("channels[{i}].range"), "low <= high", format!("{range:?}"));
            }
            if let Some(Err(expected)) = channel.unit.as_deref().map(free_unit) {
                return invalid(&format!("channels[{i}].unit"), &expected, format!("{:?}", channel.unit));
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
