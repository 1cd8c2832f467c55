//! User-given times of an input's steps, replacing its file's.

use crate::error::{ImportError, Result};
use crate::options::OpenOptions;
use crate::source::SourceInfo;
use brickyard_volume::{TimeAxis, counted, time_unit};
use std::path::Path;

/// Most bytes of a file of stamps: some ten million of them.
const LONGEST_STAMPS: u64 = 256 << 20;

/// Replaces the file's time step, unit and stamps with the user's.
pub(crate) fn override_time(info: &mut SourceInfo, path: &Path, options: &OpenOptions) -> Result<()> {
    if options.time_step.is_some() && options.time_stamps.is_some() {
        let problem = "`time_step` and `time_stamps`: steps are either evenly spaced or have times of their own; give \
                       one of the two";
        return Err(ImportError::options(path, problem));
    }
    let known = info.time.take();
    let unit_of_file = known.as_ref().and_then(|axis| axis.unit.clone());
    let unit = match &options.time_unit {
        Some(unit) => {
            Some(time_unit(unit).map_err(|p| ImportError::options(path, format!("`time_unit`: {p}")))?.into())
        }
        None => unit_of_file,
    };
    info.time = if let Some(stamps_path) = &options.time_stamps {
        let stamps = read_stamps(stamps_path, info.times)?;
        let axis = TimeAxis::of_stamps(stamps, unit);
        Some(axis.map_err(|problem| ImportError::invalid(stamps_path, problem.to_string()))?)
    } else if let Some(step) = options.time_step {
        let start = known.map_or(0.0, |axis| axis.start);
        Some(TimeAxis { start, step, unit, ..TimeAxis::default() })
    } else if options.time_unit.is_some() {
        Some(TimeAxis { unit, since: None, ..known.unwrap_or_default() })
    } else {
        known
    };
    let Some(axis) = &info.time else { return Ok(()) };
    axis.check(info.times).map_err(|problem| {
        let option = if options.time_step.is_some() { "`time_step`" } else { "the time axis" };
        ImportError::options(path, format!("{option} cannot be used: {problem}"))
    })
}

/// Reads a file of stamps; fails unless it has one number per time step.
fn read_stamps(path: &Path, times: u32) -> Result<Vec<f64>> {
    let bytes = std::fs::metadata(path).map_err(ImportError::io(path))?.len();
    if bytes > LONGEST_STAMPS {
        let problem = format!(
            "a file of {bytes} bytes is too long for a list of times: expected one number a line, as many as time steps"
        );
        return Err(ImportError::invalid(path, problem));
    }
    let text = std::fs::read(path).map_err(ImportError::io(path))?;
    let text = String::from_utf8(text)
        .map_err(|_| ImportError::invalid(path, "is not text: expected one number a line, as many as time steps"))?;
    let lines =
        (1..).zip(text.trim_start_matches('\u{feff}').lines().map(str::trim)).filter(|(_, line)| !line.is_empty());
    let stamps = lines.map(|(number, line)| {
        let stamp = line.parse::<f64>().ok().filter(|stamp| stamp.is_finite());
        stamp.ok_or_else(|| {
            let start: String = line.chars().take(40).collect();
            let problem = format!("line {number}: expected the time of one step, a number, found '{start}'");
            ImportError::invalid(path, problem)
        })
    });
    let stamps: Vec<f64> = stamps.collect::<Result<_, _>>()?;
    if stamps.len() != times as usize {
        let (steps, found) = (counted(times.into(), "time step"), counted(stamps.len() as u64, "number"));
        let problem = format!("`time_stamps`: holds {found}, but the input has {steps}");
        return Err(ImportError::options(path, problem));
    }
    Ok(stamps)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::axes::Sizes;
    use crate::testing::temp_file;
    use brickyard_volume::{Extent, VoxelType};

    fn told(known: Option<TimeAxis>, options: &OpenOptions) -> Result<Option<TimeAxis>, String> {
        let sizes = Sizes { extent: Extent::new(1, 1, 1), channels: 1, times: 4 };
        let mut info = SourceInfo { time: known, ..SourceInfo::plain(sizes, VoxelType::U8) };
        override_time(&mut info, Path::new("in"), options).map_err(|error| error.to_string())?;
        Ok(info.time)
    }

    fn seconds(step: f64) -> TimeAxis {
        TimeAxis {
            start: 3.0,
            step,
            unit: Some("second".into()),
            since: Some("1900-01-01".into()),
            ..TimeAxis::default()
        }
    }

    #[test]
    fn the_user_knows_better_when_steps_were_taken() {
        let none = OpenOptions::default();
        assert_eq!(told(None, &none), Ok(None));
        assert_eq!(told(Some(seconds(2.0)), &none), Ok(Some(seconds(2.0))));
        let step = OpenOptions { time_step: Some(0.5), ..none.clone() };
        assert_eq!(told(Some(seconds(2.0)), &step), Ok(Some(TimeAxis { since: None, ..seconds(0.5) })));
        let both = OpenOptions { time_unit: Some("ms".into()), ..step };
        let milliseconds = TimeAxis { step: 0.5, unit: Some("millisecond".into()), ..TimeAxis::default() };
        assert_eq!(told(None, &both), Ok(Some(milliseconds.clone())));
        let unit = OpenOptions { time_unit: Some("ms".into()), ..none.clone() };
        assert_eq!(told(None, &unit), Ok(Some(TimeAxis { step: 1.0, ..milliseconds })));
        let (_folder, path) = temp_file("stamps", b"\xef\xbb\xbf0\n0.5\r\n\n 2\n9e0\n");
        let stamps = OpenOptions { time_stamps: Some(path), ..none };
        let found = told(Some(seconds(2.0)), &stamps).unwrap().unwrap();
        assert_eq!((found.start, found.stamps, found.unit.as_deref()), (0.0, vec![0.0, 0.5, 2.0, 9.0], Some("second")));
    }

    #[test]
    fn what_cannot_be_is_refused_with_numbers() {
        let refusal = |options: &OpenOptions| told(None, options).unwrap_err();
        let none = OpenOptions::default();
        for step in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            let message = refusal(&OpenOptions { time_step: Some(step), ..none.clone() });
            assert!(message.contains("`time_step`") && message.contains(&format!("found {step}")), "{message}");
        }
        let message = refusal(&OpenOptions { time_unit: Some("mm".into()), ..none.clone() });
        assert!(message.contains("`time_unit`: 'mm'") && message.contains("second (s)"), "{message}");
        let of_file = |text: &[u8], words: &[&str]| {
            let (_folder, path) = temp_file("stamps", text);
            let message = refusal(&OpenOptions { time_stamps: Some(path), ..none.clone() });
            assert!(words.iter().all(|word| message.contains(word)), "{message}");
        };
        of_file(b"0\n1\n2\n", &["stamps", "holds 3 numbers", "4 time steps"]);
        of_file(b"0\n1\n2,5\n3\n", &["line 3", "2,5"]);
        of_file(b"0\n1\ninf\n3\n", &["line 3", "inf"]);
        of_file(b"0\n2\n1\n3\n", &["ascending", "1 of step 2 after 2 of step 1"]);
        of_file(b"\xff\xfe", &["is not text"]);
        let (_folder, path) = temp_file("stamps", b"0\n1\n2\n3\n");
        let both = OpenOptions { time_step: Some(1.0), time_stamps: Some(path), ..none.clone() };
        assert!(refusal(&both).contains("`time_step` and `time_stamps`"));
        let gone = OpenOptions { time_stamps: Some("/no/such".into()), ..none };
        assert!(refusal(&gone).contains("/no/such: No such file"));
    }
}
