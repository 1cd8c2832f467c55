//! DICOM files: one slice per file, or enhanced files with a place for every frame. Opening reads all headers, and chooses the files of one series.

mod attributes;
mod choice;
mod decode;
mod decode_bits;
mod dose;
#[cfg(test)]
mod dose_tests;
mod elements;
mod floats;
#[cfg(test)]
mod floats_tests;
mod fragments;
mod frames;
#[cfg(test)]
mod gap_tests;
mod header;
mod jpeg_lossless;
#[cfg(test)]
mod jpeg_lossless_tests;
#[cfg(test)]
mod lossy_tests;
mod maps;
mod mosaic;
#[cfg(test)]
mod mosaic_tests;
mod notes;
mod nuclear;
#[cfg(test)]
mod nuclear_tests;
mod pixels;
mod segmentation;
#[cfg(test)]
mod segmentation_tests;
mod series;
mod stack;
#[cfg(test)]
mod tests;
mod unit;
#[cfg(test)]
mod unknown_tests;
mod volumes;
#[cfg(test)]
mod volumes_tests;
mod voxels;
mod wanted;

use crate::batches::{self, MOST_THREADS};
use crate::dicom_files::files_in;
use crate::error::{ImportError, Result};
use crate::files::{first_bytes, folder_of};
use crate::note::Note;
use crate::options::OpenOptions;
use crate::source::Source;
use brickyard_volume::counted;
use choice::{Chosen, choose};
use dicom_dictionary_std::{tags, uids};
use header::Header;
use segmentation::{Segmentation, is_segmentation};
use series::DicomSeries;
use std::path::{Path, PathBuf};

/// Most bytes of a damaged file searched for the UID of its series.
const MOST_SEARCHED_BYTES: usize = 1 << 20;

/// Opens a DICOM file. A single slice is joined by the rest of its series in the folder, as in most programs.
pub(crate) fn open_file(path: &Path, options: &OpenOptions) -> Result<Box<dyn Source>> {
    let header = Header::read(path)?;
    check_is_image(&header)?;
    let folder = folder_of(path);
    if stands_alone(&header) {
        let notes = if options.is_step { Vec::new() } else { others_of_series(&header, folder) };
        return open_chosen(vec![header], false, options, notes);
    }
    let mut series = Vec::new();
    let mut unread = Vec::new();
    let mut others = files_in(folder)?;
    others.retain(|other| other.file_name() != path.file_name());
    batches::each(
        &others,
        MOST_THREADS,
        |path| Header::read(path),
        |path, other| {
            match other {
                Ok(mut other) if is_image(&other) && other.series() == header.series() => {
                    other.share_values(&header);
                    series.push(other);
                }
                Ok(_) => {}
                Err(error) if is_of_the_file(&error) && !may_be_of(path, &header)? => unread.push(error),
                Err(error) => return Err(error),
            }
            Ok(())
        },
    )?;
    series.push(header);
    let mut notes = vec![Note::new(format!("{} files of the series are read from its folder.", series.len()))];
    if let Some(first) = unread.first() {
        let files = counted(unread.len() as u64, "DICOM file");
        let do_not = if unread.len() == 1 { "does not" } else { "do not" };
        let warning = format!("{files} beside it cannot be read and {do_not} name a series: left out. {first}");
        notes.push(Note::warning(warning));
    }
    open_chosen(series, true, options, notes)
}

/// Opens the files of one series among these, chosen by the options' `variable`. Localizers are left out of a whole folder or series
/// (`is_folder`).
fn open_chosen(
    headers: Vec<Header>,
    is_folder: bool,
    options: &OpenOptions,
    mut notes: Vec<Note>,
) -> Result<Box<dyn Source>> {
    let Chosen { mut headers, part, notes: others } = choose(headers, is_folder, options.variable.as_deref())?;
    notes.extend(others);
    let count = headers.len();
    let Some(at) = headers.iter().position(is_segmentation) else {
        return Ok(Box::new(DicomSeries::new(headers, part.as_deref(), options, notes)?));
    };
    if count > 1 {
        let (path, files) = (&headers[at].path, counted(count as u64, "file"));
        let problem = format!("is a segmentation in a series of {files}: each is a volume of its own; name one file");
        return Err(ImportError::options(path, problem));
    }
    Ok(Box::new(Segmentation::open(headers.swap_remove(at), part.as_deref(), options, notes)?))
}

/// Notes the other files of a multi-frame file's series in the same folder, if any can be read.
fn others_of_series(header: &Header, folder: &Path) -> Vec<Note> {
    let is_other = |path: &&PathBuf| path.file_name() != header.path.file_name();
    let is_of_it = |path: &&PathBuf| Header::read(path).is_ok_and(|it| is_image(&it) && it.series() == header.series());
    // Unreadable neighbours do not matter.
    let beside = files_in(folder).unwrap_or_default();
    let others = beside.iter().filter(is_other).filter(is_of_it).count() as u64;
    let files = counted(others, "file");
    let note = format!(
        "{files} more of its series in the folder, left out: name the files, or the folder, to read all frames."
    );
    if others > 0 { vec![Note::warning(note)] } else { Vec::new() }
}

fn is_of_the_file(error: &ImportError) -> bool {
    matches!(error, ImportError::Invalid { .. } | ImportError::Unsupported { .. })
}

/// Whether a file with an unreadable header may be of the same series: its first bytes contain the series' UID or are deflated, or there is no
/// UID.
fn may_be_of(path: &Path, header: &Header) -> Result<bool> {
    let Some(series) = header.text(tags::SERIES_INSTANCE_UID) else { return Ok(true) };
    let start = first_bytes(path, MOST_SEARCHED_BYTES)?;
    // A longer UID starting with this one differs.
    let goes_on = |byte: Option<&u8>| byte.is_some_and(|byte| byte.is_ascii_digit() || *byte == b'.');
    let has = |uid: &str| {
        let mut places = start.windows(uid.len()).enumerate().filter(|(_, bytes)| *bytes == uid.as_bytes());
        places.any(|(at, _)| !goes_on(start.get(at + uid.len())))
    };
    Ok(series.is_empty() || has(&series) || has(uids::DEFLATED_EXPLICIT_VR_LITTLE_ENDIAN))
}

/// Returns the series represented by a file, with the other slices in its folder; `None` for a file of several frames.
pub(crate) fn series_of(path: &Path) -> Result<Option<String>> {
    let header = Header::read(path)?;
    Ok((!stands_alone(&header)).then(|| header.series()))
}

/// Whether a file holds more than one slice of its series.
fn stands_alone(header: &Header) -> bool {
    header.number(tags::NUMBER_OF_FRAMES).is_some_and(|n| n > 1.0) || header.is_mosaic() || is_segmentation(header)
}

/// Opens DICOM files of one series. Files without an image are skipped in a folder (`is_folder`), and an error in a list.
pub(crate) fn open_series(paths: &[PathBuf], is_folder: bool, options: &OpenOptions) -> Result<Box<dyn Source>> {
    let mut headers: Vec<Header> = Vec::new();
    let mut others = Vec::new();
    batches::each(
        paths,
        MOST_THREADS,
        |path| Header::read(path),
        |path, header| {
            let mut header = header?;
            if is_folder && !is_image(&header) {
                others.push(path.clone());
                return Ok(());
            }
            check_is_image(&header)?;
            headers.last().into_iter().for_each(|last| header.share_values(last));
            headers.push(header);
            Ok(())
        },
    )?;
    let (count, such_as) = (others.len(), others.first().map(|first| first.display()));
    let left_out = such_as.map(|first| {
        let files = counted(count as u64, "DICOM file");
        Note::new(format!("{files} without an image left out, such as {first}."))
    });
    if headers.is_empty() {
        let place = paths.first().and_then(|p| p.parent()).unwrap_or(Path::new("input"));
        let files = counted(paths.len() as u64, "DICOM file");
        let advice = folder_in(place).map_or(String::new(), |inner| {
            format!("; the folders in it, such as {inner}, are not looked into: pass the one of a series")
        });
        return Err(ImportError::invalid(place, format!("{files}, none with an image{advice}")));
    }
    open_chosen(headers, is_folder, options, left_out.into_iter().collect())
}

/// The first name of a folder's folders, such as those to which a DICOMDIR points.
fn folder_in(folder: &Path) -> Option<String> {
    let inner = std::fs::read_dir(folder).ok()?.flatten().filter(|entry| entry.path().is_dir());
    inner.map(|entry| entry.file_name().to_string_lossy().into_owned()).min()
}

fn is_image(header: &Header) -> bool {
    header.number(tags::ROWS).is_some() || header.pixels.is_some()
}

fn check_is_image(header: &Header) -> Result<()> {
    let problem = "a DICOM file without an image, such as a report or a DICOMDIR; pass the folder or the files of an image series";
    is_image(header).then_some(()).ok_or_else(|| ImportError::invalid(&header.path, problem))
}
