//! Lines of a text header of bounded length, before an array or beside its files.

use crate::data_files::{MOST_FILES, numbered};
use crate::error::{ImportError, Result};
use std::fs::File;
use std::io::{BufRead, BufReader, Read, Take};
use std::path::Path;

/// Longest header read, with its list of files.
const LONGEST_HEADER: u64 = 16 << 20;

/// A header's lines, in sequence.
pub(crate) struct HeaderLines<'a> {
    file: BufReader<Take<File>>,
    path: &'a Path,
    bytes: u64,
}

impl<'a> HeaderLines<'a> {
    pub(crate) fn open(path: &'a Path) -> Result<Self> {
        let file = File::open(path).map_err(ImportError::io(path))?;
        Ok(Self { file: BufReader::new(file.take(LONGEST_HEADER)), path, bytes: 0 })
    }

    /// Bytes of all lines so far.
    pub(crate) fn bytes(&self) -> u64 {
        self.bytes
    }

    /// The next line, without blanks at its end; `None` at the file's end.
    pub(crate) fn next(&mut self) -> Result<Option<String>> {
        let mut line = Vec::new();
        let count = self.file.read_until(b'\n', &mut line).map_err(ImportError::io(self.path))?;
        self.bytes += count as u64;
        if self.bytes >= LONGEST_HEADER {
            let problem = format!("its header is longer than {LONGEST_HEADER} bytes, more than any valid one");
            return Err(ImportError::invalid(self.path, problem));
        }
        Ok((count > 0).then(|| String::from_utf8_lossy(&line).trim_end().to_owned()))
    }

    /// The names of files in all further lines.
    pub(crate) fn names(&mut self) -> Result<Vec<String>> {
        let mut names = Vec::new();
        while let Some(line) = self.next()? {
            if !line.is_empty() {
                names.push(line);
            }
            if names.len() > MOST_FILES {
                let problem = format!("its header lists more than {MOST_FILES} data files, more than any valid one");
                return Err(ImportError::invalid(self.path, problem));
            }
        }
        Ok(names)
    }
}

/// Names with each number from the first to the last, in steps up or down; `None` if the numbers or the pattern are not valid.
pub(crate) fn counted_names(pattern: &str, [first, last, step]: [&str; 3]) -> Option<Vec<String>> {
    let [first, last, step] = [first.parse::<i64>().ok()?, last.parse().ok()?, step.parse().ok()?];
    let (distance, end) = (last.checked_sub(first)?, step.checked_abs()?);
    if step == 0 || distance != 0 && distance.is_negative() != step.is_negative() {
        return None;
    }
    let count = usize::try_from(distance.checked_abs()? / end).ok().filter(|n| *n < MOST_FILES)? + 1;
    (0..count as i64).map(|i| numbered(pattern, first.checked_add(i.checked_mul(step)?)?)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_counted_up_and_down() {
        let names = |numbers: [&str; 3]| counted_names("s%02d", numbers).map(|names| names.join(" "));
        assert_eq!(names(["1", "4", "1"]).as_deref(), Some("s01 s02 s03 s04"));
        assert_eq!(names(["1", "4", "2"]).as_deref(), Some("s01 s03"));
        assert_eq!(names(["3", "1", "-1"]).as_deref(), Some("s03 s02 s01"));
        assert_eq!(names(["3", "3", "1"]).as_deref(), Some("s03"));
        for wrong in [["1", "4", "0"], ["4", "1", "1"], ["1", "4", "-1"], ["1", "99999999999", "1"], ["a", "4", "1"]] {
            assert_eq!(names(wrong), None);
        }
        let ends = [i64::MIN, i64::MAX].map(|n| n.to_string());
        assert_eq!(names([&ends[0], &ends[1], "1"]), None);
        assert_eq!(names(["0", "1", &ends[0]]), None);
    }
}
