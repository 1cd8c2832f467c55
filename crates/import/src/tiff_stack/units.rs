//! Units of length in the spellings of TIFF files.

/// UDUNITS name and length in metres of a unit of length; `None` if unknown.
pub(super) fn unit_of(name: &str) -> Option<(&'static str, f64)> {
    Some(match name {
        "nm" | "nanometer" | "nanometre" => ("nanometer", 1e-9),
        // The micro sign, and the Greek letter.
        "um" | "µm" | "μm" | "\\u00B5m" | "\\u00b5m" | "micron" | "microns" | "micrometer" | "micrometre" => {
            ("micrometer", 1e-6)
        }
        "mm" | "millimeter" | "millimetre" => ("millimeter", 1e-3),
        "cm" | "centimeter" | "centimetre" => ("centimeter", 1e-2),
        "m" | "meter" | "metre" => ("meter", 1.0),
        "Å" | "A" | "angstrom" => ("angstrom", 1e-10),
        "in" | "inch" => ("inch", 0.0254),
        _ => return None,
    })
}
