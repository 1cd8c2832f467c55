//! Units of length in text headers, by their symbols and names.

use brickyard_volume::units::LengthUnit;

/// UDUNITS name of a unit of length; `None` if it is none.
pub(crate) fn length_unit(text: &str) -> Option<&'static str> {
    LengthUnit::of_text(text).map(|unit| unit.name)
}
