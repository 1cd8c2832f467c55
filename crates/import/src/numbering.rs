//! Counters in files' names. Files taken in sequence must have one counter without gaps: a second one (`_c0`, `_c1`) would mix
//! planes of different things, and a missing file would shift all later ones.

use crate::file_name::{Name, Number, Reading, in_decimals};
use crate::files::name_of;
use std::collections::BTreeMap;
use std::path::PathBuf;

/// Most digits of a counter; longer runs are stamps or hashes.
const LONGEST_NUMBER: usize = 18;
/// Most numbers, or names, listed in a message.
const MOST_SHOWN: usize = 6;

/// Checks that the numbers in the names count the files without gaps. `paths` are at least two, in the order of these numbers.
/// `are_planes` (each file is one plane) lets the message suggest `axes`.
///
/// # Errors
/// A message with the missing or surplus numbers, and a way to read the files anyway.
pub(crate) fn check(paths: &[PathBuf], reading: Reading, are_planes: bool) -> Result<(), String> {
    let names: Vec<Name> = paths.iter().map(|path| Name::of(path, reading, LONGEST_NUMBER)).collect();
    let mut kinds: BTreeMap<&[String], usize> = BTreeMap::new();
    names.iter().for_each(|name| *kinds.entry(&name.texts).or_default() += 1);
    if kinds.len() == names.len() {
        // Names of words: nothing is counted.
        return Ok(());
    }
    if kinds.len() > 1 {
        return Err(several_kinds(paths, &names, kinds.len()));
    }
    let counters = counters(&names);
    // A number rising with every file counts them, whatever varies along with it (a time of day, say).
    let rising: Vec<&Vec<&Number>> = counters.iter().map(|(_, n)| n).filter(|n| n.is_sorted_by(|a, b| a < b)).collect();
    match (&rising[..], &counters[..]) {
        ([], [_, _, ..]) => Err(several_counters(paths, &names[0], &counters, are_planes)),
        ([], _) => Err(same_number(paths, &names)),
        (rising, _) if rising.iter().any(|numbers| are_powers(numbers)) => Ok(()),
        (rising, _) => {
            let counts: Vec<Count> = rising.iter().filter_map(|numbers| Count::of(numbers)).collect();
            if counts.iter().any(|count| count.gap(paths).is_none()) {
                return Ok(());
            }
            let closest = counts.iter().min_by(|a, b| a.span().total_cmp(&b.span()));
            Err(closest.and_then(|count| count.gap(paths)).unwrap_or_else(|| far_apart(rising[0])))
        }
    }
}

/// Whether the names are distinct words, without a counter.
pub(crate) fn are_words(paths: &[PathBuf], reading: Reading) -> bool {
    let mut kinds: Vec<_> = paths.iter().map(|path| Name::of(path, reading, LONGEST_NUMBER).texts).collect();
    kinds.sort();
    kinds.windows(2).all(|pair| pair[0] != pair[1])
}

/// Whether a number in the names rises by 1 from file to file.
pub(crate) fn count_by_one(paths: &[PathBuf]) -> bool {
    let names: Vec<Name> = paths.iter().map(|path| Name::of(path, Reading::Counters, LONGEST_NUMBER)).collect();
    let by_one = |(_, numbers): &(usize, Vec<&Number>)| {
        Count::of(numbers).is_some_and(|count| count.values.windows(2).all(|pair| pair[1] - pair[0] == 1))
    };
    names.iter().all(|name| name.texts == names[0].texts) && counters(&names).iter().any(by_one)
}

/// Varying numbers among names of one kind, with their places.
pub(crate) fn counters(names: &[Name]) -> Vec<(usize, Vec<&Number>)> {
    (0..names[0].numbers.len())
        .map(|i| (i, names.iter().map(|name| &name.numbers[i]).collect::<Vec<&Number>>()))
        .filter(|(_, numbers)| numbers.iter().any(|n| *n != numbers[0]))
        .collect()
}

/// Whether the numbers are written as powers of ten, and rise by the same power each.
fn are_powers(numbers: &[&Number]) -> bool {
    let first = numbers[0].power();
    let steps: Vec<i64> = numbers.windows(2).map(|pair| pair[1].power().1 - pair[0].power().1).collect();
    numbers.iter().any(|n| n.written.has_exponent)
        && numbers.iter().all(|n| n.power().0 == first.0)
        && steps.iter().all(|step| *step == steps[0])
}

fn far_apart(numbers: &[&Number]) -> String {
    let [first, last] = [numbers[0], numbers[numbers.len() - 1]];
    format!(
        "the numbers in the files' names go from {first} to {last} unevenly: pass `order` natural to take the files \
         one after another"
    )
}

/// Rising numbers on a common scale.
struct Count {
    /// Counts of tens to the power of `place`, at most 0.
    values: Vec<i128>,
    place: i64,
}

impl Count {
    /// `None` if there is no such scale, as for 1e-30 and 1e30.
    fn of(numbers: &[&Number]) -> Option<Self> {
        let place = numbers.iter().map(|n| n.place()).min()?;
        let values = numbers.iter().map(|n| n.in_places(place)).collect::<Option<Vec<_>>>()?;
        Some(Self { values, place })
    }

    fn span(&self) -> f64 {
        (self.values[self.values.len() - 1] - self.values[0]) as f64 * 10f64.powi(self.place as i32)
    }

    fn show(&self, value: i128) -> String {
        in_decimals(value, self.place)
    }

    /// Describes the first uneven step of rising numbers; `None` if all are even.
    fn gap(&self, paths: &[PathBuf]) -> Option<String> {
        let mut steps: BTreeMap<i128, usize> = BTreeMap::new();
        self.values.windows(2).for_each(|pair| *steps.entry(pair[1] - pair[0]).or_default() += 1);
        // The most frequent step, and the smallest of equally frequent ones.
        let (&step, _) = steps.iter().rev().max_by_key(|(step, count)| (**count, std::cmp::Reverse(**step)))?;
        let at = self.values.windows(2).position(|pair| pair[1] - pair[0] != step)?;
        let between = |pair: &[i128]| std::iter::successors(Some(pair[0]), |n| n.checked_add(step)).skip(1);
        let missing = self.values.windows(2).flat_map(|pair| between(pair).take_while(|n| *n < pair[1]));
        let shown: Vec<String> = missing.clone().take(MOST_SHOWN).map(|n| self.show(n)).collect();
        let more = if missing.clone().nth(MOST_SHOWN).is_some() { ", ..." } else { "" };
        let lack = match shown.is_empty() {
            true => String::new(),
            false => format!(", without {}{more}", shown.join(", ")),
        };
        let (before, after) = (name_of(&paths[at]), name_of(&paths[at + 1]));
        let [first, last, step] = [self.values[0], self.values[self.values.len() - 1], step].map(|n| self.show(n));
        Some(format!(
            "the numbers in the files' names go from {first} to {last} in steps of {step}{lack}: {after} follows \
             {before}. Add the missing files, or pass `order` natural to take the others one after another"
        ))
    }
}

fn several_kinds(paths: &[PathBuf], names: &[Name], kinds: usize) -> String {
    let mut seen: Vec<&[String]> = Vec::new();
    let mut shown = Vec::new();
    for (path, of) in paths.iter().zip(names) {
        if shown.len() < MOST_SHOWN && !seen.contains(&&of.texts[..]) {
            seen.push(&of.texts);
            shown.push(name_of(path));
        }
    }
    let more = if kinds > shown.len() { ", ..." } else { "" };
    format!(
        "the files' names are of {kinds} kinds, such as {}{more}: name the files of one kind, or pass `order` natural \
         to take all one after another",
        shown.join(", ")
    )
}

fn several_counters(paths: &[PathBuf], first: &Name, counters: &[(usize, Vec<&Number>)], are_planes: bool) -> String {
    let describe = |(i, numbers): &(usize, Vec<&Number>)| {
        let least = numbers.iter().min().unwrap_or(&numbers[0]);
        let greatest = numbers.iter().max().unwrap_or(&numbers[0]);
        match first.label(*i) {
            label if label.is_empty() => format!("number {} ({least} to {greatest})", i + 1),
            label => format!("'{label}' ({least} to {greatest})"),
        }
    };
    let found: Vec<String> = counters.iter().map(describe).collect();
    let axes = if are_planes { axes_of(first, counters, paths.len()) } else { None };
    let as_axes = axes.map_or(String::new(), |axes| format!("pass `order` natural {axes} to read them so, or "));
    let [a, b] = [&paths[0], &paths[1]].map(|path| name_of(path));
    format!(
        "the files' names hold more than one counter: {}, as in {a}, {b}; {as_axes}name the files of one volume, or \
         pass `order` natural to take all one after another",
        found.join(" and ")
    )
}

/// Options that describe the counters of `files` planes, if their letters identify them and no plane is missing.
fn axes_of(first: &Name, counters: &[(usize, Vec<&Number>)], files: usize) -> Option<String> {
    let (mut letters, mut sizes, mut product) = (String::new(), String::new(), 1);
    for (i, numbers) in counters {
        let (letter, flag) = match &*first.label(*i) {
            "c" | "ch" | "channel" => ('c', Some("`channels`")),
            "t" | "time" => ('t', Some("`times`")),
            "z" | "slice" => ('z', None),
            _ => return None,
        };
        if letters.contains(letter) {
            return None;
        }
        letters.push(letter);
        let mut different = numbers.clone();
        different.sort();
        different.dedup();
        product *= different.len();
        sizes += &flag.map_or(String::new(), |flag| format!(" {flag} {}", different.len()));
    }
    (product == files).then(|| format!("`axes` {letters}yx{sizes}"))
}

fn same_number(paths: &[PathBuf], names: &[Name]) -> String {
    let at = names.windows(2).position(|pair| pair[0].numbers == pair[1].numbers).unwrap_or(0);
    let [a, b] = [at, at + 1].map(|i| name_of(&paths[i]));
    format!(
        "{a} and {b} have the same number: name one of them, or pass `order` natural to take both, one after the other"
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::file_order::in_natural_order;

    fn checked(names: &[&str], are_planes: bool) -> Result<(), String> {
        let paths: Vec<PathBuf> = names.iter().map(PathBuf::from).collect();
        check(&in_natural_order(&paths), Reading::Counters, are_planes)
    }

    /// Checks names in their order, as values.
    fn checked_as_values(names: &[&str]) -> Result<(), String> {
        let paths: Vec<PathBuf> = names.iter().map(PathBuf::from).collect();
        check(&paths, Reading::Values, true)
    }

    #[test]
    fn values_count_evenly_too() {
        for names in [
            &["t_0.05.npy", "t_0.1.npy", "t_0.15.npy"][..],
            &["t_0.npy", "t_0.5.npy", "t_1.npy", "t_1.5.npy"],
            &["m_-3.npy", "m_-1.npy", "m_1.npy"],
            &["e_1e-05.npy", "e_0.0001.npy", "e_0.001.npy"],
            &["e_1e-300.npy", "e_1e+00.npy", "e_1e+300.npy"],
        ] {
            assert_eq!(checked_as_values(names), Ok(()), "{names:?}");
        }
        for (names, words) in [
            (&["t_0.1.npy", "t_0.2.npy", "t_0.5.npy"][..], "go from 0.1 to 0.5 in steps of 0.1, without 0.3, 0.4"),
            (&["m_-3.npy", "m_-2.npy", "m_0.npy", "m_1.npy"], "from -3 to 1 in steps of 1, without -1"),
            (&["t_0.5.npy", "t_0.50.npy"], "same number"),
            (&["e_1e-300.npy", "e_1e+00.npy", "e_1e+200.npy"], "unevenly"),
        ] {
            let message = checked_as_values(names).unwrap_err();
            assert!(message.contains(words) && message.contains("`order` natural"), "{message}");
        }
    }

    #[track_caller]
    fn refused(names: &[&str], words: &[&str]) {
        let message = checked(names, true).unwrap_err();
        for word in words.iter().chain(&["`order` natural"]) {
            assert!(message.contains(word), "{word:?} is not in: {message}");
        }
    }

    #[test]
    fn one_counter_without_gaps_is_as_it_should_be() {
        for names in [
            &[
                "s_1.tif", "s_2.tif", "s_10.tif", "s_3.tif", "s_4.tif", "s_5.tif", "s_6.tif", "s_7.tif", "s_8.tif",
                "s_9.tif",
            ][..],
            &["s000.tif", "s005.tif", "s010.tif"],
            &["after.npy", "before.npy"],
            // As on a plate, and one of each kind.
            &["a1.tif", "b1.tif", "c7.tif"],
            &["s_3.tif", "s_9.tif"],
            // A time of day goes along, unevenly; a hash too long for a number is text.
            &["i_0001_120000.tif", "i_0002_120007.tif", "i_0003_120013.tif"],
            &["2019/s1.tif", "2019/s2.tif", "2019/s3.tif"],
            &["a.1.3.6.1.4.1.14519.5.2.1.123456789012345678901", "a.1.3.6.1.4.1.14519.5.2.1.123456789012345678902"],
        ] {
            assert_eq!(checked(names, true), Ok(()), "{names:?}");
        }
    }

    #[test]
    fn gaps_are_named() {
        refused(
            &["s1.tif", "s2.tif", "s4.tif", "s5.tif"],
            &["1 to 5 in steps of 1, without 3", "s4.tif follows s2.tif"],
        );
        refused(&["s0.tif", "s5.tif", "s10.tif", "s25.tif"], &["steps of 5, without 15, 20:"]);
        refused(&["s1.tif", "s2.tif", "s3.tif", "s900000000.tif"], &["without 4, 5, 6, 7, 8, 9, ..."]);
        refused(&["s0.tif", "s10.tif", "s20.tif", "s24.tif"], &["in steps of 10: s24.tif follows s20.tif"]);
        // The counter, not the time of day along with it.
        refused(&["i_1_120000.tif", "i_2_120007.tif", "i_4_120013.tif"], &["1 to 4", "without 3"]);
        refused(&["s_1.tif", "s_01.tif", "s_2.tif"], &["s_01.tif", "s_1.tif", "same number"]);
    }

    #[test]
    fn second_counters_are_named() {
        let both = ["s_c0_z1.tif", "s_c0_z2.tif", "s_c1_z1.tif", "s_c1_z2.tif", "s_c2_z1.tif", "s_c2_z2.tif"];
        refused(&both, &["'c' (0 to 2) and 'z' (1 to 2)", "`axes` czyx `channels` 3 "]);
        refused(&["s_z1_t0.tif", "s_z1_t1.tif", "s_z2_t0.tif", "s_z2_t1.tif"], &["`axes` ztyx `times` 2 "]);
        assert!(!checked(&both, false).unwrap_err().contains("`axes`"), "files that are volumes");
        // One is missing, so the axes cannot be inferred.
        assert!(!checked(&both[1..], true).unwrap_err().contains("`axes`"));
        refused(&["1_1.tif", "1_2.tif", "2_1.tif", "2_2.tif"], &["number 1 (1 to 2) and number 2 (1 to 2)"]);
        refused(&["dapi_1.tif", "dapi_2.tif", "gfp_1.tif", "gfp_2.tif"], &["2 kinds", "dapi_1.tif, gfp_1.tif"]);
    }
}
