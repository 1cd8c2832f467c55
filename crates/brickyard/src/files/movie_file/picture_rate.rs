//! Picture rates of movies.

use std::fmt::{Display, Formatter};
use std::str::FromStr;

/// Pictures per second, from 0.01 to 1000, to a thousandth.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PictureRate {
    per_1000_s: u32,
}

impl PictureRate {
    /// The rate as a fraction in lowest terms: pictures over seconds.
    pub fn ratio(self) -> (u32, u32) {
        let mut rest = (self.per_1000_s, 1000);
        while rest.1 > 0 {
            rest = (rest.1, rest.0 % rest.1);
        }
        (self.per_1000_s / rest.0, 1000 / rest.0)
    }

    /// Start of picture `index` in hundredths of a second, rounded individually so errors do not add up.
    pub(super) fn begin_cs(self, index: u64) -> u64 {
        let per_1000_s = u64::from(self.per_1000_s);
        (index * 100_000 + per_1000_s / 2) / per_1000_s
    }

    pub(super) fn exceeds(self, per_second: u32) -> bool {
        self.per_1000_s > per_second * 1000
    }
}

impl FromStr for PictureRate {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let expected = || format!("'{text}': expected frames per second, from 0.01 to 1000, as in 24 or 29.97");
        let rate = text.trim().parse().ok().filter(|rate: &f64| (0.01..=1000.0).contains(rate)).ok_or_else(expected)?;
        Ok(Self { per_1000_s: (rate * 1000.0).round() as u32 })
    }
}

impl Display for PictureRate {
    fn fmt(&self, f: &mut Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}", f64::from(self.per_1000_s) / 1000.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rates_are_fractions_in_lowest_terms() {
        for (text, ratio, shown) in [
            ("24", (24, 1), "24"),
            ("29.97", (2997, 100), "29.97"),
            ("0.5", (1, 2), "0.5"),
            ("0.01", (1, 100), "0.01"),
            ("1e3", (1000, 1), "1000"),
            ("23.9764", (2997, 125), "23.976"),
        ] {
            let rate: PictureRate = text.parse().unwrap();
            assert_eq!((rate.ratio(), rate.to_string().as_str()), (ratio, shown), "{text}");
        }
        for text in ["0", "-1", "nan", "inf", "1001", "0.009", "fast", ""] {
            assert!(text.parse::<PictureRate>().unwrap_err().contains("0.01 to 1000"), "{text}");
        }
    }

    #[test]
    fn times_of_pictures_do_not_drift() {
        let rate: PictureRate = "24".parse().unwrap();
        let times: Vec<u64> = (0..=24).map(|i| rate.begin_cs(i)).collect();
        assert_eq!((times[0], times[1], times[2], times[24]), (0, 4, 8, 100));
        assert!(times.windows(2).all(|pair| (4..=5).contains(&(pair[1] - pair[0]))));
        assert_eq!(rate.begin_cs(24_000_000), 100_000_000);
    }
}
