//! Sizes of pixels in the headers of planes, which mostly lack a distance of planes: their common rules for TIFF and pictures.

use crate::error::{ImportError, Result};
use crate::note::{Note, Setting};
use crate::options::OpenOptions;
use crate::source::SourceInfo;
use glam::DVec3;
use std::path::Path;

/// Default pixels per inch of screens and printers, which are no scale of the image.
const DEFAULTS_PER_INCH: [f64; 2] = [72.0, 96.0];
/// Largest relative difference from these when written as whole pixels per metre or hundredths per centimetre: 28.35 for 72.
const DEFAULTS_ROUNDED: f64 = 5e-4;

/// Distances between the centres of voxels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Spacing {
    pub(crate) x: f64,
    pub(crate) y: f64,
    /// `None` if the distance of planes is unknown.
    pub(crate) z: Option<f64>,
}

impl Spacing {
    /// Sets the spacing of `info`, with a warning if the distance of its planes is unknown. `unit` is for the message.
    pub(crate) fn place(self, unit: Option<&str>, info: &mut SourceInfo) {
        let Self { x, y, z } = self;
        info.geometry.spacing = DVec3::new(x, y, z.unwrap_or(x));
        info.calibrated = true;
        if z.is_none() && info.extent.z > 1 {
            let unit = unit.map(|unit| format!(" {unit}")).unwrap_or_default();
            info.notes.push(
                Note::warning(format!(
                    "The file gives the size of pixels, but not the distance of planes: {x}{unit} is taken along z, as \
                 along x; `spacing` gives another."
                ))
                .settled_by(Setting::Spacing),
            );
        }
    }
}

/// A spacing and its unit; either may be unknown.
pub(crate) type Scale = (Option<Spacing>, Option<&'static str>);

/// Refuses a plane whose pixel size or unit differs from the first one's, unless the caller gives it for all.
///
/// # Errors
/// If they differ.
pub(crate) fn check_alike(
    path: &Path,
    (spacing, unit): Scale,
    first_path: &Path,
    (first_spacing, first_unit): Scale,
    options: &OpenOptions,
) -> Result<()> {
    // One pixel in a thousand.
    const TOLERANCE: f64 = 1e-3;
    let is_near = |a: f64, b: f64| (a - b).abs() <= TOLERANCE * a.abs().max(b.abs());
    let is_alike = match (spacing, first_spacing) {
        (Some(a), Some(b)) => is_near(a.x, b.x) && is_near(a.y, b.y),
        (a, b) => a.is_none() && b.is_none(),
    };
    let is_same_unit = options.unit.is_some() || unit == first_unit;
    if (options.spacing.is_some() || is_alike) && is_same_unit {
        return Ok(());
    }
    let describe = |(spacing, unit): Scale| {
        let unit = unit.map(|unit| format!(" {unit}")).unwrap_or_default();
        spacing.map_or("no size".into(), |Spacing { x, y, .. }| format!("{x} x {y}{unit}"))
    };
    let (first_path, [own, other]) =
        (first_path.display(), [(spacing, unit), (first_spacing, first_unit)].map(describe));
    let problem =
        format!("has pixels of {own}, but {first_path} has pixels of {other}; give `spacing` and `unit` for all");
    Err(ImportError::options(path, problem))
}

/// Returns the default of a screen or printer among pixels per inch, and `None` for a scale of the image.
pub(crate) fn default_per_inch(per_inch: f64) -> Option<f64> {
    DEFAULTS_PER_INCH.into_iter().find(|dots| (per_inch - dots).abs() <= dots * DEFAULTS_ROUNDED)
}

/// A note about [`default_per_inch`], whose pixels have no size.
pub(crate) fn default_note(dots: f64) -> Note {
    Note::new(format!(
        "{dots} pixels per inch is the resolution of a screen or printer, not of the data: no spacing is taken."
    ))
    .settled_by(Setting::Spacing)
}
