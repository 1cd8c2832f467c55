//! Time steps on the command line: one, some or all of them.

use super::Failure;
use brickyard::import::StepChoice;
use brickyard::volume::counted;
use std::str::FromStr;

/// Time steps of `--time`: `N`, `A:B` or `A:B:S` with B excluded, as in Python, or `all`. Either end may be left out.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum StepRange {
    /// One step.
    One(u32),
    /// Every `stride`-th step from `first` on, up to the excluded `end`, or to the last step without one.
    Some { first: u32, end: Option<u32>, stride: u32 },
}

/// The most listed steps: a store may claim any number of them.
const MOST_STEPS: u32 = 1_000_000;

const FORM: &str = "a step N, a range A:B or A:B:S with B excluded, as in 10:200:5, or all; steps are numbered from 0";

impl FromStr for StepRange {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let form = || format!("'{text}': expected {FORM}");
        let number = |part: &str| part.parse::<u32>().map_err(|_| form());
        let or_none = |part: &str| if part.is_empty() { Ok(None) } else { number(part).map(Some) };
        let parts: Vec<&str> = text.split(':').map(str::trim).collect();
        let (first, end, stride) = match parts[..] {
            ["all"] => (None, None, None),
            [step] => return number(step).map(Self::One),
            [first, end] => (or_none(first)?, or_none(end)?, None),
            [first, end, stride] => (or_none(first)?, or_none(end)?, or_none(stride)?),
            _ => return Err(form()),
        };
        let (first, stride) = (first.unwrap_or(0), stride.unwrap_or(1));
        if stride == 0 {
            return Err(format!("'{text}': a stride of 0; expected {FORM}"));
        }
        if end.is_some_and(|end| end <= first) {
            return Err(format!("'{text}': the range holds no step; expected {FORM}"));
        }
        Ok(Self::Some { first, end, stride })
    }
}

impl std::fmt::Display for StepRange {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::One(step) => write!(f, "{step}"),
            Self::Some { first: 0, end: None, stride: 1 } => f.write_str("all"),
            Self::Some { first, end, stride } => {
                let end = end.map_or(String::new(), |end| end.to_string());
                if *stride == 1 { write!(f, "{first}:{end}") } else { write!(f, "{first}:{end}:{stride}") }
            }
        }
    }
}

impl StepRange {
    /// The steps of an input, whose number is not known yet.
    pub(crate) fn choice(&self) -> StepChoice {
        match *self {
            Self::One(first) => StepChoice { first, end: Some(first.saturating_add(1)), stride: 1 },
            Self::Some { first, end, stride } => StepChoice { first, end, stride },
        }
    }

    /// Returns the first step, the end (excluded) and the stride, in a store of `times` steps.
    ///
    /// # Errors
    /// If the store has no such steps; the message gives their number.
    pub(crate) fn within(&self, times: u32) -> Result<(u32, u32, u32), Failure> {
        let (first, end, stride) = match *self {
            Self::One(step) => (step, step.saturating_add(1), 1),
            Self::Some { first, end, stride } => (first, end.unwrap_or(times), stride),
        };
        if first < end && end <= times && first < times {
            return Ok((first, end, stride));
        }
        let steps = counted(times.into(), "time step");
        Err(Failure::usage(format!("--time {self}: the store has {steps}, numbered from 0")))
    }

    /// Returns the steps, in a store of `times` steps.
    ///
    /// # Errors
    /// The errors of [`StepRange::within`], and an error for more than [`MOST_STEPS`] steps.
    pub(crate) fn steps(&self, times: u32) -> Result<Vec<u32>, Failure> {
        let (first, end, stride) = self.within(times)?;
        let count = (end - first).div_ceil(stride);
        if count > MOST_STEPS {
            let problem = format!("{count} steps, expected at most {MOST_STEPS}: take a part, as in 0:{MOST_STEPS}");
            return Err(Failure::usage(format!("--time {self}: {problem}")));
        }
        Ok((0..count).map(|i| first + i * stride).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn steps(text: &str, times: u32) -> Result<Vec<u32>, String> {
        let range: StepRange = text.parse()?;
        assert_eq!(range.to_string().parse(), Ok(range.clone()), "{text}");
        range.steps(times).map_err(|failure| failure.message)
    }

    #[test]
    fn ranges_are_pythons() {
        for (text, expected) in [
            ("3", &[3][..]),
            ("all", &[0, 1, 2, 3, 4, 5, 6]),
            ("2:5", &[2, 3, 4]),
            ("1:7:2", &[1, 3, 5]),
            ("0:7:3", &[0, 3, 6]),
            ("5:", &[5, 6]),
            (":2", &[0, 1]),
            ("::3", &[0, 3, 6]),
            (" 2 : 3 ", &[2]),
            ("6:7:4000000000", &[6]),
        ] {
            assert_eq!(steps(text, 7).as_deref(), Ok(expected), "{text}");
        }
    }

    #[test]
    fn steps_that_are_not_there_are_told_how_many_are() {
        for text in ["7", "0:8", "7:", "9:12", "4294967295"] {
            let message = steps(text, 7).unwrap_err();
            assert!(message.contains(&format!("--time {text}")) && message.contains("7 time steps"), "{message}");
        }
        for text in ["", "x", "-1", "1:2:3:4", "1.5", "2:-1", "4294967296", "All"] {
            assert!(steps(text, 7).unwrap_err().contains("10:200:5"), "{text}");
        }
        assert_eq!(steps("0:1000000", u32::MAX).map(|steps| steps.len()), Ok(1_000_000));
        assert!(steps("all", u32::MAX).unwrap_err().contains("at most 1000000"));
        assert!(steps("1:5:0", 7).unwrap_err().contains("stride of 0"));
        for text in ["5:5", "5:2"] {
            assert!(steps(text, 7).unwrap_err().contains("holds no step"), "{text}");
        }
    }
}
