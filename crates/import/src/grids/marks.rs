//! Voxels without data in grids, and in their union: places outside all grids, and those where no grid has data.

use super::Grid;
use super::list::GridList;
use crate::error::{ImportError, Result};
use crate::options::{NoData, OpenOptions};
use crate::source::SourceInfo;
use brickyard_volume::VoxelType;

/// The values of voxels without data.
pub(super) struct Marks {
    /// The value in the union: of floats only the agreed one, as such voxels are NaN.
    pub(super) nodata: Option<f64>,
    /// As [`SourceInfo::knows_nodata`] of the union.
    pub(super) are_known: bool,
    /// The value in each grid, as listed, besides NaN and the infinities.
    pub(super) sought: Vec<Option<f64>>,
}

impl Marks {
    /// Finds them: the union's is the caller's, the list's, that of the first grid with one, or that of a store's steps so far.
    ///
    /// # Errors
    /// If voxels cannot have the list's value.
    pub(super) fn of(list: &GridList, grids: &[Grid], options: &OpenOptions) -> Result<Self> {
        let infos: Vec<&SourceInfo> = grids.iter().map(|grid| grid.source.info()).collect();
        let voxel_type = infos.first().map_or(VoxelType::F32, |info| info.voxel_type);
        let held = options.held_as.and_then(|held| held.nodata).filter(|_| options.nodata == NoData::OfFile);
        let narrowed = |value: f64| if voxel_type.is_float() { f64::from(value as f32) } else { value };
        let sought: Vec<Option<f64>> = infos
            .iter()
            .map(|info| match info.nodata {
                None if !info.knows_nodata && options.nodata == NoData::OfFile => list.nodata.or(held).map(narrowed),
                _ => info.sought_nodata(),
            })
            .collect();
        let nodata = match options.nodata {
            NoData::Value(value) => Some(value),
            NoData::None => None,
            NoData::OfFile => list.nodata.or_else(|| infos.iter().find_map(|info| info.nodata)).or(held),
        };
        let nodata = nodata.map(narrowed);
        if let Some(value) = nodata.filter(|value| !voxel_type.holds(*value)) {
            let problem = format!("\"nodata\" {value}: no {voxel_type} voxel can have this value; write another one");
            return Err(ImportError::invalid(&list.path, problem));
        }
        let has_own = infos.iter().map(|info| info.knows_nodata);
        let are_known = match voxel_type.is_float() {
            true => has_own.clone().any(|known| known) || nodata.is_some() && sought.iter().any(|own| *own != nodata),
            false => nodata.is_none() && has_own.clone().all(|known| known),
        };
        Ok(Self { nodata, are_known, sought })
    }
}
