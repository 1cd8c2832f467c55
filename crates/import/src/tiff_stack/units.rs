//! Units of length in the spellings of TIFF files.

use brickyard_volume::units::LengthUnit;

/// A unit of length; `None` if unknown.
pub(super) fn unit_of(name: &str) -> Option<LengthUnit> {
    match name {
        "\\u00B5m" | "\\u00b5m" => LengthUnit::named("micrometer"),
        "A" => LengthUnit::named("angstrom"),
        _ => LengthUnit::of_text(name),
    }
}
