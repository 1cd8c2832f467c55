//! MetaMorph's stacks (STK): one directory, for the pixels of the first plane, and the other planes behind it. Private tags, always
//! little-endian, give the number of planes, and the place and time of each.
//!
//! The tags' lengths are not those of their types, so their bytes are read here: of UIC2 24 a plane, of UIC1 8 an entry.

use super::description::{Declared, Description};
use super::hyperstack::is_length;
use crate::axes::Axis;
use crate::note::{Note, Setting};
use crate::spacing::Spacing;
use std::io::{Read, Seek, SeekFrom};
use tiff::tags::Tag;

/// Settings of the whole stack.
const UIC1: u16 = 33628;
/// Six numbers of each plane.
pub(super) const UIC2: Tag = Tag::Unknown(33629);

const UIC2_NUMBER: u16 = 33629;
const UIC2_BYTES: u64 = 24;
const ENTRY_BYTES: u64 = 8;
/// Most entries of UIC1 examined: it has some 60 kinds.
const MOST_ENTRIES: u64 = 4096;
/// Most planes of a stack.
const MOST_PLANES: u64 = 1 << 20;

/// Entries of UIC1.
const SPATIAL_CALIBRATION: u32 = 3;
const X_CALIBRATION: u32 = 4;
const Y_CALIBRATION: u32 = 5;
const CALIBRATION_UNITS: u32 = 6;

const DAY_S: f64 = 86_400.0;
/// Largest relative difference of equal plane distances.
const EVEN: f64 = 1e-3;

/// Reads the tags of the directory at `ifd`; `None` if it has none of a stack.
///
/// # Errors
/// If the disk cannot read them.
pub(super) fn read(file: &mut (impl Read + Seek), ifd: u64, file_bytes: u64) -> std::io::Result<Option<Description>> {
    let mut tags = Tags { file, file_bytes };
    let Some(count) = tags.bytes(ifd, 2)?.map(|b| u16::from_le_bytes([b[0], b[1]])) else { return Ok(None) };
    let Some(entries) = tags.bytes(ifd + 2, u64::from(count) * 12)? else { return Ok(None) };
    let find = |number: u16| {
        let entry = entries.as_chunks::<12>().0.iter().find(|e| u16::from_le_bytes([e[0], e[1]]) == number)?;
        Some([4, 8].map(|at| u64::from(long(entry, at))))
    };
    let Some([planes, at]) = find(UIC2_NUMBER) else { return Ok(None) };
    let uic2 = if planes <= MOST_PLANES { tags.bytes(at, planes * UIC2_BYTES)? } else { None };
    let Some(uic2) = uic2.filter(|bytes| !bytes.is_empty()) else {
        let problem = format!("is a MetaMorph stack (STK) of {planes} planes, but its tag 33629 (UIC2) is cut short");
        return Ok(Some(Description::unreadable(problem)));
    };
    let mut description = described(uic2.as_chunks().0);
    let settings = match find(UIC1) {
        Some([entries, at]) => tags.bytes(at, entries.min(MOST_ENTRIES) * ENTRY_BYTES)?,
        None => None,
    };
    tags.calibrate(&mut description, &settings.unwrap_or_default())?;
    Ok(Some(description))
}

/// Describes planes by the numbers of each.
fn described(planes: &[[u8; UIC2_BYTES as usize]]) -> Description {
    let count = planes.len() as u32;
    let mut declared = Declared {
        in_one_directory: true,
        of_each_page: count == 1,
        page_axes: vec![Axis::Z],
        z: count,
        ..Declared::one_plane()
    };
    let distances: Vec<f64> = planes.iter().map(|p| f64::from(long(p, 0)) / f64::from(long(p, 4))).collect();
    let created = |plane: &[u8; UIC2_BYTES as usize]| (f64::from(long(plane, 8)), f64::from(long(plane, 12)) / 1000.0);
    let mut description = Description::default();
    let is_z = count > 1 && distances.iter().all(|&distance| distance != 0.0);
    let is_t = count > 1 && planes.windows(2).all(|pair| long(&pair[0], 12) != long(&pair[1], 12));
    if is_z {
        let first = distances[0];
        let is_even = distances.iter().all(|d| (d - first).abs() <= EVEN * first);
        match is_even && is_length(first) {
            true => description.spacing = Some(Spacing { x: 1.0, y: 1.0, z: Some(first) }),
            false => {
                let note = "MetaMorph's planes are not evenly spaced; their distances are left out.";
                description.notes.push(Note::warning(note).settled_by(Setting::Spacing));
            }
        }
    } else if is_t {
        declared = Declared { page_axes: vec![Axis::T], z: 1, times: count, ..declared };
        let (first_day, _) = created(&planes[0]);
        let stamps =
            planes.iter().map(created).map(|(day, second)| (day - first_day) * DAY_S + second).collect::<Vec<_>>();
        let first = stamps[0];
        let stamps = stamps.into_iter().map(|stamp| stamp - first).collect();
        description.set_stamps(stamps, "s", "MetaMorph's");
    } else if count > 1 {
        let note = "MetaMorph's planes have no distances, and no times of their own: they are taken along z.";
        description.notes.push(Note::new(note));
    }
    description.declared = Some(declared);
    description
}

fn long(bytes: &[u8], at: usize) -> u32 {
    bytes.get(at..at + 4).map_or(0, |b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]))
}

struct Tags<'a, R> {
    file: &'a mut R,
    file_bytes: u64,
}

impl<R: Read + Seek> Tags<'_, R> {
    /// Bytes of the file; `None` past its end.
    fn bytes(&mut self, at: u64, count: u64) -> std::io::Result<Option<Vec<u8>>> {
        if at.checked_add(count).is_none_or(|end| end > self.file_bytes) {
            return Ok(None);
        }
        let mut bytes = vec![0; count as usize];
        self.file.seek(SeekFrom::Start(at))?;
        self.file.read_exact(&mut bytes)?;
        Ok(Some(bytes))
    }

    /// Adds the size of pixels from the entries of UIC1.
    fn calibrate(&mut self, description: &mut Description, entries: &[u8]) -> std::io::Result<()> {
        let find = |kind| entries.as_chunks::<8>().0.iter().find(|e| long(*e, 0) == kind).map(|e| long(e, 4));
        let depth = description.spacing.and_then(|spacing| spacing.z);
        let find_size = |kind| find(kind).filter(|_| find(SPATIAL_CALIBRATION) != Some(0));
        let mut size = |kind| {
            let Some(at) = find_size(kind) else { return Ok::<_, std::io::Error>(None) };
            let fraction = self.bytes(at.into(), 8)?;
            Ok(fraction.map(|b| f64::from(long(&b, 0)) / f64::from(long(&b, 4))).filter(|&size| is_length(size)))
        };
        let (x, y) = (size(X_CALIBRATION)?, size(Y_CALIBRATION)?);
        let Some((x, y)) = x.zip(y.or(x)) else {
            if depth.is_some() {
                description.set_unit(Some("um"));
                let note = "MetaMorph's file says how far planes lie apart, not how large pixels are: 1 is taken along x and y.";
                description.notes.push(Note::warning(note).settled_by(Setting::Spacing));
            }
            return Ok(());
        };
        let unit = match find(CALIBRATION_UNITS) {
            Some(at) => self.text(at.into())?,
            None => None,
        };
        let unit = unit.filter(|unit| !unit.is_empty()).unwrap_or_else(|| "um".into());
        // Distances of planes are micrometres, whatever the pixels' unit.
        let sizes = [Some((x, unit.clone())), Some((y, unit)), depth.map(|depth| (depth, "um".into()))];
        description.set_physical_sizes(sizes);
        Ok(())
    }

    /// A text with its length before it.
    fn text(&mut self, at: u64) -> std::io::Result<Option<String>> {
        const LONGEST: u32 = 256;
        let Some(length) = self.bytes(at, 4)?.map(|b| long(&b, 0)).filter(|length| *length <= LONGEST) else {
            return Ok(None);
        };
        let text = self.bytes(at + 4, length.into())?;
        let text = text.map(|bytes| bytes.iter().map(|&b| b as char).collect::<String>());
        Ok(text.map(|text| text.trim_matches(['\0', ' ']).to_owned()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{is_warned, said};
    use brickyard_volume::TimeAxis;
    use std::io::Cursor;

    /// A directory with UIC2 of planes (distance in halves, milliseconds), and UIC1 of a calibration.
    fn stack(planes: &[(u32, u32)], calibration: &[(u32, u32)]) -> Vec<u8> {
        let longs = |numbers: &[u32]| numbers.iter().flat_map(|n| n.to_le_bytes()).collect::<Vec<_>>();
        let entry = |tag: u16, kind: u16, count: u32, at: u32| {
            [&tag.to_le_bytes()[..], &kind.to_le_bytes(), &count.to_le_bytes(), &at.to_le_bytes()].concat()
        };
        // At 0 the directory, at 100 fractions and a text, at 200 UIC1, from 1,000 on UIC2.
        let mut bytes = vec![0; 1000];
        let uic2 = planes.iter().flat_map(|&(z, ms)| longs(&[z, 2, 2_459_000, ms, 0, 0])).collect::<Vec<_>>();
        let uic1 = calibration.iter().flat_map(|&(kind, value)| longs(&[kind, value])).collect::<Vec<_>>();
        let directory = [
            vec![2, 0],
            entry(UIC1, 4, calibration.len() as u32, 200),
            entry(UIC2_NUMBER, 5, planes.len() as u32, 1000),
        ];
        bytes[..26].copy_from_slice(&directory.concat());
        bytes[100..116].copy_from_slice(&longs(&[1, 4, 1, 8]));
        bytes[120..127].copy_from_slice(b"\x03\0\0\0nm\0");
        bytes[200..200 + uic1.len()].copy_from_slice(&uic1);
        bytes.extend(uic2);
        bytes
    }

    fn described(bytes: &[u8]) -> Option<Description> {
        read(&mut Cursor::new(bytes), 0, bytes.len() as u64).unwrap()
    }

    #[test]
    fn distances_make_slices_and_times_steps() {
        let d = described(&stack(&[(1, 5), (1, 5), (1, 9)], &[(4, 100), (5, 108)])).unwrap();
        let declared = d.declared.unwrap();
        assert_eq!((declared.z, declared.times, declared.page_axes), (3, 1, vec![Axis::Z]));
        assert_eq!((d.spacing, d.unit), (Some(Spacing { x: 0.25, y: 0.125, z: Some(0.5) }), Some("micrometer")));
        let d = described(&stack(&[(0, 500), (0, 1500), (0, 2500)], &[])).unwrap();
        assert_eq!(d.declared.as_ref().map(|d| (d.z, d.times, d.page_axes.clone())), Some((1, 3, vec![Axis::T])));
        let step = TimeAxis { step: 1.0, unit: Some("second".into()), ..TimeAxis::default() };
        assert_eq!((d.spacing, d.time), (None, Some(step)));
        let d = described(&stack(&[(0, 5), (0, 5), (3, 9)], &[])).unwrap();
        assert_eq!(d.declared.as_ref().map(|d| (d.z, d.times)), Some((3, 1)));
        assert!(d.notes[0].contains("no distances"));
        let d = described(&stack(&[(1, 5), (2, 6), (3, 9)], &[])).unwrap();
        assert!(d.spacing.is_none() && d.notes[0].contains("not evenly"), "{:?}", d.notes);
        assert!(is_warned(&said(&d.notes), "not evenly"));
    }

    #[test]
    fn pixels_are_measured_where_the_stack_is_calibrated() {
        let of = |calibration: &[(u32, u32)]| {
            let d = described(&stack(&[(1, 5), (1, 6)], calibration)).unwrap();
            (d.spacing.map(|s| [s.x, s.y, s.z.unwrap()]), d.unit)
        };
        let (spacing, unit) = of(&[(3, 1), (4, 100), (6, 120)]);
        assert!(spacing.is_some_and(|[x, y, z]| x == 0.25 && y == 0.25 && (z - 500.0).abs() < 1e-9), "{spacing:?}");
        assert_eq!(unit, Some("nanometer"));
        let uncalibrated = (Some([1.0, 1.0, 0.5]), Some("micrometer"));
        assert_eq!(of(&[(3, 0), (4, 100)]), uncalibrated);
        assert_eq!(of(&[(4, 2000)]), uncalibrated);
        assert_eq!(of(&[]), uncalibrated);
    }

    #[test]
    fn damage_is_told_or_means_nothing() {
        let bytes = stack(&[(1, 5), (1, 6)], &[(4, 100), (5, 108)]);
        for cut in 0..bytes.len() {
            let Some(d) = described(&bytes[..cut]) else { continue };
            assert!(d.problem.is_some_and(|p| p.contains("cut short")), "{cut}");
        }
        for i in 0..26 {
            let mut damaged = bytes.clone();
            damaged[i] = 0xff;
            described(&damaged);
        }
        let mut none = bytes.clone();
        none[18..22].copy_from_slice(&0u32.to_le_bytes());
        assert!(described(&none).unwrap().problem.is_some());
    }
}
