//! Units of time: their names in OME-Zarr, taken from UDUNITS, and their usual symbols.

/// OME-Zarr's names, their seconds, and their symbols, the usual one first.
const UNITS: &[(&str, f64, &[&str])] = &[
    ("second", 1.0, &["s", "sec", "secs"]),
    ("millisecond", 1e-3, &["ms", "msec"]),
    ("microsecond", 1e-6, &["us", "µs", "μs", "usec"]),
    ("nanosecond", 1e-9, &["ns", "nsec"]),
    ("minute", 60.0, &["min"]),
    ("hour", 3600.0, &["h", "hr"]),
    ("day", 86_400.0, &["d"]),
    ("attosecond", 1e-18, &["as"]),
    ("centisecond", 1e-2, &["cs"]),
    ("decisecond", 1e-1, &["ds"]),
    ("exasecond", 1e18, &["Es"]),
    ("femtosecond", 1e-15, &["fs"]),
    ("gigasecond", 1e9, &["Gs"]),
    ("hectosecond", 1e2, &["hs"]),
    ("kilosecond", 1e3, &["ks"]),
    ("megasecond", 1e6, &["Ms"]),
    ("petasecond", 1e15, &["Ps"]),
    ("picosecond", 1e-12, &["ps"]),
    ("terasecond", 1e12, &["Ts"]),
    ("yoctosecond", 1e-24, &["ys"]),
    ("yottasecond", 1e24, &["Ys"]),
    ("zeptosecond", 1e-21, &["zs"]),
    ("zettasecond", 1e21, &["Zs"]),
];

/// Number of [`UNITS`] listed in a message.
const SHOWN: usize = 7;

/// OME-Zarr's name of a unit of time, from the name itself, its plural or a usual symbol.
///
/// # Errors
/// If there is no such unit of time, with a list of some.
pub fn time_unit(text: &str) -> Result<&'static str, String> {
    let singular = text.strip_suffix('s').unwrap_or(text);
    let unit = UNITS.iter().find(|(name, _, symbols)| singular == *name || symbols.contains(&text));
    unit.map(|(name, ..)| *name).ok_or_else(|| {
        let some = UNITS[..SHOWN].iter().map(|(name, _, symbols)| format!("{name} ({})", symbols[0]));
        let some: Vec<String> = some.collect();
        format!("'{text}' is not a unit of time: expected one such as {}", some.join(", "))
    })
}

/// Seconds per unit of time, by its name; `None` if it is none of OME-Zarr's.
pub fn time_unit_s(name: &str) -> Option<f64> {
    UNITS.iter().find(|(known, ..)| *known == name).map(|(_, seconds, _)| *seconds)
}

/// The usual symbol of a unit of time; unknown names are returned unchanged.
pub fn time_symbol(name: &str) -> &str {
    UNITS.iter().find(|(known, ..)| *known == name).map_or(name, |(.., symbols)| symbols[0])
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
        for (name, _, symbols) in UNITS {
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
