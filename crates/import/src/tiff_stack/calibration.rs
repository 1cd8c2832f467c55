//! Value calibration of stored numbers by ImageJ, where `cf` names a function and `c0`, `c1`, ... are its coefficients, or by GDAL.
//!
//! A straight line, `c0 + c1 * stored`, is applied: ImageJ stores signed 16-bit images just so (`c0=-32768`, `c1=1`).
//! Curves are not applied, with a note. As in ImageJ, only images of 8 and 16 bits are calibrated by it; by GDAL, all are.

use crate::element::{Element, Scale};
use crate::note::Note;
use brickyard_volume::VoxelType;

/// Names of `cf`'s functions, from 0.
const FUNCTIONS: [&str; 14] = [
    "straight line",
    "2nd degree polynomial",
    "3rd degree polynomial",
    "4th degree polynomial",
    "exponential",
    "power",
    "log",
    "Rodbard",
    "gamma variate",
    "y = a + b ln(x - c)",
    "Rodbard (NIH Image)",
    "exponential with offset",
    "Gaussian",
    "exponential recovery",
];
/// The function without coefficients: uncalibrated optical density.
const OPTICAL_DENSITY: usize = 21;
/// Added by ImageJ to signed 16-bit numbers before calibration and display.
pub(super) const SIGNED_OFFSET: f64 = 32768.0;

/// Values of stored numbers, by ImageJ or GDAL.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Calibration {
    Line {
        c0: f64,
        c1: f64,
    },
    /// A calibration that is not applied, in words.
    Curve(String),
    /// GDAL's scale and offset of all samples.
    Gdal {
        slope: f64,
        intercept: f64,
    },
    /// Scales of GDAL that are not applied, and why.
    GdalKept(String),
}

impl Calibration {
    /// Parses the calibration from ImageJ's description, where `value` looks up a key. `None` if stored numbers are the
    /// values.
    pub(super) fn parse<'a>(value: impl Fn(&str) -> Option<&'a str>) -> Option<Self> {
        let number = |key: &str| value(key).and_then(|v| v.parse::<f64>().ok());
        // ImageJ's own default is the line.
        let function = number("cf").unwrap_or(0.0) as usize;
        if function == OPTICAL_DENSITY {
            return Some(Self::Curve("uncalibrated optical density (cf=21)".into()));
        }
        let (name, [c0, c1]) = (FUNCTIONS.get(function)?, [number("c0")?, number("c1")?]);
        if function > 0 {
            return Some(Self::Curve(format!("{name} (cf={function})")));
        }
        if value("zeroclip") == Some("true") {
            return Some(Self::Curve(format!("{name} of c0={c0}, c1={c1}, clipped at zero")));
        }
        if !(c0.is_finite() && c1.is_finite() && c1 != 0.0) {
            return Some(Self::Curve(format!("{name} of c0={c0}, c1={c1}")));
        }
        ((c0, c1) != (0.0, 1.0)).then_some(Self::Line { c0, c1 })
    }

    /// The unit of values calibrated by a straight line; `None` for ImageJ's word for none.
    pub(super) fn unit<'a>(value: impl Fn(&str) -> Option<&'a str>) -> Option<&'a str> {
        // Without coefficients ImageJ calibrates nothing, and ignores the unit.
        let is_line = ["c0", "c1"].iter().all(|key| value(key).is_some_and(|number| number.parse::<f64>().is_ok()));
        let is_curve = matches!(Self::parse(&value), Some(Self::Curve(_)));
        let is_known = value("cf").is_none_or(|function| function.parse() == Ok(0.0));
        let unit = value("vunit").map(str::trim).filter(|unit| !unit.eq_ignore_ascii_case("gray value"));
        unit.filter(|unit| is_line && is_known && !is_curve && !unit.is_empty())
    }

    /// Returns the scale of stored numbers to values (`None` if they are equal), and a note for the user, if any.
    pub(super) fn scale(&self, element: Element, samples: u16) -> (Option<Scale>, Option<Note>) {
        let kept = |why: &str| {
            let warning = format!("ImageJ's calibration of values, {why}: values are kept as stored.");
            (None, Some(Note::warning(warning)))
        };
        let (c0, c1) = match self {
            Self::Curve(name) => return kept(&format!("a {name}, is not applied")),
            Self::Line { c0, c1 } => (*c0, *c1),
            Self::Gdal { slope, intercept } => return Self::by_gdal(element, *slope, *intercept),
            Self::GdalKept(why) => {
                let warning = format!("GDAL's scales of values, {why}: values are kept as stored.");
                return (None, Some(Note::warning(warning)));
            }
        };
        let intercept = match element {
            _ if samples > 1 => return kept("c0 and c1, is for images of one sample a pixel"),
            Element::Voxel(VoxelType::U8 | VoxelType::U16) => c0,
            Element::Voxel(VoxelType::I16) => c0 + c1 * SIGNED_OFFSET,
            _ => return kept("c0 and c1, is for images of 8 and 16 bits, which this is not"),
        };
        let scale = Scale::exact(element, c1, intercept);
        let note = scale.map(|s| {
            Note::new(format!(
                "Values are scaled by {c1} and shifted by {intercept}, as ImageJ's calibration says, and held as {}.",
                s.to
            ))
        });
        (scale, note)
    }

    fn by_gdal(element: Element, slope: f64, intercept: f64) -> (Option<Scale>, Option<Note>) {
        let scale = Scale::exact(element, slope, intercept);
        let is_long = matches!(element, Element::Voxel(VoxelType::I32 | VoxelType::U32));
        let note = scale.map(|Scale { to, .. }| {
            let scaled =
                format!("Values are scaled by {slope} and shifted by {intercept}, as GDAL says, and held as {to}");
            match is_long && to == VoxelType::F32 {
                true => Note::warning(format!("{scaled}, rounded to 24 bits.")),
                false => Note::new(format!("{scaled}.")),
            }
        });
        (scale, note)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use VoxelType::*;

    fn parse(text: &str) -> Option<Calibration> {
        Calibration::parse(|key| text.split(' ').find_map(|l| l.strip_prefix(key)?.strip_prefix('=')))
    }

    #[test]
    fn lines_are_applied_and_curves_named() {
        assert_eq!(parse("cf=0 c0=-32768.0 c1=1.0"), Some(Calibration::Line { c0: -32768.0, c1: 1.0 }));
        assert_eq!(parse("c0=5 c1=0.5 vunit=mm"), Some(Calibration::Line { c0: 5.0, c1: 0.5 }));
        let unit = |text: &'static str| {
            Calibration::unit(|key| text.split(' ').find_map(|line| line.strip_prefix(key)?.strip_prefix('=')))
        };
        assert_eq!([unit("cf=0 c0=5 c1=0.5 vunit=HU"), unit("c0=0 c1=1 vunit=K")], [Some("HU"), Some("K")]);
        for none in ["vunit=HU", "c0=5 vunit=HU", "cf=7 c0=1 c1=2 vunit=HU", "c0=1 c1=2 vunit=", "c0=1 c1=2 vunit=gray"]
        {
            assert_eq!(unit(none).filter(|unit| *unit != "gray"), None, "{none}");
        }
        assert_eq!(Calibration::unit(|key| Some(if key == "vunit" { "Gray Value" } else { "1" })), None);
        for none in ["", "cf=0", "c0=5", "cf=20 c0=1 c1=2", "cf=22 c0=1 c1=2", "c0=0 c1=1", "cf=7"] {
            assert_eq!(parse(none), None, "{none}");
        }
        for (text, words) in [
            ("cf=7 c0=1 c1=2 c2=3", "Rodbard (cf=7)"),
            ("cf=21", "optical density"),
            ("c0=1 c1=2 zeroclip=true", "clipped at zero"),
            ("c0=1 c1=0", "c1=0"),
            ("c0=NaN c1=1", "c0=NaN"),
        ] {
            let calibration = parse(text).unwrap();
            let (scale, note) = calibration.scale(Element::Voxel(U8), 1);
            assert!(
                scale.is_none() && note.as_ref().is_some_and(|n| n.contains(words) && n.is_warning()),
                "{text}: {note:?}"
            );
        }
    }

    #[test]
    fn types_are_those_that_hold_every_value() {
        let line = |t, c0, c1| {
            let (scale, note) = Calibration::Line { c0, c1 }.scale(Element::Voxel(t), 1);
            scale.map(|s| (s.slope, s.intercept, s.to)).ok_or(note)
        };
        assert_eq!(line(U16, -32768.0, 1.0), Ok((1.0, -32768.0, I16)));
        // ImageJ reads signed numbers as unsigned, and gives them the same line.
        assert_eq!(line(I16, -32768.0, 1.0), Err(None));
        assert_eq!(line(I16, -65536.0, 2.0), Ok((2.0, 0.0, I32)));
        assert_eq!(line(U8, 0.0, 0.25), Ok((0.25, 0.0, F32)));
        for t in [I8, U32, F32] {
            assert!(line(t, 1.0, 2.0).unwrap_err().unwrap().contains("8 and 16 bits"));
        }
        let (scale, note) = Calibration::Line { c0: 1.0, c1: 2.0 }.scale(Element::Voxel(U8), 3);
        assert!(scale.is_none() && note.unwrap().contains("one sample"));
    }
}
