//! OME-XML opening: of a file, or the files of its set, with the order of their pages.
//!
//! A set's files are opened one by one, and their directories walked; some of those with many pages stay open.

use super::arrange::of_page;
use super::description::{Description, Ome, OmeSays};
use super::ome::{Pixels, TiffData};
use super::ome_pages::{self, Files};
use super::ome_set::{Set, check_uuid, follow, is_companion, read_companion};
use super::page::{OpenTiff, PageFormat};
use super::walk::{Walked, odd_page, open_pages, refuse_problem};
use super::{MOST_IDLE, Parts, TiffFile, TiffStack};
use crate::error::{ImportError, Result};
use crate::files::name_of;
use crate::note::Note;
use crate::options::OpenOptions;
use crate::page_map::{PageMap, Place};
use crate::raw::identity;
use crate::source::Source;
use brickyard_volume::counted;
use std::collections::HashSet;
use std::path::{Path, PathBuf};
use std::sync::Mutex;

/// Whether files are exactly the OME set that includes the first.
///
/// # Errors
/// If a file of the set is missing, or has another UUID than the set's.
pub(crate) fn is_whole_set(paths: &[PathBuf]) -> Result<bool> {
    let path = &paths[0];
    if is_companion(path)? {
        return Ok(false);
    }
    let mut tiff = OpenTiff::open(path)?;
    let format = tiff.format()?;
    let set = match tiff.description(&format)?.ome {
        Some(Ome { says: OmeSays::Pixels(pixels), uuid }) if pixels.parts.len() > 1 => {
            Set::find(path, uuid.as_deref(), true, &pixels.parts)?
        }
        Some(Ome { says: OmeSays::Elsewhere { metadata_file, uuid }, .. }) => {
            let (companion, described) = follow(path, &metadata_file, uuid.as_deref())?;
            let Some(Ome { says: OmeSays::Pixels(pixels), uuid }) = described.ome else { return Ok(false) };
            Set::find(&companion, uuid.as_deref(), !is_companion(&companion)?, &pixels.parts)?
        }
        _ => return Ok(false),
    };
    let given = paths.iter().map(|path| path.canonicalize()).collect::<Result<HashSet<_>, _>>();
    let of_set = set.paths.iter().map(|path| path.canonicalize()).collect::<Result<HashSet<_>, _>>();
    Ok(set.paths.len() > 1 && given.map_err(ImportError::io(path))? == of_set.map_err(ImportError::io(path))?)
}

/// Opens the files described by an OME-XML file.
pub(super) fn open_companion(path: &Path, options: &OpenOptions, is_alone: bool) -> Result<Box<dyn Source>> {
    if options.axes.is_some() {
        let problem =
            "is the companion of OME-TIFF files, and places their planes itself: leave `axes` out, or name the files";
        return Err(ImportError::options(path, problem));
    }
    let mut description = read_companion(path)?;
    refuse_problem(path, &description)?;
    let Some(Ome { says: OmeSays::Pixels(pixels), .. }) = description.ome.take() else {
        return Err(ImportError::invalid(path, "is a companion of OME-TIFF files, but describes no pixels itself"));
    };
    let set = Set::find(path, None, false, &pixels.parts)?;
    let Some(first) = set.paths.first() else {
        let problem = "is a companion of OME-TIFF files, but names none (TiffData with UUID FileName)";
        return Err(ImportError::invalid(path, problem));
    };
    let mut tiff = OpenTiff::open(first)?;
    let format = tiff.format()?;
    check_uuid(path, first, set.uuids[0].as_deref(), tiff.ome_uuid()?.as_deref())?;
    description.nodata = tiff.description(&format)?.nodata;
    let opening = Opening { path, format, options, is_alone };
    opening.set(Some(tiff), set, &pixels, &description, None)
}

/// A file with OME-XML during its opening.
pub(super) struct Opening<'a> {
    pub(super) path: &'a Path,
    /// Of the first page.
    pub(super) format: PageFormat,
    pub(super) options: &'a OpenOptions,
    /// Whether it is the only input.
    pub(super) is_alone: bool,
}

impl Opening<'_> {
    /// Opens the file by its OME-XML, with the others of its set.
    pub(super) fn ome(self, tiff: OpenTiff, ome: Ome, mut description: Description) -> Result<Box<dyn Source>> {
        let path = self.path;
        match ome.says {
            OmeSays::Pixels(pixels) if pixels.tiff_data.is_empty() => {
                open_pages(tiff, self.format, &description, self.options)
            }
            OmeSays::Pixels(pixels) => {
                let set = Set::find(path, ome.uuid.as_deref(), true, &pixels.parts)?;
                self.set(Some(tiff), set, &pixels, &description, None)
            }
            OmeSays::Elsewhere { metadata_file, uuid } => {
                let (companion, mut described) = follow(path, &metadata_file, uuid.as_deref())?;
                refuse_problem(&companion, &described)?;
                let Some(Ome { says: OmeSays::Pixels(pixels), uuid: theirs }) = described.ome.take() else {
                    return Err(ImportError::invalid(&companion, "describes no pixels"));
                };
                described.nodata = description.nodata.take();
                described.notes.append(&mut description.notes);
                let has_pages = !is_companion(&companion)?;
                let set = Set::find(&companion, theirs.as_deref(), has_pages, &pixels.parts)?;
                let own = set.paths.iter().position(|part| same_file(part, path));
                let Some(own) = own else {
                    let problem = format!("is BinaryOnly, and {} describes no pages in it", companion.display());
                    return Err(ImportError::invalid(path, problem));
                };
                check_uuid(&companion, path, set.uuids[own].as_deref(), ome.uuid.as_deref())?;
                let first = (own == 0).then_some(tiff);
                self.set(first, set, &pixels, &described, Some(&companion))
            }
        }
    }

    /// Opens the files of a set. `first` is the first of them, if open; `companion` holds the XML, if it is none of them.
    fn set(
        self,
        first: Option<OpenTiff>,
        set: Set,
        pixels: &Pixels,
        description: &Description,
        companion: Option<&Path>,
    ) -> Result<Box<dyn Source>> {
        let path = self.path;
        if set.paths.len() > 1 && !self.is_alone {
            let problem = format!(
                "is one of a set of {} in its OME-XML, but other files are given, too: pack it alone, which opens the \
                 set, or pass `axes` zyx to take the pages of each file as they are",
                counted(set.paths.len() as u64, "file")
            );
            return Err(ImportError::invalid(path, problem));
        }
        // A missing page is reported once all are known.
        let first_place = first_place(pixels, &set);
        let known = first_place.and_then(|place| format_at(&set.paths[place.file as usize], place.page).ok());
        let format = known.unwrap_or_else(|| self.format.clone());
        let mut walked = self.walk(first, &set, &format)?;
        let pages: Vec<u32> = walked.files.iter().map(|file| file.pages).collect();
        let names: Vec<String> = set.paths.iter().map(|path| name_of(path)).collect();
        // TiffData without a file mean the file with the XML.
        let with_xml = companion.unwrap_or(path);
        let own = set.paths.iter().position(|part| part == with_xml).map(|i| i as u32);
        let files = Files { pages: &pages, names: &names, of_part: &set.of_part, own };
        let map = pixels
            .declared()
            .page_sizes(&format)
            .and_then(|sizes| ome_pages::map(pixels, of_page(sizes, &format), &files));
        let map = map.map_err(|problem| ImportError::invalid(path, problem))?;
        let spare = pages.iter().map(|&n| n as u64).sum::<u64>() - map.sizes.planes();
        let format = match walked.odd.take() {
            None => format,
            Some(odd) if spare == 0 => return Err(odd),
            Some(_) => check_used(&set.paths, &map)?,
        };
        let WalkedSet { files, idle, reader_bytes, .. } = walked;
        let parts = Parts { files, format, map, reader_bytes, idle: Mutex::new(idle) };
        let mut stack = TiffStack::new(parts, description, self.options)?;
        // A separate XML file may change while the files with pages stay.
        if own.is_none() {
            stack.info.identity += &identity("; described by", &[with_xml])?;
        }
        if set.paths.len() > 1 {
            let note = format!("The planes come from a set of {} files, listed in OME-XML.", set.paths.len());
            stack.info.notes.push(Note::new(note));
        }
        if spare > 0 {
            let warning = format!("{} of no plane in the OME-XML, and left out.", is_or_are(spare));
            stack.info.notes.push(Note::warning(warning));
        }
        Ok(Box::new(stack))
    }

    /// Walks the directories of all files of a set, expecting pages of this format. `first` is the first of them, if open.
    fn walk(&self, mut first: Option<OpenTiff>, set: &Set, format: &PageFormat) -> Result<WalkedSet> {
        let mut all = WalkedSet { files: Vec::with_capacity(set.paths.len()), ..WalkedSet::default() };
        for (number, part) in (0..).zip(&set.paths) {
            let tiff = match first.take() {
                Some(tiff) => tiff,
                None => self.part(part, set.uuids[number as usize].as_deref())?,
            };
            let Walked { file, tiff, reader_bytes, odd, .. } = Walked::of(tiff, format, None)?;
            if file.pages > 1 && all.idle.len() < MOST_IDLE {
                all.idle.push((number, tiff.rest()));
            }
            all.files.push(file);
            all.reader_bytes = all.reader_bytes.max(reader_bytes);
            all.odd = all.odd.or(odd);
        }
        Ok(all)
    }

    /// Opens a file of the set, and checks its identity.
    fn part(&self, part: &Path, uuid: Option<&str>) -> Result<OpenTiff> {
        let mut tiff = OpenTiff::open(part)?;
        check_uuid(self.path, part, uuid, tiff.ome_uuid()?.as_deref())?;
        Ok(tiff)
    }
}

/// Files of a set, with all directories examined.
#[derive(Default)]
struct WalkedSet {
    files: Vec<TiffFile>,
    /// Decoders of some of them.
    idle: Vec<(u32, OpenTiff)>,
    reader_bytes: u64,
    /// The problem of the first page that differs from the others, or lacks its data.
    odd: Option<ImportError>,
}

fn is_or_are(pages: u64) -> String {
    if pages == 1 { "1 page is".into() } else { format!("{pages} pages are") }
}

fn same_file(a: &Path, b: &Path) -> bool {
    a == b || a.canonicalize().ok().zip(b.canonicalize().ok()).is_some_and(|(a, b)| a == b)
}

/// The first page used as a plane, unless it is the first file's first; `None` also while unknown.
fn first_place(pixels: &Pixels, set: &Set) -> Option<Place> {
    let place = |data: &TiffData| Place {
        file: data.part.map_or(0, |part| set.of_part[part as usize]),
        page: data.ifd.unwrap_or(0),
    };
    pixels.tiff_data.iter().map(place).min().filter(|place| *place != Place { file: 0, page: 0 })
}

fn format_at(path: &Path, page: u32) -> Result<PageFormat> {
    let mut tiff = OpenTiff::open(path)?;
    tiff.seek(page)?;
    tiff.format()
}

/// Checks only pages used as planes, in a file with others: pictures of labels, overviews. Returns their format.
fn check_used(paths: &[PathBuf], map: &PageMap) -> Result<PageFormat> {
    let mut expected: Option<PageFormat> = None;
    let mut open: Option<(u32, OpenTiff)> = None;
    for place in map.by_file() {
        let path = &paths[place.file as usize];
        let tiff = match &mut open {
            Some((file, tiff)) if *file == place.file => tiff,
            other => &mut other.insert((place.file, OpenTiff::open(path)?)).1,
        };
        tiff.seek(place.page)?;
        let format = tiff.format()?;
        tiff.check_data(place.page + 1)?;
        match &expected {
            Some(expected) if *expected != format => return Err(odd_page(path, place.page + 1, &format, expected)),
            Some(_) => {}
            None => expected = Some(format),
        }
    }
    expected.ok_or_else(|| ImportError::invalid(&paths[0], "holds no planes"))
}
