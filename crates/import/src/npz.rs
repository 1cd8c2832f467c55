//! NumPy's `.npz`: a zip archive of `.npy` files. The only array is read, or the one named by `variable`.
//!
//! A stored array is read in place through [`RawSource`]; a compressed one is inflated into scratch space first (see `body`).

mod member;
#[cfg(test)]
mod tests;

use crate::body::Body;
use crate::error::{ImportError, Result};
use crate::files::name_of;
use crate::mapped::MappedFile;
use crate::npy;
use crate::options::OpenOptions;
use crate::raw::{RawSource, identity};
use crate::source::SourceInfo;
use crate::stamp::Stamp;
use member::Member;
use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};
use zip::ZipArchive;

const MAGIC: &[u8] = b"PK\x03\x04";

/// Most arrays listed in a message.
const MOST_LISTED: usize = 20;

type Archive = ZipArchive<BufReader<File>>;

/// Opens the array of an archive.
pub(crate) fn open(path: &Path, options: &OpenOptions) -> Result<RawSource> {
    let stamp = Stamp::of(path)?;
    let mut archive = archive_of(path)?;
    let member = chosen(path, &mut archive, options)?;
    // Messages name the array, too.
    let place = PathBuf::from(format!("{}/{}", path.display(), member.name));
    let mut array = npy::layout(&mut member.reader(path)?, &place, options)?;
    let end = array.end_bytes().map_err(|problem| ImportError::invalid(&place, problem))?;
    if member.bytes < end {
        let (found, missing) = (member.bytes, end - member.bytes);
        let problem = format!("cut short: expected {end} bytes of header and array, found {found} ({missing} missing)");
        return Err(ImportError::invalid(&place, problem));
    }
    let info =
        SourceInfo { identity: identity(&format!("npz {} {}", member.name, array.axes), &[path])?, ..array.info() };
    let source = if let Some(start) = member.stored_at() {
        array.offset = array.offset.saturating_add(start);
        RawSource::new(MappedFile::open(path)?, array, info)?.with_losses(None, options)?
    } else {
        Body::Coded { path: place, coded_bytes: member.stored_bytes, stream: member.reader(path)? }
            .source(array, info, options)?
    };
    stamp.check(path)?;
    Ok(source)
}

/// Whether a file with this start is a zip archive of this format: by its name (in lower case), or its files' names.
pub(crate) fn is_npz(path: &Path, name: &str, start: &[u8]) -> Result<bool> {
    Ok(start.starts_with(MAGIC)
        && (name.ends_with(".npz") || archive_of(path).is_ok_and(|archive| !arrays_of(&archive).is_empty())))
}

fn archive_of(path: &Path) -> Result<Archive> {
    let file = File::open(path).map_err(ImportError::io(path))?;
    ZipArchive::new(BufReader::new(file)).map_err(|error| {
        ImportError::invalid(path, format!("not a whole zip archive, or a damaged one: {error}; fetch the file again"))
    })
}

/// Numbers and names of an archive's arrays.
fn arrays_of(archive: &Archive) -> Vec<(usize, String)> {
    let names = archive.file_names_raw().map(|name| String::from_utf8_lossy(name).into_owned());
    names.enumerate().filter(|(_, name)| name.to_ascii_lowercase().ends_with(".npy")).collect()
}

/// The array named by the options, or the only one.
fn chosen(path: &Path, archive: &mut Archive, options: &OpenOptions) -> Result<Member> {
    let arrays = arrays_of(archive);
    if arrays.is_empty() {
        return Err(ImportError::invalid(path, "a zip archive without .npy files; save an array with numpy.savez"));
    }
    let named = |variable: &str| arrays.iter().find(|(_, name)| bare(name) == variable || name == variable);
    let found = match (&options.variable, &arrays[..]) {
        (Some(variable), _) => named(variable),
        (None, [only]) => Some(only),
        (None, _) => None,
    };
    if let Some((number, _)) = found {
        return Member::of(path, archive, *number);
    }
    let shown: Vec<String> =
        arrays.iter().take(MOST_LISTED).map(|(number, name)| described(path, archive, *number, name)).collect();
    let more = arrays.len().saturating_sub(MOST_LISTED);
    let more = if more > 0 { format!(" and {more} more") } else { String::new() };
    let list = format!("{}{more}", shown.join(", "));
    let problem = match &options.variable {
        Some(variable) => format!("holds no array '{variable}' but {list}: name one of these with `variable`"),
        None => format!("holds {} arrays, {list}: choose one with `variable`", arrays.len()),
    };
    Err(ImportError::options(path, problem))
}

/// An array's name as NumPy tells it.
fn bare(name: &str) -> &str {
    let at = name.len().saturating_sub(".npy".len());
    name.get(..at).filter(|_| name.to_ascii_lowercase().ends_with(".npy")).unwrap_or(name)
}

/// Name, shape and type of an array, as far as they can be read.
fn described(path: &Path, archive: &mut Archive, number: usize, name: &str) -> String {
    let summary = Member::of(path, archive, number)
        .and_then(|member| npy::summary(&mut member.reader(path)?, Path::new(&name_of(path))));
    let name: String = bare(name).chars().filter(|c| !c.is_control()).collect();
    match summary {
        Ok(summary) => format!("{name} {summary}"),
        Err(ImportError::Unsupported { feature, .. }) => format!("{name} ({feature})"),
        Err(_) => format!("{name} (unreadable)"),
    }
}
