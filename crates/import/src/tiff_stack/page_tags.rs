//! Tags of each page about its pixels, which must agree: a stack has one size of pixels and of values, and one no-data value. Costs three tags a page.

use super::description::nearest;
use super::gdal::Told;
use super::page::{OpenTiff, PageFormat};
use crate::error::{ImportError, Result};
use crate::options::{NoData, OpenOptions};
use std::path::Path;

/// A page's tags about its pixels, unless options replace them.
pub(super) struct PageTags {
    nodata: Option<f64>,
    values: Told,
    resolution: Option<[f64; 2]>,
}

impl PageTags {
    pub(super) fn of(tiff: &mut OpenTiff, format: &PageFormat, options: &OpenOptions) -> Result<Self> {
        // NaN holds no data anyway.
        let nodata = tiff.gdal_number()?.filter(|number| !number.is_nan() && options.nodata == NoData::OfFile);
        let resolution = tiff.scale_tags()?.resolution.filter(|_| options.spacing.is_none());
        let values = tiff.gdal_values(format.samples)?;
        Ok(Self { nodata: nodata.map(|value| nearest(value, format.element)), values, resolution })
    }

    /// Refuses a page whose tags differ from the first one's. Some programs tag only the first page; a scale counts for its own page alone.
    pub(super) fn check(&self, path: &Path, page: u32, first: &Self) -> Result<()> {
        if let Some(nodata) = self.nodata.filter(|nodata| Some(*nodata) != first.nodata) {
            let first = first.nodata.map_or("no value".into(), |value| value.to_string());
            let problem = format!(
                "page {page} marks pixels without data with {nodata} (GDAL_NODATA), but page 1 with {first}; give one \
                 value for all with `nodata`"
            );
            return Err(ImportError::options(path, problem));
        }
        let unit = |values: &Told| values.unit.clone();
        let is_other_unit = self.values.unit.is_some() && unit(&self.values) != unit(&first.values);
        if self.values.calibration != first.values.calibration || is_other_unit {
            let problem = format!(
                "page {page} has another scale or unit of values than page 1 (GDAL_METADATA): write all with one, as \
                 gdal_translate -unscale does"
            );
            return Err(ImportError::invalid(path, problem));
        }
        if let (Some([x, y]), Some(expected)) = (self.resolution, first.resolution)
            && [x, y] != expected
        {
            let problem = format!(
                "page {page} has {x} x {y} pixels a unit, but page 1 has {} x {}; give `spacing` for all",
                expected[0], expected[1]
            );
            return Err(ImportError::options(path, problem));
        }
        Ok(())
    }
}
