//! GDAL's description of a page's samples as XML (tag 42112): the scale, offset and unit of each one's values.
//!
//! A scale common to all samples of a pixel is applied; unlike ones are not, with a warning.

use super::calibration::Calibration;
use super::xml::{self, Failure, attribute, decoded, next_piece};
use quick_xml::events::{BytesStart, Event};
use std::collections::BTreeMap;
use std::io::BufRead;

/// Most bytes of the description: statistics and names of some thousand samples.
pub(super) const LONGEST: u64 = 1 << 20;
/// Deepest nesting of elements.
const DEEPEST: usize = 64;

/// The meaning of a page's numbers by GDAL; none in files of other programs.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Told {
    pub(super) calibration: Option<Calibration>,
    /// Unit of the values, if all samples have one.
    pub(super) unit: Option<String>,
}

/// One sample's meaning, in the file's words.
#[derive(Clone, Debug, Default, PartialEq)]
struct Band {
    scale: Option<String>,
    offset: Option<String>,
    unit: Option<String>,
}

impl Told {
    /// Numbers kept as stored, for this reason.
    pub(super) fn unread(why: &str) -> Self {
        Self { calibration: Some(Calibration::GdalKept(why.into())), unit: None }
    }

    /// The meaning of pixels of so many samples; `None` where the disk cannot read it.
    pub(super) fn read(text: impl BufRead, samples: u16) -> Result<Self, std::io::Error> {
        match bands(text) {
            Ok(bands) => Ok(Self::of(&bands, samples)),
            Err(Failure::Disk(error)) => Err(error),
            Err(Failure::Meaning(problem)) => Ok(Self::unread(&format!("whose XML {problem}, are not applied"))),
        }
    }

    fn of(bands: &BTreeMap<u16, Band>, samples: u16) -> Self {
        let none = Band::default();
        let band = |sample| bands.get(&sample).unwrap_or(&none);
        let first = band(0);
        let is_common = |same: &dyn Fn(&Band) -> bool| (1..samples.max(1)).all(|sample| same(band(sample)));
        let unit = first.unit.clone().filter(|_| is_common(&|other| other.unit == first.unit));
        let lines: Option<Vec<[f64; 2]>> = (0..samples.max(1)).map(|sample| band(sample).line()).collect();
        let calibration = match lines.as_deref() {
            None => Some(Calibration::GdalKept("which make no values, are not applied".into())),
            Some([line, others @ ..]) if others.iter().any(|other| other != line) => {
                Some(Calibration::GdalKept("which differ from sample to sample, are not applied".into()))
            }
            Some([[slope, intercept], ..]) if [*slope, *intercept] != [1.0, 0.0] => {
                Some(Calibration::Gdal { slope: *slope, intercept: *intercept })
            }
            Some(_) => None,
        };
        Self { calibration, unit }
    }
}

impl Band {
    /// Slope and intercept; `None` if they make no values.
    fn line(&self) -> Option<[f64; 2]> {
        let number = |text: &Option<String>, default| match text {
            Some(text) => text.trim().parse::<f64>().ok().filter(|number| number.is_finite()),
            None => Some(default),
        };
        let line = [number(&self.scale, 1.0)?, number(&self.offset, 0.0)?];
        (line[0] != 0.0).then_some(line)
    }
}

/// An open element whose text has a meaning: the sample's number from 0, and its role.
struct Item {
    sample: u16,
    role: String,
    text: String,
    depth: usize,
}

/// Items with a role, by their sample. Others are statistics, or remarks on the whole file.
fn bands(text: impl BufRead) -> Result<BTreeMap<u16, Band>, Failure> {
    let mut xml = xml::reader(text);
    let (mut piece, mut depth, mut item) = (Vec::new(), 0, None::<Item>);
    let mut bands = BTreeMap::new();
    loop {
        next_piece(&mut xml, &mut piece);
        match xml.read_event_into(&mut piece)? {
            Event::Start(tag) => {
                depth += 1;
                if depth > DEEPEST {
                    return xml::meaning("has elements within elements without end");
                }
                if item.is_none() {
                    item = item_of(&tag, depth)?;
                }
            }
            Event::End(_) => {
                if let Some(whole) = item.take_if(|item| item.depth == depth) {
                    whole.add(&mut bands);
                }
                depth = depth.saturating_sub(1);
            }
            Event::Text(text) => item.iter_mut().for_each(|item| item.text.push_str(&decoded(&text))),
            Event::CData(text) => item.iter_mut().for_each(|item| item.text.push_str(&decoded(&text))),
            Event::GeneralRef(name) => {
                if let Some(item) = &mut item {
                    let found = name.resolve_char_ref()?.map(String::from);
                    let name = decoded(&name).into_owned();
                    let found = found.or_else(|| quick_xml::escape::resolve_predefined_entity(&name).map(String::from));
                    let Some(found) = found else { return xml::meaning(format!("has the entity {name}")) };
                    item.text.push_str(&found);
                }
            }
            Event::Eof if depth == 0 => return Ok(bands),
            Event::Eof => return xml::meaning("ends inside an element: it was cut short"),
            _ => {}
        }
    }
}

fn item_of(tag: &BytesStart, depth: usize) -> Result<Option<Item>, Failure> {
    let is_item = tag.local_name().as_ref().eq_ignore_ascii_case(b"Item");
    let role = attribute(tag, "role")?.unwrap_or_default().to_ascii_lowercase();
    let sample = attribute(tag, "sample")?.and_then(|text| text.trim().parse().ok());
    let item = sample.filter(|_| is_item && matches!(&*role, "scale" | "offset" | "unittype"));
    Ok(item.map(|sample| Item { sample, role, text: String::new(), depth }))
}

impl Item {
    fn add(self, bands: &mut BTreeMap<u16, Band>) {
        let band = bands.entry(self.sample).or_default();
        match &*self.role {
            "scale" => band.scale = Some(self.text),
            "offset" => band.offset = Some(self.text),
            _ => band.unit = Some(self.text.trim().to_owned()).filter(|unit| !unit.is_empty()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn told(items: &str, samples: u16) -> Told {
        Told::read(format!("<GDALMetadata>\n{items}</GDALMetadata>\n").as_bytes(), samples).unwrap()
    }

    fn item(role: &str, sample: u16, text: &str) -> String {
        format!("  <Item name=\"{}\" sample=\"{sample}\" role=\"{role}\">{text}</Item>\n", role.to_uppercase())
    }

    #[test]
    fn scale_offset_and_unit_are_those_of_the_samples() {
        let text = [item("offset", 0, "-273.15"), item("scale", 0, " 0.01 "), item("unittype", 0, "&#176;C &amp; K")];
        let found = told(&text.concat(), 1);
        assert_eq!(found.calibration, Some(Calibration::Gdal { slope: 0.01, intercept: -273.15 }));
        assert_eq!(found.unit.as_deref(), Some("\u{b0}C & K"));
        assert_eq!(
            told(&item("offset", 0, "5"), 1).calibration,
            Some(Calibration::Gdal { slope: 1.0, intercept: 5.0 })
        );
        for none in [
            "".into(),
            item("scale", 0, "1") + &item("offset", 0, "0"),
            item("scale", 1, "3"),
            "<Item name=\"SCALE\" sample=\"0\">3</Item>".into(),
            "<Item name=\"SCALE\" role=\"scale\">3</Item>".into(),
            "<Other sample=\"0\" role=\"scale\">3</Other>".into(),
            item("statistics", 0, "4") + "<Item name=\"A\" sample=\"-1\" role=\"scale\">3</Item>",
        ] {
            assert_eq!(told(&none, 1), Told::default(), "{none}");
        }
        let both = item("scale", 0, "3") + &item("scale", 1, "3.0") + &item("unittype", 0, "m");
        assert_eq!(told(&both, 2).calibration, Some(Calibration::Gdal { slope: 3.0, intercept: 0.0 }));
        assert_eq!(told(&both, 2).unit, None);
    }

    #[test]
    fn numbers_without_a_meaning_are_kept_with_the_reason() {
        let kept = |text: &str, samples| match told(text, samples).calibration {
            Some(Calibration::GdalKept(why)) => why,
            other => panic!("{text}: {other:?}"),
        };
        assert!(kept(&item("scale", 1, "2"), 3).contains("sample to sample"));
        for odd in ["0", "nan", "inf", "1,5", ""] {
            assert!(kept(&item("scale", 0, odd), 1).contains("make no values"), "{odd}");
        }
        assert!(kept("<Item", 1).contains("cut short"));
        assert!(kept("<Item name='A'>", 1).contains("not well-formed"));
        assert!(kept("<Item sample='0' role='scale'>&odd;</Item>", 1).contains("entity odd"));
        assert!(kept(&"<a>".repeat(99), 1).contains("without end"));
        let cut = Told::read("<GDALMetadata><Item".as_bytes(), 1).unwrap();
        assert!(matches!(cut.calibration, Some(Calibration::GdalKept(_))), "{cut:?}");
    }
}
