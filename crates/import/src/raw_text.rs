//! A JSON text beside a raw file, `volume.raw.json` or `volume.json`, with its layout and place in fields named as the options are. The file is read
//! through [`RawSource`]; costs the text.

#[cfg(test)]
mod tests;

use crate::axes::AxisOrder;
use crate::element::Endian;
use crate::error::{ImportError, Result};
use crate::files::{folder_of, name_of};
use crate::note::Note;
use crate::options::OpenOptions;
use crate::raw::{RawLayout, RawSource, identity};
use crate::sidecar::{check_raw, text_of};
use crate::stamp::Stamp;
use crate::time::override_time;
use brickyard_volume::{ChannelLook, Extent, counted};
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
    pub(crate) nodata: Option<f64>,
}

/// Whether a file is such a text: an object of JSON, by its name. `name` is in lower case.
pub(crate) fn is_text(name: &str, start: &[u8]) -> bool {
    let text = start.strip_prefix(b"\xef\xbb\xbf").unwrap_or(start).trim_ascii_start();
    name.ends_with(END) && text.starts_with(b"{")
}

/// The text beside a raw file: of its whole name, or of its name with another end.
pub(crate) fn beside(raw: &Path) -> Option<PathBuf> {
    let whole = raw.with_file_name(name_of(raw) + END);
    let texts = [whole, raw.with_extension(&END[1..])];
    texts.into_iter().find(|text| text != raw && text.is_file())
}

/// The only raw file of the text's name with another end.
fn only_raw_beside(text: &Path) -> Option<PathBuf> {
    let mut there = RAW_ENDS.iter().map(|end| text.with_extension(end)).filter(|raw| raw.is_file());
    there.next().filter(|_| there.next().is_none())
}

/// Opens a raw file by the text, or by the raw file that it lies beside.
pub(crate) fn open(path: &Path, told: &OpenOptions) -> Result<RawSource> {
    let is_named = name_of(path).to_ascii_lowercase().ends_with(END);
    let text = if is_named { None } else { beside(path) };
    let text = text.as_deref().unwrap_or(path);
    let stamp = Stamp::of(text)?;
    let fields = Fields::read(text)?;
    let raw = fields.raw_file(text, (!is_named).then_some(path))?;
    check_raw(text, &raw)?;
    let options = fields.options(text)?;
    let layout = RawLayout::of(&options);
    let needed =
        "has no `shape` or no `dtype`: both are needed, as in {\"shape\": [256, 256, 108], \"dtype\": \"u16\"}";
    let mut source = RawSource::mapped(&raw, &layout.ok_or_else(|| ImportError::invalid(text, needed))?)?
        .with_losses(fields.nodata, told)?;
    let mut told = Ok(());
    source = source.described(|info| {
        told = (|| {
            options.override_place(info, text)?;
            override_time(info, text, &options)?;
            info.channel_looks = fields.looks(text, info.channels)?;
            options.override_units(info, text)?;
            info.identity = identity(&format!("{}; by", info.identity), &[text])?;
            info.notes.push(Note::new(format!("{} describes the voxels of {}.", name_of(text), name_of(&raw))));
            if let Some(value) = fields.nodata {
                info.set_nodata(value, "nodata");
            }
            Ok(())
        })();
    });
    told?;
    stamp.check(text)?;
    Ok(source)
}

impl Fields {
    fn read(path: &Path) -> Result<Self> {
        let text = text_of(path, "description of a raw file")?;
        let way = "or pass `shape` and `voxel_type` with the raw file; a list of grids has them in \"grids\"";
        serde_json::from_str(&text).map_err(|error| mistake(path, "description of a raw file", &error, way))
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
        let look = |name: &String| ChannelLook { name: Some(name.clone()), ..ChannelLook::default() };
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
