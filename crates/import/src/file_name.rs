//! Texts and numbers in a file's name, read in one of two ways: every run of digits is a number, or numbers include signs, fractions
//! and powers of ten. Numbers are kept as digits, for exact comparison at any length.

use std::cmp::Ordering;
use std::fmt;
use std::path::Path;

/// Common scale of compared numbers: they must be less than 10 to this power.
const MOST_PLACES: u32 = 36;
/// Most digits of a power of ten in a name.
const LONGEST_EXPONENT: usize = 3;

/// How numbers are found in names.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Reading {
    /// As runs of digits: `t_-0.25` holds 0 and 25.
    Counters,
    /// With signs (after `_`, `=` or at the start), fractions and powers of ten: `t_-0.25` holds -0.25.
    Values,
}

/// A number in a file name.
#[derive(Clone, Debug)]
pub(crate) struct Number {
    is_negative: bool,
    /// Without leading and trailing zeros; empty for 0.
    digits: String,
    /// Power of ten times 0.`digits`.
    magnitude: i64,
    pub(crate) written: Written,
}

#[derive(Clone, Debug, Default)]
pub(crate) struct Written {
    text: String,
    /// Digits before the power of ten.
    length: usize,
    pub(crate) fraction: Option<String>,
    pub(crate) is_signed: bool,
    pub(crate) has_exponent: bool,
    /// Whether the apparent power of ten may as well be a letter and a counter, as in `plate1e-3`.
    pub(crate) is_doubtful: bool,
}

impl Number {
    fn new(is_negative: bool, integer: &str, exponent: i64, written: Written) -> Self {
        let all = format!("{integer}{}", written.fraction.as_deref().unwrap_or_default());
        let digits = all.trim_start_matches('0');
        let zeros = (all.len() - digits.len()) as i64;
        let digits = digits.trim_end_matches('0').to_owned();
        let is_zero = digits.is_empty();
        let magnitude = if is_zero { 0 } else { integer.len() as i64 - zeros + exponent };
        Self { is_negative: is_negative && !is_zero, digits, magnitude, written }
    }

    /// Whether the number is a plain run of digits.
    fn is_plain(&self) -> bool {
        !self.written.is_signed && self.written.fraction.is_none() && !self.written.has_exponent
    }

    /// Whether the number is written as -0, never printed by a program counting below 0.
    pub(crate) fn is_minus_zero(&self) -> bool {
        let Written { text, fraction, has_exponent, .. } = &self.written;
        text.starts_with('-') && self.digits.is_empty() && fraction.is_none() && !has_exponent
    }

    /// Whether the number lies between -1 and 1.
    pub(crate) fn is_below_one(&self) -> bool {
        self.digits.is_empty() || self.magnitude <= 0
    }

    /// Power of ten of the last digit; 0 for integers.
    pub(crate) fn place(&self) -> i64 {
        (self.magnitude - self.digits.len() as i64).min(0)
    }

    /// The number in units of ten to the power of `place`, at most its own place; `None` if too large.
    pub(crate) fn in_places(&self, place: i64) -> Option<i128> {
        if self.digits.is_empty() {
            return Some(0);
        }
        let zeros = u32::try_from(self.magnitude - self.digits.len() as i64 - place).ok()?;
        let count = self.digits.parse::<i128>().ok()?.checked_mul(10i128.checked_pow(zeros)?)?;
        let count = if self.is_negative { -count } else { count };
        (count.unsigned_abs() < 10u128.pow(MOST_PLACES)).then_some(count)
    }

    /// Sign and first digits, and their power of ten.
    pub(crate) fn power(&self) -> ((bool, &str), i64) {
        ((self.is_negative, &self.digits), self.magnitude)
    }

    /// Finds the number at a byte, and its end.
    fn at(text: &str, at: usize, reading: Reading) -> Option<(Self, usize)> {
        let bytes = text.as_bytes();
        let digits_at = |from: usize| bytes[from.min(bytes.len())..].iter().take_while(|c| c.is_ascii_digit()).count();
        let before = at.checked_sub(1).map(|i| bytes[i]);
        if reading == Reading::Counters {
            let end = at + digits_at(at);
            let number = || Self::new(false, &text[at..end], 0, Written::plain(&text[at..end]));
            return (end > at).then(|| (number(), end));
        }
        let starts = before.is_none_or(|c| b"/_=".contains(&c));
        let is_signed = starts && b"+-".contains(&bytes[at]);
        let start = at + usize::from(is_signed);
        let integer_end = start + digits_at(start);
        let is_point = |i: usize| bytes.get(i).is_some_and(|c| b".,".contains(c));
        let mut end = integer_end;
        // A number with several points has no fraction: 1.2.840 is a path of numbers.
        let is_chained = !is_signed && at >= 2 && before == bytes.get(end).copied() && bytes[at - 2].is_ascii_digit();
        let mut fraction = None;
        if is_point(end)
            && digits_at(end + 1) > 0
            && !is_chained
            && (end > start || before.is_some_and(|c| b"_=".contains(&c)))
        {
            let fraction_end = end + 1 + digits_at(end + 1);
            let goes_on = bytes.get(fraction_end) == bytes.get(end) && digits_at(fraction_end + 1) > 0;
            if !goes_on {
                fraction = Some(text[end + 1..fraction_end].to_owned());
                end = fraction_end;
            }
        }
        if end == start {
            return None;
        }
        let (mut exponent, mut has_exponent) = (0, false);
        if bytes.get(end).is_some_and(|c| c.eq_ignore_ascii_case(&b'e')) {
            let is_told = bytes.get(end + 1).is_some_and(|c| b"+-".contains(c));
            let from = end + 1 + usize::from(is_told);
            let exponent_end = from + digits_at(from);
            let is_whole = text[exponent_end..].chars().next().is_none_or(|c| !c.is_alphanumeric());
            let is_short = (1..=LONGEST_EXPONENT).contains(&(exponent_end - from));
            if (is_told || fraction.is_some()) && is_whole && is_short {
                exponent = text[end + 1..exponent_end].parse().ok()?;
                has_exponent = true;
                end = exponent_end;
            }
        }
        let written = Written {
            text: text[at..end].to_owned(),
            length: integer_end - start + fraction.as_ref().map_or(0, String::len),
            is_doubtful: has_exponent
                && fraction.is_none()
                && !is_signed
                && before.is_some_and(|c| c.is_ascii_alphabetic() || !c.is_ascii()),
            fraction,
            is_signed,
            has_exponent,
        };
        Some((Self::new(is_signed && bytes[at] == b'-', &text[start..integer_end], exponent, written), end))
    }
}

impl Written {
    fn plain(text: &str) -> Self {
        Self { text: text.to_owned(), length: text.len(), ..Self::default() }
    }
}

impl Ord for Number {
    fn cmp(&self, other: &Self) -> Ordering {
        let sign = |n: &Self| if n.digits.is_empty() { 0 } else { 1 - 2 * i8::from(n.is_negative) };
        let size = |n: &Self| (n.magnitude, n.digits.clone());
        sign(self).cmp(&sign(other)).then_with(|| match self.is_negative {
            true => size(other).cmp(&size(self)),
            false => size(self).cmp(&size(other)),
        })
    }
}

impl PartialOrd for Number {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for Number {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for Number {}

impl fmt::Display for Number {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.in_places(self.place()) {
            Some(count) => f.write_str(&in_decimals(count, self.place())),
            None => f.write_str(&self.written.text),
        }
    }
}

/// Formats a count of tens to the power of `place`, at most 0, as a decimal number.
pub(crate) fn in_decimals(count: i128, place: i64) -> String {
    let after = place.unsigned_abs() as usize;
    let digits = format!("{:0>1$}", count.unsigned_abs(), after + 1);
    let (integer, fraction) = digits.split_at(digits.len() - after);
    let fraction = fraction.trim_end_matches('0');
    let sign = if count < 0 { "-" } else { "" };
    let point = if fraction.is_empty() { "" } else { "." };
    format!("{sign}{integer}{point}{fraction}")
}

/// A name and its numbers.
pub(crate) struct Name {
    /// Text between the numbers.
    pub(crate) texts: Vec<String>,
    pub(crate) numbers: Vec<Number>,
}

impl Name {
    /// Splits a path; numbers of more than `longest` digits are text.
    pub(crate) fn of(path: &Path, reading: Reading, longest: usize) -> Self {
        let path = path.to_string_lossy();
        let mut found = Self { texts: vec![String::new()], numbers: Vec::new() };
        let mut at = 0;
        while let Some(next) = path[at..].chars().next() {
            let end = match Number::at(&path, at, reading) {
                Some((number, end)) if number.written.length <= longest => {
                    found.numbers.push(number);
                    found.texts.push(String::new());
                    at = end;
                    continue;
                }
                Some((_, end)) => end,
                None => at + next.len_utf8(),
            };
            found.texts.last_mut().into_iter().for_each(|text| text.push_str(&path[at..end]));
            at = end;
        }
        found
    }

    /// Whether both readings are the same.
    pub(crate) fn is_plain(&self) -> bool {
        self.numbers.iter().all(Number::is_plain)
    }

    /// The letters before number `i`, as `c` of `_c0`.
    pub(crate) fn label(&self, i: usize) -> String {
        let letters = self.texts[i].chars().rev().take_while(|c| c.is_alphabetic()).collect::<Vec<_>>();
        letters.into_iter().rev().collect::<String>().to_lowercase()
    }

    /// The order of the texts and numbers in turn.
    pub(crate) fn order(&self, other: &Self) -> Ordering {
        self.pieces().cmp(other.pieces())
    }

    fn pieces(&self) -> impl Iterator<Item = (&String, Option<&Number>)> {
        self.texts.iter().zip(self.numbers.iter().map(Some).chain([None]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn signs_fractions_and_powers_of_ten_are_found() {
        for (name, numbers) in [
            ("t_0.25.npy", &["0.25"][..]),
            ("t0.50.npy", &["0.5"]),
            ("a,1,25.npy", &["1.25"]),
            ("x=-3_y=+2.50.raw", &["-3", "2.5"]),
            ("-7.raw", &["-7"]),
            ("m_-0.5.raw", &["-0.5"]),
            ("t_.25.raw", &["0.25"]),
            ("e_1e-3.npy", &["0.001"]),
            ("e_2.5E2.npy", &["250"]),
            ("e_1e+02.npy", &["100"]),
            // Separators, dates, versions and labels.
            ("a-1.npy", &["1"]),
            ("s_2020-01-02.npy", &["2020", "1", "2"]),
            ("1.2.840.10008", &["1", "2", "840", "10008"]),
            ("s_1e2.npy", &["1", "2"]),
            ("4fae-7dec.npy", &["4", "7"]),
            ("3e-4a.npy", &["3", "4"]),
            ("out.7.raw", &["7"]),
            ("x0.25,y0.5", &["0.25", "0.5"]),
        ] {
            let found = Name::of(Path::new(name), Reading::Values, 18);
            let found: Vec<String> = found.numbers.iter().map(Number::to_string).collect();
            assert_eq!(found, numbers, "{name}");
        }
        let counters = Name::of(Path::new("m_-0.25e-3.npy"), Reading::Counters, 18);
        assert_eq!(counters.numbers.iter().map(Number::to_string).collect::<Vec<_>>(), ["0", "25", "3"]);
        assert_eq!(counters.texts, ["m_-", ".", "e-", ".npy"]);
    }

    #[test]
    fn numbers_are_compared_exactly() {
        let ascending = [
            "-1e+300", "-10", "-9.5", "-0.5", "-0.05", "0", "1e-300", "0.05", "0.1", "0.15", "0.5", "9.5", "10",
            "10.25", "1e+2", "1e+300",
        ];
        let numbers: Vec<Number> =
            ascending.iter().map(|text| Number::at(text, 0, Reading::Values).unwrap().0).collect();
        for (i, a) in numbers.iter().enumerate() {
            for (k, b) in numbers.iter().enumerate() {
                assert_eq!(a.cmp(b), i.cmp(&k), "{a} {b}");
            }
        }
        assert_eq!(numbers[14].in_places(-2), Some(10000));
        assert_eq!(numbers[15].in_places(-300), None);
    }
}
