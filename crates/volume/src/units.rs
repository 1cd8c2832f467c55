//! Units: of length by their UDUNITS names, for exact conversions, and of values as free text. Costs nothing.

/// Most characters of a unit that is free text.
pub const MOST_UNIT_CHARS: usize = 64;

/// A unit of length: the only ones that OME-Zarr allows along an axis of space.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LengthUnit {
    /// UDUNITS name.
    pub name: &'static str,
    /// The unit in metres is `digits` times ten to the power of `exponent`.
    digits: f64,
    exponent: i32,
}

const fn unit(name: &'static str, digits: f64, exponent: i32) -> LengthUnit {
    LengthUnit { name, digits, exponent }
}

const LENGTHS: [LengthUnit; 26] = [
    unit("angstrom", 1.0, -10),
    unit("attometer", 1.0, -18),
    unit("centimeter", 1.0, -2),
    unit("decimeter", 1.0, -1),
    unit("exameter", 1.0, 18),
    unit("femtometer", 1.0, -15),
    unit("foot", 3048.0, -4),
    unit("gigameter", 1.0, 9),
    unit("hectometer", 1.0, 2),
    unit("inch", 254.0, -4),
    unit("kilometer", 1.0, 3),
    unit("megameter", 1.0, 6),
    unit("meter", 1.0, 0),
    unit("micrometer", 1.0, -6),
    unit("mile", 1_609_344.0, -3),
    unit("millimeter", 1.0, -3),
    unit("nanometer", 1.0, -9),
    unit("parsec", 3.085_677_581_491_367, 16),
    unit("petameter", 1.0, 15),
    unit("picometer", 1.0, -12),
    unit("terameter", 1.0, 12),
    unit("yard", 9144.0, -4),
    unit("yoctometer", 1.0, -24),
    unit("yottameter", 1.0, 24),
    unit("zeptometer", 1.0, -21),
    unit("zettameter", 1.0, 21),
];

impl LengthUnit {
    /// The unit of this UDUNITS name.
    pub fn named(name: &str) -> Option<Self> {
        LENGTHS.into_iter().find(|unit| unit.name == name)
    }

    /// The unit of this name, in singular or plural and British or American spelling, or of this symbol.
    pub fn of_text(text: &str) -> Option<Self> {
        let text = text.trim();
        let symbol = match text {
            "pm" => "picometer",
            "nm" => "nanometer",
            // The micro sign, and the Greek letter.
            "um" | "\u{b5}m" | "\u{3bc}m" | "micron" | "microns" => "micrometer",
            "mm" => "millimeter",
            "cm" => "centimeter",
            "dm" => "decimeter",
            "m" => "meter",
            "km" => "kilometer",
            // The letter, and the sign.
            "\u{c5}" | "\u{212b}" | "Angstrom" => "angstrom",
            "in" | "inches" => "inch",
            "ft" | "feet" => "foot",
            _ => "",
        };
        let singular = text.strip_suffix('s').unwrap_or(text);
        let american = singular.strip_suffix("metre").map(|prefix| format!("{prefix}meter"));
        Self::named(symbol).or_else(|| Self::named(american.as_deref().unwrap_or(singular)))
    }

    /// The unit in metres.
    pub fn metres(self) -> f64 {
        shifted(self.digits, self.exponent)
    }

    /// A length of this unit in another one; exact but for one rounding where both are metric and less than 10^22 apart.
    pub fn convert(self, length: f64, to: Self) -> f64 {
        let length = if self.digits == to.digits { length } else { length * self.digits / to.digits };
        shifted(length, self.exponent - to.exponent)
    }

    /// A short form for labels: the symbol of common units, and otherwise the name.
    pub fn symbol(self) -> &'static str {
        match self.name {
            "picometer" => "pm",
            "nanometer" => "nm",
            "micrometer" => "\u{b5}m",
            "millimeter" => "mm",
            "centimeter" => "cm",
            "meter" => "m",
            "kilometer" => "km",
            "angstrom" => "\u{c5}",
            other => other,
        }
    }
}

/// The one name, `degree`, of a unit that UDUNITS or CF calls degrees of an angle, also towards a point of the compass; `None` for others, such
/// as degrees of temperature.
pub fn degree_of_text(text: &str) -> Option<&'static str> {
    let text = text.trim();
    let of_angle = ["arc_degree", "angular_degree", "degree"].into_iter().find_map(|name| text.strip_prefix(name));
    let direction =
        of_angle.map(|rest| rest.strip_prefix('s').unwrap_or(rest)).map(|rest| rest.trim_start_matches('_'));
    let is_direction =
        |rest: &str| ["", "north", "south", "east", "west", "true", "N", "S", "E", "W", "T"].contains(&rest);
    (["deg", "\u{b0}"].contains(&text) || direction.is_some_and(is_direction)).then_some("degree")
}

/// The number times a power of ten. Division by a whole power, which is exact, rounds once.
fn shifted(number: f64, exponent: i32) -> f64 {
    let power = 10f64.powi(exponent.abs());
    if exponent < 0 { number / power } else { number * power }
}

/// A short form of an axis's unit for labels.
pub fn unit_symbol(unit: &str) -> &str {
    match LengthUnit::named(unit) {
        Some(length) => length.symbol(),
        None => unit,
    }
}

/// Checks a unit that is free text, and trims it. An error says what is expected.
///
/// # Errors
/// If it is empty, longer than [`MOST_UNIT_CHARS`], or has control characters, or ones that turn the direction of text.
pub fn free_unit(text: &str) -> Result<&str, String> {
    let text = text.trim();
    let is_control = |c: char| {
        c.is_control()
            || matches!(c, '\u{200b}'..='\u{200f}' | '\u{2028}'..='\u{202e}' | '\u{2060}'..='\u{206f}' | '\u{feff}')
    };
    match text {
        "" => Err("expected a unit, such as HU or kg/m\u{b3}".into()),
        _ if text.chars().any(is_control) => Err("a unit has no control characters".into()),
        _ if text.chars().count() > MOST_UNIT_CHARS => Err(format!("expected at most {MOST_UNIT_CHARS} characters")),
        _ => Ok(text),
    }
}

/// Checks an axis's unit: free text as in [`free_unit`], or nothing.
///
/// # Errors
/// As for [`free_unit`].
pub fn axis_unit(text: &str) -> Result<&str, String> {
    if text.trim().is_empty() { Ok("") } else { free_unit(text) }
}

/// A value with its unit, if it has one.
pub fn with_unit(value: &str, unit: Option<&str>) -> String {
    unit.map_or_else(|| value.to_owned(), |unit| format!("{value} {unit}"))
}

/// A name with a unit in parentheses, if there is one.
pub fn name_in_unit(name: &str, unit: Option<&str>) -> String {
    unit.filter(|unit| !unit.is_empty()).map_or_else(|| name.to_owned(), |unit| format!("{name} ({unit})"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lengths_convert_exactly() {
        let convert = |length: f64, from: &str, to: &str| {
            let [from, to] = [from, to].map(|name| LengthUnit::of_text(name).unwrap());
            from.convert(length, to)
        };
        // By factors such as 1e-3 / 1e-6, 0.3 mm would be 300.00000000000006 um or 299.99999999999994 um.
        assert_eq!(convert(0.3, "mm", "um"), 300.0);
        assert_eq!(convert(300.0, "um", "mm"), 0.3);
        assert_eq!(convert(0.7, "nm", "\u{c5}"), 7.0);
        assert_eq!(convert(2.0, "inches", "mm"), 50.8);
        assert_eq!(convert(1.0, "mile", "yard"), 1760.0);
        assert_eq!(convert(1.5, "metres", "kilometre"), 0.0015);
        assert_eq!(convert(-0.1, "parsec", "parsec"), -0.1);
    }

    #[test]
    fn names_and_symbols_are_read_and_others_are_none() {
        for unit in LENGTHS {
            assert_eq!(LengthUnit::of_text(unit.name), Some(unit));
            assert_eq!(LengthUnit::of_text(unit.symbol()), Some(unit), "{}", unit.name);
            assert!(unit.metres() > 0.0);
        }
        for other in ["", "s", "degree", "hPa", "M", "MM", "metre s", "pixel", "index"] {
            assert_eq!(LengthUnit::of_text(other), None, "{other}");
        }
        assert_eq!((unit_symbol("micrometer"), unit_symbol("degree")), ("\u{b5}m", "degree"));
        for one in ["deg", "degree", " degrees", "degrees_north", "degree_E", "degreesN", "\u{b0}", "arc_degree"] {
            assert_eq!(degree_of_text(one), Some("degree"), "{one}");
        }
        for other in ["degC", "degree_C", "degrees_Celsius", "degreeF", "degree2", "degs", "decree", ""] {
            assert_eq!(degree_of_text(other), None, "{other}");
        }
    }

    #[test]
    fn free_text_is_short_and_without_control_characters() {
        assert_eq!(free_unit(" kg/m\u{b3} "), Ok("kg/m\u{b3}"));
        assert_eq!(free_unit(&"\u{b5}".repeat(64)).map(str::len), Ok(128));
        for bad in ["", " \t", "a\nb", "\u{1b}[31mred", "a\u{202e}b", "a\u{85}b", &"x".repeat(65)] {
            assert!(free_unit(bad).is_err(), "{bad:?}");
        }
    }
}
