//! Files of an OME set: named in XML, with pages beside it. A name must lead to a regular file in the folder of the given file, or below;
//! its UUID must be the XML's, where both have one.

use super::description::{Description, Ome, OmeSays};
use super::ome::{self, Part};
use super::page::OpenTiff;
use super::told::LONGEST_DESCRIPTION;
use super::xml::Failure;
use crate::error::{ImportError, Result};
use crate::files::{first_bytes, folder_of, name_of};
use std::collections::HashMap;
use std::fs::File;
use std::io::{BufReader, Read};
use std::path::{Component, Path, PathBuf};

/// Whether a file is bare OME-XML, by its name and its start.
pub(crate) fn is_companion(path: &Path) -> Result<bool> {
    let name = name_of(path).to_ascii_lowercase();
    if ![".ome", ".ome.xml"].iter().any(|end| name.ends_with(end)) {
        return Ok(false);
    }
    let start = first_bytes(path, 64)?;
    let start = start.strip_prefix(b"\xef\xbb\xbf").unwrap_or(&start);
    Ok(start.trim_ascii_start().starts_with(b"<"))
}

/// Reads a separate OME-XML file.
///
/// # Errors
/// If it is something else, or cannot be followed; if the disk cannot read it.
pub(super) fn read_companion(path: &Path) -> Result<Description> {
    let file = File::open(path).map_err(ImportError::io(path))?;
    let bytes = file.metadata().map_err(ImportError::io(path))?.len();
    if bytes > LONGEST_DESCRIPTION {
        let feature = format!("OME-XML of {bytes} bytes, more than {LONGEST_DESCRIPTION},");
        return Err(ImportError::unsupported(path, feature));
    }
    match ome::read(BufReader::new(file.take(LONGEST_DESCRIPTION))) {
        Ok(Some(description)) => Ok(description),
        Ok(None) => Err(ImportError::invalid(path, "is named as a companion of OME-TIFF files, but is not OME-XML")),
        Err(Failure::Disk(error)) => Err(ImportError::io(path)(error)),
        Err(Failure::Meaning(problem)) => Err(ImportError::invalid(path, format!("its OME-XML {problem}"))),
    }
}

/// Finds the file with another file's metadata, and reads them.
///
/// # Errors
/// If the name leads out of the folder, or to no file, or to one of another UUID.
pub(super) fn follow(path: &Path, metadata_file: &str, uuid: Option<&str>) -> Result<(PathBuf, Description)> {
    let what = "is BinaryOnly: its pages are described in";
    let other = beside(path, metadata_file, what)?;
    let description = match first_bytes(&other, 4)?.as_slice() {
        b"II*\0" | b"MM\0*" | b"II+\0" | b"MM\0+" => {
            let mut tiff = OpenTiff::open(&other)?;
            let format = tiff.format()?;
            tiff.description(&format)?
        }
        _ => read_companion(&other)?,
    };
    match &description.ome {
        Some(Ome { uuid: found, says: OmeSays::Pixels(_) }) => check_uuid(path, &other, uuid, found.as_deref())?,
        Some(Ome { says: OmeSays::Elsewhere { .. }, .. }) => {
            return Err(ImportError::invalid(&other, format!("is BinaryOnly, too, as {} is", path.display())));
        }
        None if description.problem.is_some() => {}
        None => {
            let problem =
                format!("{what} {metadata_file}, which has no OME-XML; pass `axes` zyx to take its pages as they are");
            return Err(ImportError::invalid(path, problem));
        }
    }
    Ok((other, description))
}

pub(super) struct Set {
    /// The first has the XML, if it has pages.
    pub(super) paths: Vec<PathBuf>,
    /// The file of each part.
    pub(super) of_part: Vec<u32>,
    /// The UUID of each file, by the XML.
    pub(super) uuids: Vec<Option<String>>,
}

impl Set {
    /// Finds the files of the parts beside `path`, whose UUID is `uuid`, and which holds pages itself if `has_pages`.
    ///
    /// # Errors
    /// If a name leads out of the folder, or to no file: the message gives it.
    pub(super) fn find(path: &Path, uuid: Option<&str>, has_pages: bool, parts: &[Part]) -> Result<Self> {
        let mut set = Self { paths: Vec::new(), of_part: Vec::with_capacity(parts.len()), uuids: Vec::new() };
        let mut known: HashMap<PathBuf, u32> = HashMap::new();
        if has_pages {
            set.paths.push(path.to_owned());
            set.uuids.push(uuid.map(str::to_owned));
            known.insert(path.to_owned(), 0);
        }
        for part in parts {
            let is_own = has_pages && uuid.is_some_and(|own| same_uuid(own, &part.uuid));
            let found = match &part.name {
                _ if is_own => path.to_owned(),
                Some(name) => beside(path, name, "its OME-XML places pages in")?,
                None => {
                    let problem = format!("its OME-XML places pages in a file of UUID '{}' without a name", part.uuid);
                    return Err(ImportError::invalid(path, problem));
                }
            };
            let next = set.paths.len() as u32;
            let file = *known.entry(found.clone()).or_insert_with(|| {
                set.paths.push(found);
                set.uuids.push(None);
                next
            });
            let said = &mut set.uuids[file as usize];
            if !part.uuid.is_empty() {
                let expected = said.get_or_insert_with(|| part.uuid.clone());
                if !same_uuid(expected, &part.uuid) {
                    let (naming, uuid) = (path.display(), &part.uuid);
                    let problem = format!(
                        "has two UUIDs in the OME-XML of {naming}, '{expected}' and '{uuid}'; write the set again"
                    );
                    return Err(ImportError::invalid(&set.paths[file as usize], problem));
                }
            }
            set.of_part.push(file);
        }
        Ok(set)
    }
}

/// Checks a file's UUID against the one another file expects, where both have one.
pub(super) fn check_uuid(naming: &Path, path: &Path, expected: Option<&str>, found: Option<&str>) -> Result<()> {
    match expected.zip(found) {
        Some((expected, found)) if !same_uuid(expected, found) => {
            let problem = format!(
                "is not the file named by {}: its UUID is '{found}', expected '{expected}'; put the files of one set \
                 together",
                naming.display()
            );
            Err(ImportError::invalid(path, problem))
        }
        _ => Ok(()),
    }
}

fn same_uuid(a: &str, b: &str) -> bool {
    let plain = |uuid: &str| {
        let uuid = uuid.trim().to_ascii_lowercase();
        uuid.strip_prefix("urn:uuid:").map(str::to_owned).unwrap_or(uuid)
    };
    plain(a) == plain(b)
}

/// Finds the regular file of this name in the folder of `path`, or below it. `what` describes the name in messages.
fn beside(path: &Path, name: &str, what: &str) -> Result<PathBuf> {
    let folder = folder_of(path);
    let outside = || {
        let problem = format!(
            "{what} '{name}', which is not in its folder or below; pass `axes` zyx to take its own pages as they are"
        );
        ImportError::invalid(path, problem)
    };
    let is_inside = !name.is_empty() && Path::new(name).components().all(|part| matches!(part, Component::Normal(_)));
    if !is_inside || name.contains('\0') {
        return Err(outside());
    }
    let found = path.with_file_name(name);
    let missing = |why: String| {
        let problem = format!(
            "{what} '{name}', which is missing ({why}): put it into the folder of this file, or pass `axes` zyx to take the \
             pages of this file as they are"
        );
        ImportError::invalid(path, problem)
    };
    let real = found.canonicalize().map_err(|error| missing(error.to_string()))?;
    if !real.starts_with(folder.canonicalize().map_err(ImportError::io(folder))?) {
        return Err(outside());
    }
    if !real.is_file() {
        return Err(missing("it is not a file".into()));
    }
    Ok(found)
}
