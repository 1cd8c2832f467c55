//! BigDataViewer's XML (SpimData): the HDF5 file with the voxels, setups, time points, and their places. Costs the text, streamed, and a
//! matrix per view.

use crate::error::{ImportError, Result};
use crate::files::folder_of;
use quick_xml::Reader;
use quick_xml::events::{BytesStart, Event};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};

/// Longest text read, which bounds each part of it.
const MOST_BYTES: u64 = 64 << 20;

/// Most tags within one another.
const MOST_LEVELS: usize = 64;

/// Most time points.
const MOST_TIMES: usize = 1 << 20;

/// Rows of a world-from-voxel matrix.
pub(super) type Affine = [[f64; 4]; 3];

const UNMOVED: Affine = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]];

/// A setup: the images of one channel, angle, illumination and tile.
#[derive(Clone, Debug, Default)]
pub(super) struct Setup {
    pub(super) id: u32,
    pub(super) name: String,
    /// Voxel size along x, y, z, and its unit.
    pub(super) voxel: Option<[f64; 3]>,
    pub(super) unit: Option<String>,
}

/// Everything told by the XML.
pub(super) struct SpimData {
    pub(super) hdf5: PathBuf,
    pub(super) setups: Vec<Setup>,
    pub(super) times: Vec<u32>,
    /// Views without voxels, as time point and setup.
    pub(super) missing: Vec<(u32, u32)>,
    /// Places of views, by time point and setup.
    pub(super) places: BTreeMap<(u32, u32), Affine>,
}

/// State of the parser.
#[derive(Default)]
struct Reading {
    loader: Option<String>,
    base: String,
    hdf5: Option<String>,
    setups: Vec<Setup>,
    timepoints: Option<String>,
    ends: [Option<u32>; 2],
    times: Vec<u32>,
    missing: Vec<(u32, u32)>,
    places: BTreeMap<(u32, u32), Affine>,
    view: Option<(u32, u32)>,
}

/// Reads such an XML.
pub(super) fn read(path: &Path) -> Result<SpimData> {
    let invalid = |problem: String| ImportError::invalid(path, problem);
    let file = File::open(path).map_err(ImportError::io(path))?;
    let bytes = file.metadata().map_err(ImportError::io(path))?.len();
    if bytes > MOST_BYTES {
        return Err(invalid(format!("has {bytes} bytes, more than any such XML; at most {MOST_BYTES} are read")));
    }
    let mut xml = Reader::from_reader(BufReader::new(file));
    xml.config_mut().expand_empty_elements = true;
    let (mut reading, mut tags, mut text, mut piece) = (Reading::default(), Vec::new(), String::new(), Vec::new());
    loop {
        piece.clear();
        let event = xml.read_event_into(&mut piece);
        let event = event.map_err(|error| invalid(format!("is not well-formed ({error}); export it again")))?;
        match event {
            Event::Start(_) if tags.len() == MOST_LEVELS => {
                return Err(invalid(format!("has more than {MOST_LEVELS} tags within one another; export it again")));
            }
            Event::Start(tag) => {
                tags.push(String::from_utf8_lossy(tag.local_name().as_ref()).into_owned());
                text.clear();
                reading.start(&tags, &tag).map_err(invalid)?;
            }
            Event::Text(part) => text.push_str(&String::from_utf8_lossy(&part)),
            Event::GeneralRef(name) => text.push_str(match &*name.into_inner() {
                b"amp" => "&",
                b"lt" => "<",
                b"gt" => ">",
                b"quot" => "\"",
                b"apos" => "'",
                _ => "?",
            }),
            Event::End(_) => {
                reading.end(&tags, text.trim()).map_err(invalid)?;
                tags.pop();
                text.clear();
            }
            Event::Eof if tags.is_empty() => break,
            Event::Eof => return Err(invalid("cut short: ends within its tags; fetch the file again".into())),
            _ => {}
        }
    }
    reading.finish(path)
}

fn attribute(tag: &BytesStart<'_>, name: &str) -> Option<String> {
    let found = tag.attributes().with_checks(false).flatten().find(|found| found.key.as_ref() == name.as_bytes())?;
    Some(String::from_utf8_lossy(&found.value).into_owned())
}

fn number(tag: &BytesStart<'_>, name: &str) -> Result<u32, String> {
    let text = attribute(tag, name).unwrap_or_default();
    text.trim().parse().map_err(|_| format!("has {name}=\"{text}\", expected a whole number"))
}

fn whole(text: &str) -> Result<u32, String> {
    text.trim().parse().map_err(|_| format!("has '{}' in place of a whole number", shown(text)))
}

fn shown(text: &str) -> String {
    text.chars().take(60).collect()
}

fn numbers<const N: usize>(text: &str) -> Result<[f64; N], String> {
    let numbers: Option<Vec<f64>> =
        text.split_whitespace().map(|word| word.parse().ok().filter(|n: &f64| n.is_finite())).collect();
    let numbers = numbers.and_then(|numbers| <[f64; N]>::try_from(numbers).ok());
    numbers.ok_or_else(|| format!("has '{}' in place of {N} numbers", shown(text)))
}

/// Time points such as `0-10:2, 15`.
fn pattern(text: &str) -> Result<Vec<u32>, String> {
    let mut times = Vec::new();
    for part in text.split(',').map(str::trim).filter(|part| !part.is_empty()) {
        let (range, step) = part.split_once(':').unwrap_or((part, "1"));
        let (first, last) = range.split_once('-').unwrap_or((range, range));
        let (first, last, step) = (whole(first)?, whole(last)?, whole(step)?);
        if step == 0 || last < first || times.len() + ((last - first) / step) as usize >= MOST_TIMES {
            return Err(format!("has the time points '{}', which count nothing", shown(text)));
        }
        times.extend((first..=last).step_by(step as usize));
    }
    Ok(times)
}

/// The matrix that applies `inner`, then `outer`.
fn product(outer: &Affine, inner: &Affine) -> Affine {
    std::array::from_fn(|row| {
        std::array::from_fn(|column| {
            let moved = if column == 3 { outer[row][3] } else { 0.0 };
            (0..3).map(|k| outer[row][k] * inner[k][column]).sum::<f64>() + moved
        })
    })
}

impl Reading {
    fn start(&mut self, tags: &[String], tag: &BytesStart<'_>) -> Result<(), String> {
        match tags.last().map(String::as_str) {
            Some("ImageLoader") => self.loader = Some(attribute(tag, "format").unwrap_or_default()),
            Some("ViewSetup") => self.setups.push(Setup::default()),
            Some("Timepoints") => self.timepoints = attribute(tag, "type"),
            Some("MissingView") => self.missing.push((number(tag, "timepoint")?, number(tag, "setup")?)),
            Some("ViewRegistration") => {
                let view = (number(tag, "timepoint")?, number(tag, "setup")?);
                self.view = Some(view);
                self.places.insert(view, UNMOVED);
            }
            Some("ViewTransform") if attribute(tag, "type").as_deref() != Some("affine") => {
                let kind = attribute(tag, "type").unwrap_or_default();
                return Err(format!("has a ViewTransform of the type '{}', expected affine", shown(&kind)));
            }
            _ => {}
        }
        Ok(())
    }

    fn end(&mut self, tags: &[String], text: &str) -> Result<(), String> {
        let names: Vec<&str> = tags.iter().rev().take(2).map(String::as_str).collect();
        let setup = self.setups.last_mut();
        match (&names[..], setup) {
            (["BasePath", ..], _) => self.base = text.into(),
            (["hdf5", "ImageLoader"], _) => self.hdf5 = Some(text.into()),
            (["id", "ViewSetup"], Some(setup)) => setup.id = whole(text)?,
            (["name", "ViewSetup"], Some(setup)) => setup.name = text.into(),
            (["unit", "voxelSize"], Some(setup)) => setup.unit = (!text.is_empty()).then(|| text.into()),
            (["size", "voxelSize"], Some(setup)) => setup.voxel = Some(numbers(text)?),
            (["first", "Timepoints"], _) => self.ends[0] = Some(whole(text)?),
            (["last", "Timepoints"], _) => self.ends[1] = Some(whole(text)?),
            (["integerpattern", "Timepoints"], _) => self.times = pattern(text)?,
            (["id", "Timepoint"], _) => self.times.push(whole(text)?),
            (["affine", "ViewTransform"], _) => {
                let flat: [f64; 12] = numbers(text)?;
                let inner = std::array::from_fn(|row| std::array::from_fn(|column| flat[4 * row + column]));
                // The last one listed is applied first.
                if let Some(place) = self.view.and_then(|view| self.places.get_mut(&view)) {
                    *place = product(place, &inner);
                }
            }
            _ => {}
        }
        Ok(())
    }

    fn finish(mut self, path: &Path) -> Result<SpimData> {
        let invalid = |problem: &str| ImportError::invalid(path, format!("{problem}; export it again"));
        match self.loader.as_deref() {
            Some("bdv.hdf5") => {}
            Some(other) => {
                let feature = format!("BigDataViewer's image loader {}", shown(other));
                return Err(ImportError::unsupported_but(path, feature, "save it as HDF5 by BigDataViewer's plugins"));
            }
            None => return Err(invalid("names no ImageLoader")),
        }
        if let ("range", [Some(first), Some(last)]) = (self.timepoints.as_deref().unwrap_or_default(), self.ends) {
            if last < first || (last - first) as usize >= MOST_TIMES {
                return Err(invalid("has time points that count nothing"));
            }
            self.times = (first..=last).collect();
        }
        self.times.sort_unstable();
        self.times.dedup();
        let hdf5 = self.hdf5.filter(|name| !name.is_empty()).ok_or_else(|| invalid("names no HDF5 file"))?;
        if self.setups.is_empty() || self.times.is_empty() {
            return Err(invalid("names no setups or no time points"));
        }
        let folder = folder_of(path);
        let hdf5 = if ["", "."].contains(&&*self.base) { folder.join(hdf5) } else { folder.join(self.base).join(hdf5) };
        Ok(SpimData { hdf5, setups: self.setups, times: self.times, missing: self.missing, places: self.places })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_last_transform_is_applied_first() {
        let shift = [[1.0, 0.0, 0.0, 5.0], [0.0, 1.0, 0.0, 6.0], [0.0, 0.0, 1.0, 7.0]];
        let scale = [[2.0, 0.0, 0.0, 0.0], [0.0, 3.0, 0.0, 0.0], [0.0, 0.0, 4.0, 0.0]];
        let both = [[2.0, 0.0, 0.0, 5.0], [0.0, 3.0, 0.0, 6.0], [0.0, 0.0, 4.0, 7.0]];
        assert_eq!(product(&product(&UNMOVED, &shift), &scale), both);
    }

    #[test]
    fn time_points_are_counted() {
        assert_eq!(pattern("0-10:5, 15"), Ok(vec![0, 5, 10, 15]));
        for bad in ["3-1", "1-2:0", "a", "0-4294967295"] {
            assert!(pattern(bad).is_err(), "{bad}");
        }
    }
}
