//! Units of time: their names in OME-Zarr, taken from UDUNITS, and their usual symbols.

/// OME-Zarr's names, and their symbols, the usual one first.
const UNITS: &[(&str, &[&str])] = &[
    ("second", &["s", "sec", "secs"]),
    ("millisecond", &["ms", "msec"]),
    ("microsecond", &["us", "µs", "μs", "usec"]),
    ("nanosecond", &["ns", "nsec"]),
    ("minute", &["min"]),
    ("hour", &["h", "hr"]),
    ("day", &["d"]),
    ("attosecond", &["as"]),
    ("centisecond", &["cs"]),
    ("decisecond", &["ds"]),
    ("exasecond", &["Es"]),
    ("femtosecond", &["fs"]),
    ("gigasecond", &["Gs"]),
    ("hectosecond", &["hs"]),
    ("kilosecond", &["ks"]),
    ("megasecond", &["Ms"]),
    ("petasecond", &["Ps"]),
    ("picosecond", &["ps"]),
    ("terasecond", &["Ts"]),
    ("yoctosecond", &["ys"]),
    ("yottasecond", &["Ys"]),
    ("zeptosecond", &["zs"]),
    ("zettasecond", &["Zs"]),
];

/// Number of [`UNITS`] listed in a message.
const SHOWN: usize = 7;

/// OME-Zarr's name of a unit of time, from the name itself, its plural or a usual symbol.
///
/// # Errors
/// If there is no such unit of time, with a list of some.
pub fn time_unit(text: &str) -> Result<&'static str, String> {
    let is_it =
        |(name, symbols): &&(&str, &[&str])| text.strip_suffix('s').unwrap_or(text) == *name || symbols.contains(&text);
    UNITS.iter().find(is_it).map(|(name, _)| *name).ok_or_else(|| {
        let some: Vec<String> =
            UNITS[..SHOWN].iter().map(|(name, symbols)| format!("{name} ({})", symbols[0])).collect();
        format!("'{text}' is not a unit of time: expected one such as {}", some.join(", "))
    })
}

/// Seconds per unit of time, by its name; `None` if it is none of OME-Zarr's.
pub(crate) fn time_unit_s(name: &str) -> Option<f64> {
    let prefixes = [
        ("yocto", 1e-24),
        ("zepto", 1e-21),
        ("atto", 1e-18),
        ("femto", 1e-15),
        ("pico", 1e-12),
        ("nano", 1e-9),
        ("micro", 1e-6),
        ("milli", 1e-3),
        ("centi", 1e-2),
        ("deci", 1e-1),
        ("", 1.0),
        ("hecto", 1e2),
        ("kilo", 1e3),
        ("mega", 1e6),
        ("giga", 1e9),
        ("tera", 1e12),
        ("peta", 1e15),
        ("exa", 1e18),
        ("zetta", 1e21),
        ("yotta", 1e24),
    ];
    match (name, name.strip_suffix("second")) {
        ("minute", _) => Some(60.0),
        ("hour", _) => Some(3600.0),
        ("day", _) => Some(86_400.0),
        (_, prefix) => prefixes.iter().find(|(known, _)| Some(*known) == prefix).map(|(_, factor)| *factor),
    }
}

/// The usual symbol of a unit of time; unknown names are returned unchanged.
pub fn time_symbol(name: &str) -> &str {
    UNITS.iter().find(|(known, _)| *known == name).map_or(name, |(_, symbols)| symbols[0])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn symbols_and_names_are_one_unit_each() {
        for (text, name) in [("s", "second"), ("seconds", "second"), ("ms", "millisecond"), ("us", "microsecond")] {
            assert_eq!(time_unit(text), Ok(name));
        }
        for (text, name) in
            [("µs", "microsecond"), ("ns", "nanosecond"), ("min", "minute"), ("h", "hour"), ("d", "day")]
        {
            assert_eq!(time_unit(text), Ok(name));
        }
        for (name, symbols) in UNITS {
            assert_eq!((time_unit(name), time_symbol(name)), (Ok(*name), symbols[0]));
            assert!(symbols.iter().all(|symbol| time_unit(symbol) == Ok(name)), "{name}");
            assert!(time_unit_s(name).is_some(), "{name}");
        }
        assert_eq!(time_symbol("fortnight"), "fortnight");
        assert_eq!(["millisecond", "second", "hour"].map(time_unit_s), [Some(1e-3), Some(1.0), Some(3600.0)]);
        assert_eq!(["fortnight", "kilo", "s"].map(time_unit_s), [None; 3]);
    }

    #[test]
    fn what_is_no_time_is_refused_with_what_is() {
        for text in ["mm", "m", "", "S", "secondss", "Hz"] {
            let message = time_unit(text).unwrap_err();
            assert!(message.contains(text) && message.contains("second (s), millisecond (ms)"), "{message}");
        }
    }
}
