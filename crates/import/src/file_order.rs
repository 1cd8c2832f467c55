//! The order of several files: as given, or by the numbers in their names.
//!
//! A list keeps its order, unless it is in alphabetical but not in natural order: so shells expand a pattern (`s1`, `s10`,
//! `s2`). Files that somebody else put in order (a folder's, a pattern's) are taken by the numbers in their names, which must then count
//! them (`numbering.rs`). With `--order` the caller answers for it.

use crate::error::ImportError;
use crate::numbering;
use crate::options::FileOrder;
use std::cmp::Ordering;
use std::path::{Path, PathBuf};

/// Files in the order in which they are read.
pub(crate) struct FileList {
    pub(crate) paths: Vec<PathBuf>,
    /// A sentence for the user that says which order this is.
    pub(crate) note: String,
}

impl FileList {
    /// Sorts the files of a folder, or of a pattern, by the numbers in their names. `told` is the order that the caller asks for.
    /// `are_planes` says that each file is one plane, so that an error message may suggest `axes`.
    ///
    /// # Errors
    /// If `told` is [`FileOrder::Given`], since files of a folder have no given order; or if it is `None` and the
    /// numbers in the names do not count the files without gaps.
    pub(crate) fn of_folder(
        folder: &Path,
        paths: &[PathBuf],
        told: Option<FileOrder>,
        are_planes: bool,
    ) -> Result<Self, ImportError> {
        if told == Some(FileOrder::Given) {
            let problem = "`order` given: the files of a folder or a pattern are in no given order; name the files";
            return Err(ImportError::options(folder, problem));
        }
        let list = Self::by_numbers(paths);
        list.check(told, are_planes)?;
        Ok(list)
    }

    /// Puts at least two files that the caller has named in order. `told` is the order that the caller asks for. If it
    /// is `None`, files whose order is neither alphabetical nor natural keep it, and others are sorted by the numbers
    /// in their names. `are_planes` says that each file is one plane, so that an error message may suggest `axes`.
    ///
    /// # Errors
    /// If `told` is `None`, files are sorted by the numbers in their names, and these do not count the files without
    /// gaps.
    pub(crate) fn of_list(paths: &[PathBuf], told: Option<FileOrder>, are_planes: bool) -> Result<Self, ImportError> {
        let list = Self::by_numbers(paths);
        let is_natural = list.paths == paths;
        let is_alphabetical = paths.is_sorted() || paths.is_sorted_by_key(|path| path.to_string_lossy().to_lowercase());
        let (first, last) = (name(&paths[0]), name(&paths[paths.len() - 1]));
        let given = || Self {
            paths: paths.to_vec(),
            note: format!("{} files in the order given, from {first} to {last}.", paths.len()),
        };
        let list = match told {
            Some(FileOrder::Given) => return Ok(given()),
            None if !is_natural && !is_alphabetical => return Ok(given()),
            None if !is_natural => Self {
                note: format!(
                    "{} The files were given in alphabetical order, as shells expand a pattern; `order` given keeps that.",
                    list.note
                ),
                ..list
            },
            _ => list,
        };
        list.check(told, are_planes)?;
        Ok(list)
    }

    fn by_numbers(paths: &[PathBuf]) -> Self {
        let paths = in_natural_order(paths);
        let ends = [paths.first(), paths.last()].map(|path| path.map_or(String::new(), |path| name(path)));
        let note = format!("{} files in natural order, from {} to {}.", paths.len(), ends[0], ends[1]);
        Self { paths, note }
    }

    fn check(&self, told: Option<FileOrder>, are_planes: bool) -> Result<(), ImportError> {
        match told {
            Some(_) => Ok(()),
            None => numbering::check(&self.paths, are_planes).map_err(|p| ImportError::options(&self.paths[0], p)),
        }
    }
}

fn name(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

/// Sorts paths so that numbers within names count as numbers: `s2` before `s10`.
pub(crate) fn in_natural_order(paths: &[PathBuf]) -> Vec<PathBuf> {
    let mut sorted = paths.to_vec();
    sorted.sort_by(|a, b| natural_order(&a.to_string_lossy(), &b.to_string_lossy()).then_with(|| a.cmp(b)));
    sorted
}

fn natural_order(a: &str, b: &str) -> Ordering {
    let (mut a, mut b) = (a.as_bytes(), b.as_bytes());
    loop {
        let (Some(&x), Some(&y)) = (a.first(), b.first()) else { return a.len().cmp(&b.len()) };
        if x.is_ascii_digit() && y.is_ascii_digit() {
            let (m, n) = (leading_number(&mut a), leading_number(&mut b));
            // Without leading zeros the longer number is the greater one, however long.
            match m.len().cmp(&n.len()).then_with(|| m.cmp(n)) {
                Ordering::Equal => continue,
                unequal => return unequal,
            }
        }
        if x != y {
            return x.cmp(&y);
        }
        (a, b) = (&a[1..], &b[1..]);
    }
}

/// Splits the digits off the front; leading zeros are dropped.
fn leading_number<'a>(text: &mut &'a [u8]) -> &'a [u8] {
    let end = text.iter().position(|c| !c.is_ascii_digit()).unwrap_or(text.len());
    let (digits, rest) = text.split_at(end);
    *text = rest;
    let zeros = digits.iter().take_while(|&&c| c == b'0').count();
    &digits[zeros..]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_in_names_count_as_numbers() {
        let sort = |names: &[&str]| {
            let paths: Vec<PathBuf> = names.iter().map(PathBuf::from).collect();
            in_natural_order(&paths).iter().map(|p| p.display().to_string()).collect::<Vec<_>>()
        };
        assert_eq!(sort(&["s10", "s9", "s1", "s010b"]), ["s1", "s9", "s10", "s010b"]);
        assert_eq!(sort(&["a2b10", "a2b9", "a10b1", "a"]), ["a", "a2b9", "a2b10", "a10b1"]);
        assert_eq!(sort(&["t99999999999999999999999", "t100000000000000000000000"])[0], "t99999999999999999999999");
    }

    fn paths(names: &[&str]) -> Vec<PathBuf> {
        names.iter().map(PathBuf::from).collect()
    }

    #[test]
    fn a_list_keeps_its_order_unless_a_shell_made_it() {
        let listed = |names: &[&str], told| {
            let list = FileList::of_list(&paths(names), told, true).unwrap();
            (list.paths.iter().map(|p| p.display().to_string()).collect::<Vec<_>>(), list.note)
        };
        // Neither alphabetical nor by numbers: somebody meant it.
        for given in [&["before.npy", "after.npy"][..], &["s3.npy", "s1.npy", "s2.npy"], &["s2.npy", "s1.npy"]] {
            let (found, note) = listed(given, None);
            assert!(found == given && note.contains("in the order given, from "), "{note}");
        }
        // As a shell expands `s_*.tif`, of letters of either case too.
        for shells in [["s_1.tif", "s_10.tif", "s_2.tif"], ["S_1.tif", "s_10.tif", "S_2.tif"]] {
            let told = Some(FileOrder::Natural);
            let message = FileList::of_list(&paths(&shells), None, true).err();
            assert_eq!(listed(&shells, told).0, [shells[0], shells[2], shells[1]], "{message:?}");
            assert_eq!(listed(&shells, Some(FileOrder::Given)).0, shells);
        }
        let shells = ["s_10.tif", "s_11.tif", "s_8.tif", "s_9.tif"];
        let (found, note) = listed(&shells, None);
        assert_eq!(found, ["s_8.tif", "s_9.tif", "s_10.tif", "s_11.tif"]);
        assert!(note.contains("natural order, from s_8.tif to s_11.tif") && note.contains("`order` given"), "{note}");
        let (found, note) = listed(&["s_9.tif", "s_10.tif", "s_11.tif"], None);
        assert!(found[0] == "s_9.tif" && !note.contains("`order` given"), "{note}");
    }

    #[test]
    fn what_nobody_put_in_order_must_be_counted() {
        let gap = paths(&["s_1.tif", "s_2.tif", "s_4.tif"]);
        let message = FileList::of_list(&gap, None, true).err().unwrap().to_string();
        assert!(message.contains("without 3"), "{message}");
        assert!(FileList::of_folder(Path::new("f"), &gap, None, true).is_err());
        assert_eq!(FileList::of_list(&gap, Some(FileOrder::Given), true).unwrap().paths, gap);
        let shuffled = paths(&["s_4.tif", "s_1.tif", "s_2.tif"]);
        assert_eq!(FileList::of_folder(Path::new("f"), &shuffled, Some(FileOrder::Natural), true).unwrap().paths, gap);
        // Somebody put these in order.
        assert_eq!(FileList::of_list(&shuffled, None, true).unwrap().paths, shuffled);
        let message =
            FileList::of_folder(Path::new("f"), &gap, Some(FileOrder::Given), true).err().unwrap().to_string();
        assert!(message.contains("name the files"), "{message}");
    }
}
