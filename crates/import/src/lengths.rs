//! Units of length in text headers, by their symbols and names.

/// UDUNITS name of a unit of length; `None` if it is none.
pub(crate) fn length_unit(text: &str) -> Option<&'static str> {
    Some(match text.trim() {
        "nm" | "nanometer" | "nanometers" => "nanometer",
        // The micro sign, and the Greek letter.
        "um" | "µm" | "μm" | "micron" | "microns" | "micrometer" | "micrometers" => "micrometer",
        "mm" | "millimeter" | "millimeters" | "millimetre" => "millimeter",
        "cm" | "centimeter" | "centimeters" | "centimetre" => "centimeter",
        "m" | "meter" | "meters" | "metre" => "meter",
        _ => return None,
    })
}
