//! The bytes of an array behind a header: mapped where they lie as they are, otherwise decoded, streaming, into an
//! unnamed scratch file of their decoded size, which is then mapped. Costs nothing, or one pass over the coded bytes and
//! as much scratch space as decoded ones.

use crate::axes::Sizes;
use crate::error::{ImportError, Result};
use crate::gzip::GzipMembers;
use crate::mapped::MappedFile;
use crate::note::Note;
use crate::options::OpenOptions;
use crate::raw::{ArrayLayout, RawSource};
use crate::source::SourceInfo;
use crate::temporary::unnamed_in;
use brickyard_volume::{are, counted};
use std::fs::File;
use std::io::{BufRead, BufReader, BufWriter, Read, Write};
use std::path::{Path, PathBuf};

/// Most decoded bytes of a coded one: deflate's best, of which no other coding comes near.
const MOST_RATIO: u64 = 1032;

/// An array's bytes, as they are or coded. `path` is the file named in messages.
pub(crate) enum Body {
    /// A file's own bytes.
    Plain { path: PathBuf },
    /// Bytes from a decoder of at most so many.
    Coded { path: PathBuf, coded_bytes: u64, stream: Box<dyn Read> },
    /// Bytes of several files.
    Joined { path: PathBuf, files: u64, stream: Box<dyn Read> },
}

/// A mapped array, and the bytes after it.
struct MappedBody {
    file: MappedFile,
    trailing_bytes: u64,
}

impl Body {
    /// Opens a file, to be inflated if it starts like gzip.
    pub(crate) fn open(path: &Path) -> Result<Self> {
        let file = File::open(path).map_err(ImportError::io(path))?;
        let coded_bytes = file.metadata().map_err(ImportError::io(path))?.len();
        let mut file = BufReader::with_capacity(1 << 18, file);
        let start = file.fill_buf().map_err(ImportError::io(path))?;
        let path = path.to_owned();
        Ok(match start.starts_with(&[0x1f, 0x8b]) {
            true => Self::Coded { path, coded_bytes, stream: Box::new(GzipMembers::new(file)) },
            false => Self::Plain { path },
        })
    }

    pub(crate) fn is_coded(&self) -> bool {
        matches!(self, Self::Coded { .. })
    }

    /// The decoded bytes, in sequence.
    pub(crate) fn reader(self) -> Result<Box<dyn Read>> {
        match self {
            Self::Plain { path } => Ok(Box::new(BufReader::new(File::open(&path).map_err(ImportError::io(&path))?))),
            Self::Coded { stream, .. } | Self::Joined { stream, .. } => Ok(stream),
        }
    }

    /// Opens the array of a header, decoded if need be, with notes about decoding and trailing bytes. `info` describes
    /// it; its no-data value counts as the file's.
    ///
    /// # Errors
    /// If there are fewer bytes, they are damaged, a value is lost without leave, or there is no scratch space.
    pub(crate) fn source(self, array: ArrayLayout, mut info: SourceInfo, options: &OpenOptions) -> Result<RawSource> {
        let joined = if let Self::Joined { files, .. } = self { Some(files) } else { None };
        let is_coded = self.is_coded();
        let MappedBody { file, trailing_bytes } = self.map(&array, options)?;
        if is_coded {
            info.notes.push(unpacked_note(end_bytes(&array, &file.path)?));
        }
        if let Some(files) = joined {
            let bytes = human_bytes(end_bytes(&array, &file.path)?);
            info.notes.push(Note::new(format!("{files} data files are joined in {bytes} of scratch space first.")));
        }
        info.notes.extend(trailing_note(trailing_bytes));
        let nodata = info.nodata;
        RawSource::new(file, array, info)?.with_losses(nodata, options)
    }

    /// Maps an array with this layout, decoded if need be.
    fn map(self, array: &ArrayLayout, options: &OpenOptions) -> Result<MappedBody> {
        match self {
            Self::Plain { path } => {
                let expected = end_bytes(array, &path)?;
                let file = MappedFile::open(&path)?;
                let length = file.len() as u64;
                if length < expected {
                    return Err(ImportError::invalid(&path, cut_short(array, expected, length)));
                }
                Ok(MappedBody { file, trailing_bytes: length - expected })
            }
            Self::Coded { path, coded_bytes, stream } => {
                check_ratio(coded_bytes, &path, array)?;
                decode(stream, &path, array, options)
            }
            Self::Joined { path, stream, .. } => decode(stream, &path, array, options),
        }
    }
}

/// A note about an array to be decoded into `bytes` of scratch space.
pub(crate) fn unpacked_note(bytes: u64) -> Note {
    let bytes = human_bytes(bytes);
    Note::new(format!("The voxels are compressed or text: they are unpacked into {bytes} of scratch space first."))
}

/// A warning about bytes after the voxels, if there are any.
fn trailing_note(bytes: u64) -> Option<Note> {
    (bytes > 0).then(|| Note::warning(format!("{} after the voxels {} ignored.", counted(bytes, "byte"), are(bytes))))
}

fn end_bytes(array: &ArrayLayout, path: &Path) -> Result<u64> {
    array.end_bytes().map_err(|problem| ImportError::invalid(path, problem))
}

/// Refuses sizes that no coding reaches, before scratch space is sought for them.
fn check_ratio(coded_bytes: u64, path: &Path, array: &ArrayLayout) -> Result<()> {
    let (expected, most) = (end_bytes(array, path)?, coded_bytes.saturating_mul(MOST_RATIO));
    if expected > most {
        let problem = format!(
            "damaged: {coded_bytes} compressed bytes cannot hold the {expected} of its header; fetch the file again"
        );
        return Err(ImportError::invalid(path, problem));
    }
    Ok(())
}

/// Decodes or joins an array into a scratch file and counts the bytes after it, thus verifying the stream's final checksum.
fn decode(mut stream: Box<dyn Read>, path: &Path, array: &ArrayLayout, options: &OpenOptions) -> Result<MappedBody> {
    let expected = end_bytes(array, path)?;
    let directory = options.scratch_dir.clone().unwrap_or_else(std::env::temp_dir);
    check_space(&directory, expected)?;
    let scratch = unnamed_in(&directory).map_err(ImportError::scratch(&directory))?;
    let mut scratch = BufWriter::with_capacity(1 << 20, scratch);
    let mut buffer = vec![0; 1 << 18];
    let (mut written, mut trailing) = (0, 0);
    loop {
        let n = match stream.read(&mut buffer) {
            Ok(0) => break,
            Ok(n) => n as u64,
            Err(error) if error.kind() == std::io::ErrorKind::Interrupted => continue,
            Err(error) => {
                let problem = format!(
                    "compressed data cut short or damaged: expected {expected} bytes inflated, got {written} before: {error}; fetch the file again"
                );
                return Err(ImportError::invalid(path, problem));
            }
        };
        let wanted = n.min(expected - written);
        scratch.write_all(&buffer[..wanted as usize]).map_err(ImportError::scratch(&directory))?;
        written += wanted;
        trailing += n - wanted;
    }
    if written < expected {
        return Err(ImportError::invalid(path, cut_short(array, expected, written)));
    }
    let scratch = scratch.into_inner().map_err(|e| ImportError::scratch(&directory)(e.into_error()))?;
    Ok(MappedBody { file: MappedFile::of_scratch(path, &scratch)?, trailing_bytes: trailing })
}

/// Refuses in advance to fill the disk.
#[cfg(unix)]
pub(crate) fn check_space(directory: &Path, needed: u64) -> Result<()> {
    let stat = rustix::fs::statvfs(directory).map_err(|e| ImportError::scratch(directory)(e.into()))?;
    let free = stat.f_bavail.saturating_mul(stat.f_frsize);
    if free < needed {
        let [needed, free] = [needed, free].map(human_bytes);
        let problem = format!(
            "{needed} of scratch space needed for the input, {free} free; choose another place with `scratch_dir`"
        );
        return Err(ImportError::options(directory, problem));
    }
    Ok(())
}

#[cfg(not(unix))]
pub(crate) fn check_space(_directory: &Path, _needed: u64) -> Result<()> {
    Ok(())
}

fn cut_short(array: &ArrayLayout, expected: u64, found: u64) -> String {
    let Sizes { extent, channels, times } = array.sizes;
    let (name, offset, missing) = (array.decode.element.name(), array.offset, expected - found);
    let [bytes, channels, times] = [(expected, "byte"), (channels.into(), "channel"), (times.into(), "time step")]
        .map(|(n, noun)| counted(n, noun));
    format!(
        "cut short: the header implies {bytes} ({extent} {name}, {channels}, {times}, from byte {offset}), found {found} \
         ({missing} missing)"
    )
}

/// Formats bytes in the largest unit that leaves a number of at least 1.
fn human_bytes(bytes: u64) -> String {
    let units = [(1u64 << 30, "GiB"), (1 << 20, "MiB"), (1 << 10, "KiB")];
    match units.into_iter().find(|(size, _)| bytes >= *size) {
        Some((size, unit)) => format!("{:.1} {unit}", bytes as f64 / size as f64),
        None => counted(bytes, "byte"),
    }
}
