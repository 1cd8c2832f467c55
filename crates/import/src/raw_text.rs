//! A JSON text beside a raw file, `volume.raw.json` or `volume.json`, with its layout and place in fields named as the options are. The file is read
//! through [`RawSource`]; costs the text.

#[cfg(test)]
mod tests;

use crate::axes::AxisOrder;
use crate::element::Endian;
use crate::error::{ImportError, Result};
use crate::files::{folder_of, name_of};
use crate::labels::SaidKind;
use crate::note::Note;
use crate::options::OpenOptions;
use crate::raw::{RawLayout, RawSource, identity};
use crate::sidecar::{check_raw, text_of};
use crate::source::{Source, SourceInfo};
use crate::stamp::Stamp;
use crate::step_time::{StepTime, TimeSpan, moment_in};
use crate::time::override_time;
use brickyard_volume::{ChannelLook, Extent, Orientation, TimeAxis, VoxelType, counted};
use glam::DVec3;
use serde::Deserialize;
use std::path::{Path, PathBuf};
use std::str::FromStr;

const END: &str = ".json";

/// Ends of raw files' names.
const RAW_ENDS: [&str; 3] = ["raw", "bin", "dat"];

/// The fields of a text. Unknown ones are refused, as they might change the voxels.
#[derive(Debug, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct Fields {
    pub(crate) file: Option<PathBuf>,
    shape: Option<[u32; 3]>,
    dtype: Option<String>,
    endian: Option<String>,
    offset: Option<u64>,
    step_bytes: Option<u64>,
    channel_bytes: Option<u64>,
    axes: Option<String>,
    times: Option<u32>,
    channels: Option<u32>,
    pub(crate) channel_names: Option<Vec<String>>,
    spacing: Option<[f64; 3]>,
    origin: Option<[f64; 3]>,
    unit: Option<String>,
    value_unit: Option<String>,
    time_step: Option<f64>,
    time_unit: Option<String>,
    /// The time of the first step, or of the only one.
    time_start: Option<f64>,
    /// The moment from which the times count.
    time_since: Option<String>,
    /// The time of each step, for unevenly spaced ones.
    time_stamps: Option<Vec<f64>>,
    /// The orientation in a patient: see [`Orientation`].
    orientation: Option<[[f64; 4]; 3]>,
    labels: Option<bool>,
    pub(crate) nodata: Option<f64>,
}

/// Whether a file is such a text: an object of JSON, by its name. `name` is in lower case.
pub(crate) fn is_text(name: &str, start: &[u8]) -> bool {
    let text = start.strip_prefix(b"\xef\xbb\xbf").unwrap_or(start).trim_ascii_start();
    name.ends_with(END) && text.starts_with(b"{")
}

/// The text named by a raw file's whole name, which belongs to no other file.
pub(crate) fn of_whole_name(raw: &Path) -> PathBuf {
    raw.with_file_name(name_of(raw) + END)
}

/// The text beside a raw file: of its whole name, or of its name with another end.
pub(crate) fn beside(raw: &Path) -> Option<PathBuf> {
    let texts = [of_whole_name(raw), raw.with_extension(&END[1..])];
    texts.into_iter().find(|text| text != raw && text.is_file())
}

/// The only raw file of the text's name with another end.
fn only_raw_beside(text: &Path) -> Option<PathBuf> {
    let mut there = RAW_ENDS.iter().map(|end| text.with_extension(end)).filter(|raw| raw.is_file());
    there.next().filter(|_| there.next().is_none())
}

/// Opens a raw file by the text, or by the raw file that it lies beside.
pub(crate) fn open(path: &Path, told: &OpenOptions) -> Result<RawSource> {
    let is_named = is_text_name(path);
    let text = text_for(path);
    let text = &*text;
    let stamp = Stamp::of(text)?;
    let fields = Fields::read(text)?;
    let raw = fields.raw_file(text, (!is_named).then_some(path))?;
    check_raw(text, &raw)?;
    let options = fields.options(text)?;
    let layout = RawLayout::of(&options);
    let needed =
        "has no `shape` or no `dtype`: both are needed, as in {\"shape\": [256, 256, 108], \"dtype\": \"u16\"}";
    let layout = layout.ok_or_else(|| ImportError::invalid(text, needed))?;
    let mapped = RawSource::mapped(&raw, &layout).map_err(|error| match error {
        // The text's own numbers, which no flag replaces.
        ImportError::Options { problem, .. } => ImportError::invalid(text, problem),
        error => error,
    });
    let mut source = mapped?.with_losses(fields.nodata, told)?;
    let mut told = Ok(());
    source = source.described(|info| {
        told = (|| {
            options.override_place(info, text)?;
            override_time(info, text, &options)?;
            fields.set_times(text, info)?;
            fields.count_from(text, info)?;
            info.channel_looks = fields.looks(text, info.channels)?;
            options.override_units(info, text)?;
            fields.orient(text, info)?;
            info.identity = identity(&format!("{}; by", info.identity), &[text])?;
            info.notes.push(Note::new(format!("{} describes the voxels of {}.", name_of(text), name_of(&raw))));
            info.kind = fields.kind(text, info.voxel_type)?;
            if let Some(value) = fields.nodata {
                info.set_nodata(value, "nodata");
            }
            Ok(())
        })();
    });
    told?;
    let time = fields.time_start.filter(|_| source.info().times == 1);
    let time = time.and_then(|time| TimeSpan::of(time, options.time_unit.as_deref().unwrap_or_default()));
    let since = fields.time_since.as_deref().and_then(moment_in);
    source = source.at(StepTime { stamp: time.map(|time| TimeSpan { since, ..time }), increment: None });
    stamp.check(text)?;
    Ok(source)
}

fn is_text_name(path: &Path) -> bool {
    name_of(path).to_ascii_lowercase().ends_with(END)
}

/// The text: the file itself, or the one beside a raw file.
fn text_for(path: &Path) -> PathBuf {
    let beside = if is_text_name(path) { None } else { beside(path) };
    beside.unwrap_or_else(|| path.to_owned())
}

impl Fields {
    fn read(path: &Path) -> Result<Self> {
        let text = text_of(path, "description of a raw file")?;
        let way = "or pass `shape` and `voxel_type` with the raw file; a list of grids has them in \"grids\"";
        serde_json::from_str(&text).map_err(|error| mistake(path, "description of a raw file", &error, way))
    }

    /// The first field of a whole volume's text which says nothing of one array among others.
    pub(crate) fn of_whole(&self) -> Option<&'static str> {
        let said = [
            ("time_start", self.time_start.is_some()),
            ("time_stamps", self.time_stamps.is_some()),
            ("time_since", self.time_since.is_some()),
            ("orientation", self.orientation.is_some()),
            ("labels", self.labels.is_some()),
        ];
        said.into_iter().find(|(_, is_said)| *is_said).map(|(name, _)| name)
    }

    /// The kind of voxels of this type by the field `labels`.
    fn kind(&self, text: &Path, voxel_type: VoxelType) -> Result<SaidKind> {
        const WORD: &str = "the text beside the raw file";
        match self.labels {
            Some(true) if voxel_type.is_float() => {
                Err(ImportError::invalid(text, "has labels of floating-point voxels; labels are whole numbers"))
            }
            Some(true) => Ok(SaidKind::Labels(WORD)),
            Some(false) => Ok(SaidKind::Image(WORD)),
            None => Ok(SaidKind::Unsaid),
        }
    }

    /// Sets the start of the times, or the times themselves.
    fn set_times(&self, text: &Path, info: &mut SourceInfo) -> Result<()> {
        let refuse = |problem: &str| Err(ImportError::invalid(text, problem));
        let unit = info.time.as_ref().and_then(|axis| axis.unit.clone());
        let axis = match (&self.time_stamps, self.time_start, info.time.take()) {
            (None, None, known) => {
                info.time = known;
                return Ok(());
            }
            (Some(_), Some(_), _) => return refuse("has time_start and time_stamps: give one of the two"),
            (Some(_), None, _) if self.time_step.is_some() => {
                return refuse("has time_step and time_stamps: give one of the two");
            }
            (Some(stamps), None, _) => {
                if stamps.len() != info.times as usize {
                    let (found, steps) = (stamps.len(), counted(info.times.into(), "time step"));
                    return refuse(&format!("time_stamps: {found} numbers for {steps}; give one for each"));
                }
                TimeAxis::of_stamps(stamps.clone(), unit)
            }
            (None, Some(start), _) if !start.is_finite() => return refuse("time_start: expected a finite number"),
            // Kept with the file, as the time of its only step.
            (None, Some(_), _) if info.times == 1 && self.time_step.is_none() => return Ok(()),
            (None, Some(_), None) => return refuse("has time_start, but no time_step; give both"),
            (None, Some(_), Some(_)) if self.time_step.is_none() => {
                return refuse("has time_start, but no time_step; give both");
            }
            (None, Some(start), Some(axis)) => {
                let axis = TimeAxis { start, ..axis };
                axis.check(info.times).map(|()| axis)
            }
        };
        info.time = Some(axis.map_err(|problem| ImportError::invalid(text, problem.to_string()))?);
        Ok(())
    }

    /// Sets the moment from which the times count; [`open`] sets that of the only step's time.
    fn count_from(&self, text: &Path, info: &mut SourceInfo) -> Result<()> {
        let Some(since) = &self.time_since else { return Ok(()) };
        let since = moment_in(since).ok_or_else(|| {
            ImportError::invalid(text, "time_since: expected a moment in a short line, as in \"2000-01-01\"")
        })?;
        match &mut info.time {
            Some(axis) => axis.since = Some(since),
            None if self.time_start.is_some() => {}
            None => return Err(ImportError::invalid(text, "has time_since, but no times of the steps; give both")),
        }
        Ok(())
    }

    fn orient(&self, text: &Path, info: &mut SourceInfo) -> Result<()> {
        let Some(rows) = self.orientation else { return Ok(()) };
        if info.geometry.axis_units.is_some() {
            return Err(ImportError::invalid(
                text,
                "orientation: in a patient the axes have one unit of length; give one `unit`",
            ));
        }
        let orientation =
            Orientation::new(rows).map_err(|problem| ImportError::invalid(text, format!("orientation: {problem}")))?;
        info.orientation = Some(orientation);
        Ok(())
    }

    /// The file with the voxels: `named`, if the text was found beside it.
    fn raw_file(&self, text: &Path, named: Option<&Path>) -> Result<PathBuf> {
        let told = self.file.as_ref().map(|file| folder_of(text).join(file));
        let own_name = name_of(text);
        let bare = own_name.get(..own_name.len().saturating_sub(END.len())).filter(|bare| bare.contains('.'));
        match (told, named) {
            (Some(told), Some(named)) if name_of(&told) != name_of(named) => {
                let problem = format!(
                    "describes {}, not {}, which lies beside it: rename the text, or pass `shape` and `voxel_type`",
                    told.display(),
                    named.display()
                );
                Err(ImportError::options(text, problem))
            }
            (_, Some(named)) => Ok(named.to_owned()),
            (Some(told), None) => Ok(told),
            (None, None) => {
                bare.map(|bare| folder_of(text).join(bare)).or_else(|| only_raw_beside(text)).ok_or_else(|| {
                    ImportError::invalid(text, "has no `file`, the name of its raw file; write it into the text")
                })
            }
        }
    }

    /// The options that the fields stand for, but for no data.
    pub(crate) fn options(&self, text: &Path) -> Result<OpenOptions> {
        Ok(OpenOptions {
            shape: self.shape.map(Extent::from_array),
            voxel_type: parsed(&self.dtype, "dtype", text)?,
            endian: parsed::<Endian>(&self.endian, "endian", text)?.unwrap_or_default(),
            offset: self.offset,
            step_bytes: self.step_bytes,
            channel_bytes: self.channel_bytes,
            axes: parsed::<AxisOrder>(&self.axes, "axes", text)?,
            times: self.times,
            channels: self.channels,
            spacing: self.spacing.map(DVec3::from_array),
            origin: self.origin.map(DVec3::from_array),
            unit: self.unit.clone(),
            value_unit: self.value_unit.clone(),
            time_step: self.time_step,
            time_unit: self.time_unit.clone(),
            ..OpenOptions::default()
        })
    }

    pub(crate) fn looks(&self, text: &Path, channels: u32) -> Result<Vec<ChannelLook>> {
        let Some(names) = &self.channel_names else { return Ok(Vec::new()) };
        if names.len() != channels as usize {
            let (names, channels) = (counted(names.len() as u64, "name"), counted(channels.into(), "channel"));
            let problem = format!("channel_names: {names} for {channels}; give one for each");
            return Err(ImportError::invalid(text, problem));
        }
        let name = |name: &String| Some(name.clone()).filter(|name| !name.is_empty());
        let look = |text: &String| ChannelLook { name: name(text), ..ChannelLook::default() };
        Ok(names.iter().map(look).collect())
    }
}

/// A mistake in a text in JSON, called `kind`, with its line and column. `way` is another way on, or empty.
pub(crate) fn mistake(path: &Path, kind: &str, error: &serde_json::Error, way: &str) -> ImportError {
    // Fields are no options, which stand in such quotes.
    let error = error.to_string().replace('`', "'");
    let way = if way.is_empty() { String::new() } else { format!(", {way}") };
    ImportError::invalid(path, format!("a mistake in this {kind}: {error}: correct it there{way}"))
}

/// A field of words.
fn parsed<T: FromStr<Err: std::fmt::Display>>(value: &Option<String>, field: &str, text: &Path) -> Result<Option<T>> {
    let parse = |value: &String| {
        value.parse().map_err(|problem| ImportError::invalid(text, format!("{field} '{value}': {problem}")))
    };
    value.as_ref().map(parse).transpose()
}
