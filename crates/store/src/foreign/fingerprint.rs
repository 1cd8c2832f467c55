//! The state of an array's files: their names, sizes and times. Bricks made from an array are kept for this state alone.
//!
//! Costs a look at each file: some microseconds. Arrays of more than [`MOST_FILES`] have none, and what is made from them is kept in memory alone.

use std::fs;
use std::io;
use std::os::unix::fs::MetadataExt;
use std::path::Path;
use std::time::{Duration, SystemTime, UNIX_EPOCH};
use xxhash_rust::xxh3::xxh3_64;

/// Most files and folders looked at.
const MOST_FILES: usize = 200_000;

/// The state of all files of an array opened at some time; `None` if there are too many, one cannot be looked at, or is newer than the opening: parts
/// of the array may have been read before it was written.
pub(crate) fn of(array: &Path, opened: SystemTime) -> Option<u64> {
    let mut looked_at = 0;
    let mut may_take = |modified: SystemTime| {
        looked_at += 1;
        looked_at <= MOST_FILES && modified <= opened
    };
    of_files(array, Times::OfEntries, &mut may_take).ok().flatten()
}

/// The state of all files of a folder, however many and of any times; a further link to a file leaves it the same.
///
/// # Errors
/// If one cannot be looked at.
pub(crate) fn of_all(folder: &Path) -> io::Result<u64> {
    of_files(folder, Times::OfContents, &mut |_| true).map(Option::unwrap_or_default)
}

/// Times that are part of a state.
#[derive(Clone, Copy, PartialEq)]
enum Times {
    /// Time of the last change of contents, which a copy may bring along.
    OfContents,
    /// Time of the last change of the file's entry, too: no program sets it, and links change it.
    OfEntries,
}

/// The state of a folder's files; `None` if `may_take` refuses the time of a file or folder.
fn of_files(array: &Path, times: Times, may_take: &mut dyn FnMut(SystemTime) -> bool) -> io::Result<Option<u64>> {
    let (mut folders, mut state) = (vec![array.to_path_buf()], 0u64);
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(&folder)? {
            let entry = entry?;
            let file = fs::metadata(entry.path())?;
            if file.is_dir() {
                if !may_take(UNIX_EPOCH) {
                    return Ok(None);
                }
                folders.push(entry.path());
                continue;
            }
            let modified = file.modified()?;
            let entered = match times {
                Times::OfContents => modified,
                Times::OfEntries => {
                    UNIX_EPOCH + Duration::new(file.ctime().max(0) as u64, file.ctime_nsec().max(0) as u32)
                }
            };
            if !may_take(modified.max(entered)) {
                return Ok(None);
            }
            let [modified, entered] =
                [modified, entered].map(|time| time.duration_since(UNIX_EPOCH).map_or(0, |since| since.as_nanos()));
            let path = entry.path();
            let name = path.strip_prefix(array).unwrap_or(&path).as_os_str().as_encoded_bytes();
            let facts = [
                &xxh3_64(name).to_le_bytes()[..],
                &file.len().to_le_bytes(),
                &modified.to_le_bytes(),
                &entered.to_le_bytes(),
            ];
            // A sum: the system lists files in any order.
            state = state.wrapping_add(xxh3_64(&facts.concat()));
        }
    }
    Ok(Some(state))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn any_change_of_a_file_is_another_state() {
        let array = tempfile::tempdir().unwrap();
        let far = SystemTime::now() + std::time::Duration::from_secs(3600);
        let file = array.path().join("c/0/1");
        fs::create_dir_all(file.parent().unwrap()).unwrap();
        fs::write(&file, "one").unwrap();
        fs::write(array.path().join("zarr.json"), "{}").unwrap();
        let first = of(array.path(), far).unwrap();
        assert_eq!(of(array.path(), far), Some(first));
        let later = fs::metadata(&file).unwrap().modified().unwrap() + std::time::Duration::from_secs(1);
        fs::write(&file, "two").unwrap();
        fs::File::options().write(true).open(&file).unwrap().set_modified(later).unwrap();
        let second = of(array.path(), far).unwrap();
        // As copies that keep times do.
        fs::write(&file, "six").unwrap();
        fs::File::options().write(true).open(&file).unwrap().set_modified(later).unwrap();
        let restored = of(array.path(), far).unwrap();
        assert!(restored != first && restored != second);
        fs::rename(&file, file.with_file_name("2")).unwrap();
        let third = of(array.path(), far).unwrap();
        assert!(first != second && second != third);
        assert_eq!(of(array.path(), UNIX_EPOCH), None, "written to since");
        assert_eq!(of(&array.path().join("missing"), far), None);
        assert!(of_all(&array.path().join("missing")).is_err());
        let of_contents = of_all(array.path()).unwrap();
        let beside = tempfile::tempdir().unwrap();
        fs::hard_link(file.with_file_name("2"), beside.path().join("2")).unwrap();
        assert!(of_all(array.path()).unwrap() == of_contents && of(array.path(), far) != Some(third));
    }
}
