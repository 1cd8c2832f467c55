//! The order of several files: as given, or by the numbers in their names.
//!
//! A list keeps its order, unless that is alphabetical but not natural, as from a shell's pattern (`s1`, `s10`, `s2`). The files of a
//! folder or pattern are sorted by the numbers in their names, which must then count them (`numbering.rs`). With `--order` the caller is
//! responsible.
//!
//! A number may have a sign, a fraction or a power of ten (`t_0.25`, `t_0.5`), or two counters may have a point between them (`1.9`,
//! `1.10`). If these readings give different orders, the numbers' form and even counting decide, or the files are refused.

use crate::error::{ImportError, Result};
use crate::file_name::{Name, Number, Reading};
use crate::files::name_of;
use crate::numbering;
use crate::options::FileOrder;
use std::cmp::Ordering;
use std::path::{Path, PathBuf};

/// Files in reading order.
pub(crate) struct FileList {
    pub(crate) paths: Vec<PathBuf>,
    /// A sentence for the user about this order.
    pub(crate) note: String,
}

impl FileList {
    /// Sorts the files of a folder, or of a pattern, by the numbers in their names. `told` is the caller's order. `are_planes` (each file
    /// is one plane) lets an error message suggest `axes`.
    ///
    /// # Errors
    /// If `told` is [`FileOrder::Given`], since files of a folder have none; or if it is `None`, and the numbers do not count the files
    /// without gaps or can be read in two ways.
    pub(crate) fn of_folder(
        folder: &Path,
        paths: &[PathBuf],
        told: Option<FileOrder>,
        are_planes: bool,
    ) -> Result<Self> {
        if told == Some(FileOrder::Given) {
            let problem = "`order` given: a folder or a pattern gives no order; name the files";
            return Err(ImportError::options(folder, problem));
        }
        let list = ByNumbers::of(paths);
        if told.is_none() {
            list.check_words()?;
            list.check(are_planes, "name the files in their order, with `order` given")?;
        }
        Ok(list.into())
    }

    /// Puts at least two files named by the caller in order. `told` is the caller's order. If `None`, an order neither alphabetical nor
    /// natural is kept; other files are sorted by the numbers in their names. `are_planes` (each file is one plane) lets an error message
    /// suggest `axes`.
    ///
    /// # Errors
    /// If files are sorted without `told`, and their numbers do not count them without gaps or can be read in two ways.
    pub(crate) fn of_list(paths: &[PathBuf], told: Option<FileOrder>, are_planes: bool) -> Result<Self> {
        let list = ByNumbers::of(paths);
        let is_natural = list.paths == paths && list.doubt.is_none();
        let is_alphabetical = paths.is_sorted() || paths.is_sorted_by_key(|path| path.to_string_lossy().to_lowercase());
        match told {
            Some(FileOrder::Natural) => return Ok(list.into()),
            None if is_natural || is_alphabetical => {}
            _ => {
                return Ok(Self { paths: paths.to_vec(), note: order_note(paths, "in the order given") });
            }
        }
        if !is_natural {
            list.check_words()?;
        }
        list.check(are_planes, "`order` given to keep the order of the files")?;
        let mut list = Self::from(list);
        if !is_natural {
            list.note += " The files came in alphabetical order, as from a pattern expanded by the shell; `order` \
                          given keeps it.";
        }
        Ok(list)
    }
}

/// Files ordered by the numbers in their names.
struct ByNumbers {
    paths: Vec<PathBuf>,
    reading: Reading,
    /// Two files reversed by the other, equally likely, reading of numbers.
    doubt: Option<[PathBuf; 2]>,
    /// Whether reading numbers as values made a difference.
    is_by_values: bool,
}

impl ByNumbers {
    fn of(paths: &[PathBuf]) -> Self {
        let counters = in_natural_order(paths);
        let plain = Self { paths: counters, reading: Reading::Counters, doubt: None, is_by_values: false };
        let mut names: Vec<(Name, &PathBuf)> =
            paths.iter().map(|path| (Name::of(path, Reading::Values, usize::MAX), path)).collect();
        if names.iter().all(|(name, _)| name.is_plain()) {
            return plain;
        }
        names.sort_by(|(a, first), (b, second)| a.order(b).then_with(|| first.cmp(second)));
        let (names, values): (Vec<Name>, Vec<PathBuf>) =
            names.into_iter().map(|(name, path)| (name, path.clone())).unzip();
        let is_by_values = values != plain.paths;
        match likely(&plain.paths, &values, &names) {
            Some(Reading::Counters) => plain,
            Some(Reading::Values) => Self { paths: values, reading: Reading::Values, doubt: None, is_by_values },
            None => {
                let place = |path: &PathBuf| plain.paths.iter().position(|other| other == path);
                let swapped = values.windows(2).find(|pair| place(&pair[0]) > place(&pair[1]));
                let doubt = swapped.map(|pair| [pair[0].clone(), pair[1].clone()]);
                Self { paths: values, reading: Reading::Values, doubt, is_by_values }
            }
        }
    }

    /// Checks that names without a counter have the same order by the alphabet and by their digits, possibly not decimal (`f_09`, `f_0a`).
    fn check_words(&self) -> Result<()> {
        let alphabetical = |by: fn(&str) -> String| self.paths.is_sorted_by_key(|path| by(&path.to_string_lossy()));
        if !numbering::are_words(&self.paths, self.reading)
            || alphabetical(str::to_owned)
            || alphabetical(str::to_lowercase)
        {
            return Ok(());
        }
        let (first, last) = (name_of(&self.paths[0]), name_of(&self.paths[self.paths.len() - 1]));
        let problem = format!(
            "no number in the files' names counts them, and their order by digits, from {first} to {last}, differs \
             from the alphabetical one: pass `order` natural for the order by digits, or name the files in their \
             order, with `order` given"
        );
        Err(ImportError::options(&self.paths[0], problem))
    }

    /// Checks that the numbers can be read in one way, and count the files. `way_on` is advice on giving an order.
    fn check(&self, are_planes: bool, way_on: &str) -> Result<()> {
        let problem = match &self.doubt {
            Some([before, after]) => Err(format!(
                "the numbers in the files' names can be read in two ways: as decimal numbers, {before} comes before \
                 {after}; as separate whole numbers, after it. Pass `order` natural for decimal numbers, or {way_on}",
                before = name_of(before),
                after = name_of(after)
            )),
            None => numbering::check(&self.paths, self.reading, are_planes),
        };
        problem.map_err(|problem| ImportError::options(&self.paths[0], problem))
    }
}

impl From<ByNumbers> for FileList {
    fn from(list: ByNumbers) -> Self {
        let how = match list.is_by_values {
            true => "in natural order, by decimal numbers in their names",
            false => "in natural order",
        };
        let note = order_note(&list.paths, how);
        Self { paths: list.paths, note }
    }
}

/// The number of files, their order, and the first and the last.
fn order_note(paths: &[PathBuf], order: &str) -> String {
    match paths {
        [] => "No file.".into(),
        [only] => format!("1 file, {}.", name_of(only)),
        [first, .., last] => format!("{} files {order}, from {} to {}.", paths.len(), name_of(first), name_of(last)),
    }
}

/// The likely reading of numbers, given the files' orders by `counters` and by `values`, and the names in the latter; `None` if nothing
/// decides.
fn likely(counters: &[PathBuf], values: &[PathBuf], names: &[Name]) -> Option<Reading> {
    let count = numbering::check(counters, Reading::Counters, false).is_ok();
    let are_even = numbering::check(values, Reading::Values, false).is_ok();
    if counters == values {
        return Some(if count && !are_even { Reading::Counters } else { Reading::Values });
    }
    let varying: Vec<&Number> = match names.iter().all(|name| name.texts == names[0].texts) {
        true => numbering::counters(names).into_iter().flat_map(|(_, numbers)| numbers).collect(),
        false => names.iter().flat_map(|name| &name.numbers).collect(),
    };
    if varying.iter().any(|number| number.written.is_doubtful) {
        return None;
    }
    if varying.iter().any(|number| number.is_minus_zero()) {
        return Some(Reading::Counters);
    }
    let fractions: Vec<&str> = varying.iter().filter_map(|number| number.written.fraction.as_deref()).collect();
    // Digits of one length sort alike in both readings, so signs or powers of ten make the difference.
    let are_alike = fractions.iter().all(|digits| digits.len() == fractions[0].len());
    if are_alike || varying.iter().any(|number| number.written.has_exponent) {
        return Some(Reading::Values);
    }
    // 1.9, 1.10, 1.11.
    if numbering::count_by_one(counters) && !(are_even && values.len() > 2) {
        return Some(Reading::Counters);
    }
    // As most programs print numbers: 0.1 and not 0.10. A counter of several lengths has no leading zero, unlike 0.05.
    let are_printed = fractions.iter().all(|digits| digits.len() == 1 || !digits.ends_with('0'));
    let are_padded = fractions.iter().any(|digits| digits.len() > 1 && digits.starts_with('0'));
    // Two numbers are always even; 0.25 and 0.5 are still fractions.
    let are_told = are_even && (values.len() > 2 || varying.iter().all(|number| number.is_below_one()));
    (are_padded || are_printed && are_told).then_some(Reading::Values)
}

/// Sorts paths with numbers in names as numbers: `s2` before `s10`.
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
            // Without leading zeros the longer number is the greater one, at any length.
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
        // Neither alphabetical nor by numbers: on purpose.
        for given in [&["before.npy", "after.npy"][..], &["s3.npy", "s1.npy", "s2.npy"], &["s2.npy", "s1.npy"]] {
            let (found, note) = listed(given, None);
            assert!(found == given && note.contains("in the order given, from "), "{note}");
        }
        // As a shell expands `s_*.tif`, with letters of either case too.
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

    /// Lists in a shell's order, and the order of their numbers; `None` if ambiguous.
    #[test]
    fn decimal_numbers_are_in_their_order() {
        for (names, expected) in [
            (&["t_0.25", "t_0.5"][..], Some(&[0, 1][..])),
            (&["t0.05", "t0.1", "t0.15"], Some(&[0, 1, 2])),
            (&["r1.25", "r1.5", "r1.75", "r2.0"], Some(&[0, 1, 2, 3])),
            (&["u_0.1", "u_0.15", "u_0.2", "u_0.25"], Some(&[0, 1, 2, 3])),
            (&["t_0", "t_0.5", "t_1"], Some(&[0, 1, 2])),
            (&["t_10.0", "t_9.0", "t_9.5"], Some(&[1, 2, 0])),
            (&["m_-1", "m_-2", "m_-3"], Some(&[2, 1, 0])),
            (&["n_-1", "n_-2", "n_0", "n_1"], Some(&[1, 0, 2, 3])),
            (&["x=-0.25", "x=-0.5", "x=0.0"], Some(&[1, 0, 2])),
            (&["e_1e-1", "e_1e-2", "e_1e-3"], Some(&[2, 1, 0])),
            (&["e_0.0001", "e_0.001", "e_1e-05"], Some(&[2, 0, 1])),
            // Counters with a point between them, separators and dates.
            (&["s_1.10", "s_1.11", "s_1.9"], Some(&[2, 0, 1])),
            (
                &["a-1", "a-10", "a-2", "a-3", "a-4", "a-5", "a-6", "a-7", "a-8", "a-9"],
                Some(&[0, 2, 3, 4, 5, 6, 7, 8, 9, 1]),
            ),
            (&["i_-0", "i_-1", "i_-2"], Some(&[0, 1, 2])),
            (&["d_2020-01-02", "d_2020-01-03"], Some(&[0, 1])),
            (&["s1e1", "s1e2", "s1e3"], Some(&[0, 1, 2])),
            (&["1.2.10", "1.2.8", "1.2.9"], Some(&[1, 2, 0])),
            (&["t_0.10", "t_0.15", "t_0.5"], None),
            (&["s_1.11", "s_1.8", "s_1.9"], None),
            (&["s_1.11", "s_1.9"], None),
            (&["plate1e-1", "plate1e-2", "plate1e-3"], None),
        ] {
            let given = names.iter().map(|name| PathBuf::from(format!("{name}.npy"))).collect::<Vec<_>>();
            let list = FileList::of_list(&given, None, false);
            let folder = FileList::of_folder(Path::new("f"), &given, None, false);
            match expected {
                Some(order) => {
                    let expected: Vec<&PathBuf> = order.iter().map(|i| &given[*i]).collect();
                    for list in [list, folder] {
                        let list = list.unwrap_or_else(|error| panic!("{error}"));
                        assert_eq!(list.paths.iter().collect::<Vec<_>>(), expected, "{}", list.note);
                    }
                    let told = FileList::of_list(&given, Some(FileOrder::Natural), false).unwrap();
                    assert_eq!(told.paths.iter().collect::<Vec<_>>(), expected);
                }
                None => {
                    for message in [list, folder].map(|list| list.err().unwrap().to_string()) {
                        for word in ["in two ways", "`order` natural for", "`order` given"] {
                            assert!(message.contains(word), "{names:?}: {message}");
                        }
                    }
                    // In this order on purpose.
                    let reversed: Vec<PathBuf> = given.iter().rev().cloned().collect();
                    assert_eq!(FileList::of_list(&reversed, None, false).unwrap().paths, reversed);
                }
            }
        }
    }

    #[test]
    fn words_with_digits_are_in_one_order_or_refused() {
        let hexadecimal = paths(&["f_09.npy", "f_0a.npy", "f_0b.npy"]);
        let list = FileList::of_list(&hexadecimal, None, false).err().unwrap().to_string();
        let folder = FileList::of_folder(Path::new("f"), &hexadecimal, None, false).err().unwrap().to_string();
        for message in [list, folder] {
            assert!(
                message.contains("differs from the alphabetical") && message.contains("`order` given"),
                "{message}"
            );
        }
        assert_eq!(FileList::of_list(&hexadecimal, Some(FileOrder::Given), false).unwrap().paths, hexadecimal);
        // The first in this order on purpose; the second in one order by any reading.
        let named = paths(&["run2_before.npy", "run10_after.npy"]);
        assert_eq!(FileList::of_list(&named, None, false).unwrap().paths, named);
        let words = paths(&["a1_x.npy", "b2_y.npy"]);
        assert_eq!(FileList::of_folder(Path::new("f"), &words, None, false).unwrap().paths, words);
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
        // In this order on purpose.
        assert_eq!(FileList::of_list(&shuffled, None, true).unwrap().paths, shuffled);
        let message =
            FileList::of_folder(Path::new("f"), &gap, Some(FileOrder::Given), true).err().unwrap().to_string();
        assert!(message.contains("name the files"), "{message}");
    }
}
