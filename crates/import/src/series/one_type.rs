//! One voxel type, and one mark for no data, for the files of a series: as in channels, the smallest type that holds all their values, or the one
//! of [`OpenOptions::to_voxel_type`]; unlike marks become NaN in floats. Costs a reading of the files whose values may be lost.

use crate::conversion::may_lose;
use crate::converted::{Converted, is_to_be_converted};
use crate::described::Described;
use crate::element::common_type;
use crate::error::{ImportError, Result};
use crate::note::Note;
use crate::options::{NoData, OpenOptions};
use crate::part::Part;
use crate::source::{Source, SourceInfo};
use brickyard_volume::VoxelType;
use std::path::{Path, PathBuf};

/// Encoding of a file's voxels: their type, and those without data.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Encoding {
    pub(super) voxel_type: VoxelType,
    pub(super) nodata: Option<f64>,
    pub(super) knows_nodata: bool,
}

impl Encoding {
    /// The encoding of a file, with the caller's value for no data in place of its own.
    pub(super) fn of(info: &SourceInfo, options: &OpenOptions) -> Self {
        let voxel_type = info.voxel_type;
        let (nodata, knows_nodata) = match options.nodata {
            NoData::OfFile => (info.nodata, info.knows_nodata),
            NoData::None => (None, false),
            NoData::Value(value) => (Some(info.narrowed(value)).filter(|value| voxel_type.holds(*value)), false),
        };
        Self { voxel_type, nodata, knows_nodata }
    }

    /// The encoding of all, to which the files are to be converted; `None` if they are encoded alike.
    ///
    /// # Errors
    /// If no type holds all values, or no value can mark the voxels without data.
    pub(super) fn of_all(all: &[Self], paths: &[PathBuf], options: &OpenOptions) -> Result<Option<Self>> {
        let Some(first) = all.first() else { return Ok(None) };
        let is_unlike_type = |own: &Self| own.voxel_type != first.voxel_type;
        let is_unlike_mark = |own: &Self| own.nodata != first.nodata;
        let Some(odd) = all.iter().position(|own| is_unlike_type(own) || is_unlike_mark(own)) else { return Ok(None) };
        let Some(voxel_type) = options.to_voxel_type.or_else(|| common_type(all.iter().map(|own| own.voxel_type)))
        else {
            let odd = all.iter().position(is_unlike_type).unwrap_or(odd);
            let problem = format!(
                "is {}, but {} is {}, and no type holds the values of all: name one with `to_voxel_type`",
                all[odd].voxel_type,
                paths[0].display(),
                first.voxel_type
            );
            return Err(ImportError::options(&paths[odd], problem));
        };
        let odd_mark = all.iter().position(is_unlike_mark);
        if let Some(odd) = odd_mark.filter(|_| !voxel_type.is_float() && options.nodata == NoData::OfFile) {
            let [own, other] = [&all[odd], first].map(|own| own.nodata.map_or("no value".into(), |v| v.to_string()));
            let problem = format!(
                "marks voxels without data with {own}, but {} with {other}; give one value for all with `nodata`, or make them NaN \
                 with `to_voxel_type` f32",
                paths[0].display()
            );
            return Err(ImportError::options(&paths[odd], problem));
        }
        let nodata = first.nodata.filter(|_| odd_mark.is_none());
        let knows_nodata = match voxel_type.is_float() {
            true => all.iter().any(|own| own.nodata.is_some() || own.knows_nodata),
            false => all.iter().all(|own| own.knows_nodata),
        };
        let narrowed = |value: f64| if voxel_type.is_float() { f64::from(value as f32) } else { value };
        Ok(Some(Self { voxel_type, nodata: nodata.map(narrowed), knows_nodata }))
    }

    /// Converts a file's voxels; `part` of them are looked through for losses unless they were before.
    pub(super) fn convert(
        self,
        source: Box<dyn Source>,
        part: &Part,
        options: &OpenOptions,
        path: &Path,
    ) -> Result<Box<dyn Source>> {
        let own = Self::of(source.info(), options);
        let info = SourceInfo { nodata: own.nodata, knows_nodata: own.knows_nodata, ..source.info().clone() };
        if !is_to_be_converted(&info, self.voxel_type) {
            return Ok(source);
        }
        let source = Box::new(Described { info, source, first: 0 });
        Ok(Box::new(Converted::new(source, self.voxel_type, part, options, path)?))
    }

    /// A remark on the encodings that become this one.
    pub(super) fn note(self, all: &[Self]) -> Note {
        let to = self.voxel_type;
        let mut types: Vec<&str> = Vec::new();
        for name in all.iter().map(|own| own.voxel_type.name()) {
            if !types.contains(&name) {
                types.push(name);
            }
        }
        let types = types.join(", ");
        let are_nan = to.is_float() && self.nodata.is_none() && self.knows_nodata;
        let marks = if are_nan { "; voxels without data become NaN" } else { "" };
        Note::new(format!("The files' voxels are {types} and become {to}{marks}."))
    }

    /// Whether a conversion to it may lose values of a file.
    pub(super) fn may_lose(self, own: Self) -> bool {
        may_lose(own.voxel_type, self.voxel_type)
    }
}
