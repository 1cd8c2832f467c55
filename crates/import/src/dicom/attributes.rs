//! Attributes that tell slices of one position apart: kinds of image, which become channels, and times, which become time steps. Read from the
//! headers of a series while it is opened.

use super::header::Header;
use dicom_core::Tag;
use dicom_dictionary_std::tags;

/// Microseconds of a day, and of half of it.
const DAY_US: i64 = 86_400_000_000;

/// A slice's header, and its frame in it, from 0.
#[derive(Clone, Copy)]
pub(super) struct At<'a> {
    pub(super) header: &'a Header,
    pub(super) frame: usize,
}

/// An attribute of the kind of image. Slices that differ in it are of different channels.
pub(super) struct Kind {
    /// Elements with its value, the first present one first: an enhanced file's, and others'.
    tags: &'static [Tag],
    pub(super) name: &'static str,
    /// Its name in channels' names, and the unit after it.
    mark: [&'static str; 2],
}

/// Kinds of image. A series that differs in one of these differs in its times as well, as its images are made one after another; so these go
/// before all times, or a channel would become a time step.
pub(super) const KINDS: &[Kind] = &[
    Kind { tags: &[tags::FRAME_TYPE, tags::IMAGE_TYPE], name: "ImageType", mark: ["", ""] },
    Kind { tags: &[tags::COMPLEX_IMAGE_COMPONENT], name: "ComplexImageComponent", mark: ["", ""] },
    Kind { tags: &[tags::EFFECTIVE_ECHO_TIME, tags::ECHO_TIME], name: "EchoTime", mark: ["TE ", " ms"] },
    Kind { tags: &[tags::ECHO_NUMBERS], name: "EchoNumbers", mark: ["echo ", ""] },
    Kind { tags: &[tags::INVERSION_TIMES, tags::INVERSION_TIME], name: "InversionTime", mark: ["TI ", " ms"] },
    Kind { tags: &[tags::FLIP_ANGLE], name: "FlipAngle", mark: ["flip angle ", ""] },
    Kind { tags: &[tags::KVP], name: "KVP", mark: ["", " kV"] },
    Kind { tags: &[tags::DIFFUSION_B_VALUE], name: "DiffusionBValue", mark: ["b ", ""] },
    Kind { tags: &[tags::DIFFUSION_GRADIENT_ORIENTATION], name: "DiffusionGradientOrientation", mark: ["along ", ""] },
];

impl Kind {
    /// The value of a slice; empty if it has none.
    pub(super) fn value(&self, at: At) -> Vec<String> {
        let Some(tag) = self.tags.iter().find(|tag| at.header.written(at.frame, **tag).is_some()) else {
            return Vec::new();
        };
        if let Some(numbers) = at.header.numbers(at.frame, *tag) {
            return numbers.iter().map(f64::to_string).collect();
        }
        let text = at.header.written(at.frame, *tag).unwrap_or_default();
        text.split('\\').map(|part| part.trim().to_owned()).collect()
    }

    /// The name of a value in a channel's name, without the parts common to `all` values.
    pub(super) fn label(&self, value: &[String], all: &[&Vec<String>]) -> String {
        let [before, after] = self.mark;
        if value.is_empty() {
            return format!("no {}", self.name);
        }
        let differs = |i: usize| all.iter().any(|other| other.get(i) != value.get(i));
        let is_text = before.is_empty() && after.is_empty();
        let parts = value.iter().enumerate().filter(|(i, _)| !is_text || differs(*i)).map(|(_, part)| part.as_str());
        format!("{before}{}{after}", parts.collect::<Vec<_>>().join(" "))
    }
}

/// An attribute of time. Slices that differ in it are of different time steps.
pub(super) struct When {
    pub(super) name: &'static str,
    value: fn(At) -> Option<Moment>,
    pub(super) rule: Rule,
}

/// A value of an attribute of time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Moment {
    /// A number: an index, or seconds.
    Number(f64),
    /// Microseconds, since midnight unless dated.
    Clock { us: i64, is_dated: bool },
}

/// How an attribute's values tell the steps at one position from those at another.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Rule {
    /// Each position has the same values.
    Same,
    /// Seconds: each position has the same values, or each step is over before the next begins, at all positions.
    Time,
    /// As above, or evenly spaced at each position, from one beginning: phases of a heart beat, whose length varies.
    Phase,
    /// Each step's numbers end before the next step's begin, or each position's follow one another.
    Count,
}

/// Times. Those made for telling steps apart go first; then what was measured; then when the image was made; and in the end the mere order, in
/// which scanners number their images.
pub(super) const TIMES: &[When] = &[
    When { name: "TemporalPositionIdentifier", value: |at| index(at, TEMPORAL_POSITION), rule: Rule::Same },
    When { name: "TemporalPositionTimeOffset", value: |at| number(at, TIME_OFFSET, 1.0), rule: Rule::Time },
    When { name: "TriggerTime", value: |at| number(at, TRIGGER, 1e3), rule: Rule::Phase },
    When { name: "FrameReferenceTime", value: |at| number(at, &[tags::FRAME_REFERENCE_TIME], 1e3), rule: Rule::Time },
    When {
        name: "NominalPercentageOfCardiacPhase",
        value: |at| index(at, &[tags::NOMINAL_PERCENTAGE_OF_CARDIAC_PHASE]),
        rule: Rule::Same,
    },
    When { name: "AcquisitionTime", value: acquired, rule: Rule::Time },
    When { name: "ContentTime", value: |at| dated(at, tags::CONTENT_DATE, tags::CONTENT_TIME), rule: Rule::Time },
    When { name: "AcquisitionNumber", value: |at| index(at, &[tags::ACQUISITION_NUMBER]), rule: Rule::Same },
    When { name: "InstanceNumber", value: |at| index(at, &[tags::INSTANCE_NUMBER]), rule: Rule::Count },
];

const TEMPORAL_POSITION: &[Tag] = &[tags::TEMPORAL_POSITION_INDEX, tags::TEMPORAL_POSITION_IDENTIFIER];
const TIME_OFFSET: &[Tag] = &[tags::TEMPORAL_POSITION_TIME_OFFSET];
const TRIGGER: &[Tag] = &[tags::NOMINAL_CARDIAC_TRIGGER_DELAY_TIME, tags::TRIGGER_TIME];

impl When {
    /// Whether the values are seconds.
    pub(super) fn is_time(&self) -> bool {
        matches!(self.rule, Rule::Time | Rule::Phase)
    }

    /// The values of slices, clock times since the first of them; `None` unless each slice has one, and their order is known.
    pub(super) fn values<'a>(&self, slices: impl Iterator<Item = At<'a>>) -> Option<Vec<f64>> {
        let moments: Vec<Moment> = slices.map(self.value).collect::<Option<_>>()?;
        let clocks = || {
            moments.iter().filter_map(|moment| match moment {
                Moment::Clock { us, is_dated } => Some((*us, *is_dated)),
                Moment::Number(_) => None,
            })
        };
        let (first, last) = (clocks().map(|(us, _)| us).min(), clocks().map(|(us, _)| us).max());
        let all_dated = clocks().all(|(_, is_dated)| is_dated);
        let none_dated = clocks().all(|(_, is_dated)| !is_dated);
        // Past midnight, or at noon?
        let is_long = last.zip(first).is_some_and(|(last, first)| last - first > DAY_US / 2);
        if !(all_dated || none_dated && !is_long) {
            return None;
        }
        Some(
            moments
                .iter()
                .map(|moment| match moment {
                    Moment::Number(number) => *number,
                    Moment::Clock { us, .. } => (us - first.unwrap_or(*us)) as f64 / 1e6,
                })
                .collect(),
        )
    }
}

fn first_number(at: At, tags: &[Tag]) -> Option<f64> {
    tags.iter().find_map(|tag| at.header.numbers(at.frame, *tag)?.first().copied())
}

fn index(at: At, tags: &[Tag]) -> Option<Moment> {
    first_number(at, tags).map(Moment::Number)
}

/// Seconds, of an element in such a part of them.
fn number(at: At, tags: &[Tag], per_second: f64) -> Option<Moment> {
    first_number(at, tags).map(|number| Moment::Number(number / per_second))
}

fn acquired(at: At) -> Option<Moment> {
    let whole = [tags::FRAME_ACQUISITION_DATE_TIME, tags::ACQUISITION_DATE_TIME];
    let whole = whole.iter().find_map(|tag| at.header.written(at.frame, *tag));
    match whole {
        Some(text) => date_time(&text),
        None => dated(at, tags::ACQUISITION_DATE, tags::ACQUISITION_TIME),
    }
}

fn dated(at: At, date: Tag, time: Tag) -> Option<Moment> {
    let us = time_us(&at.header.written(at.frame, time)?)?;
    let day = at.header.written(at.frame, date).and_then(|text| day_of(&text));
    Some(Moment::Clock { us: day.unwrap_or(0) * DAY_US + us, is_dated: day.is_some() })
}

/// A time with its date, `YYYYMMDDHHMMSS.FFFFFF` and the offset from UTC, `+HHMM`.
fn date_time(text: &str) -> Option<Moment> {
    let text = text.trim();
    let (local, offset) = match text.find(['+', '-']) {
        Some(at) => text.split_at(at),
        None => (text, ""),
    };
    let offset_us = match offset.split_at_checked(1) {
        Some((sign, hours)) => time_us(hours)? * if sign == "-" { -1 } else { 1 },
        None => 0,
    };
    let (date, time) = local.split_at_checked(8)?;
    Some(Moment::Clock { us: day_of(date)? * DAY_US + time_us(time)? - offset_us, is_dated: true })
}

/// Microseconds since midnight of `HHMMSS.FFFFFF`, without minutes and seconds if it ends before; also with colons, as long ago.
fn time_us(text: &str) -> Option<i64> {
    let text = text.trim().replace(':', "");
    let (whole, part) = text.split_once('.').unwrap_or((&text, ""));
    let is_number = |text: &str| text.bytes().all(|digit| digit.is_ascii_digit());
    if !matches!(whole.len(), 2 | 4 | 6) || part.len() > 6 || !is_number(whole) || !is_number(part) {
        return None;
    }
    let two = |at: usize| whole.get(at..at + 2).map_or(Some(0), |digits| digits.parse::<i64>().ok());
    let (hours, minutes, seconds) = (two(0)?, two(2)?, two(4)?);
    let us: i64 = format!("{part:0<6}").parse().ok()?;
    (hours < 24 && minutes < 60 && seconds <= 60).then_some(((hours * 60 + minutes) * 60 + seconds) * 1_000_000 + us)
}

/// Days from the year 0 to `YYYYMMDD`; also with dots, as long ago.
fn day_of(text: &str) -> Option<i64> {
    let text = text.trim().replace('.', "");
    if text.len() != 8 || !text.bytes().all(|digit| digit.is_ascii_digit()) {
        return None;
    }
    let part = |range: std::ops::Range<usize>| text.get(range)?.parse::<i64>().ok();
    let (year, month, day) = (part(0..4)?, part(4..6)?, part(6..8)?);
    if !(1..=12).contains(&month) || !(1..=31).contains(&day) {
        return None;
    }
    // Years that begin in March end with February's last day.
    let (year, month) = if month > 2 { (year, month - 3) } else { (year - 1, month + 9) };
    Some(365 * year + year.div_euclid(4) - year.div_euclid(100) + year.div_euclid(400) + (153 * month + 2) / 5 + day)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn days_follow_one_another() {
        let days = |text| day_of(text).unwrap();
        for (one, next) in [
            ("20240228", "20240229"),
            ("20240229", "20240301"),
            ("21000228", "21000301"),
            ("20231231", "20240101"),
            ("2000.02.29", "20000301"),
        ] {
            assert_eq!(days(one) + 1, days(next), "{one}");
        }
        assert_eq!(days("20250101") - days("20240101"), 366);
        assert!(["", "2024", "20241301", "2024-1-1", "20240100"].iter().all(|text| day_of(text).is_none()));
    }

    #[test]
    fn times_are_read_to_the_microsecond() {
        assert_eq!(time_us("010203.5"), Some(3_723_500_000));
        assert_eq!(time_us("01:02:03.000001"), Some(3_723_000_001));
        assert_eq!((time_us("01"), time_us("0102")), (Some(3_600_000_000), Some(3_720_000_000)));
        assert!(["", "1", "250000", "0a0000", "010203.1234567", "-10203"].iter().all(|text| time_us(text).is_none()));
        let clock = |text: &str| match date_time(text) {
            Some(Moment::Clock { us, is_dated: true }) => us,
            other => panic!("{text}: {other:?}"),
        };
        assert_eq!(clock("20240101000001.25") - clock("20231231235959"), 2_250_000);
        assert_eq!(clock("20240101120000+0200"), clock("20240101100000"));
        assert_eq!(clock("20240101120000-0130"), clock("20240101133000"));
        assert!(["", "2024", "20240101", "20240101120000+"].iter().all(|text| date_time(text).is_none()));
    }
}
