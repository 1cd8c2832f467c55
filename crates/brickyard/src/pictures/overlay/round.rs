//! Round numbers: lengths of 1, 2 or 5 times a power of ten, and their multiples.

/// Returns the greatest length of 1, 2 or 5 times a power of ten up to `most`; `None` if there is none.
pub fn round_length(most: f64) -> Option<f64> {
    let power = 10f64.powf(most.log10().floor());
    let round = [5.0, 2.0, 1.0].into_iter().map(|factor| factor * power).find(|&length| length <= most * (1.0 + 1e-9));
    // As users write it: 0.2, not 0.2000000001.
    round.and_then(|length| format!("{length:.3e}").parse().ok()).filter(|length: &f64| length.is_normal())
}

/// Returns the round numbers from `low` to `high`, about `count` of them or more.
pub fn ticks(low: f64, high: f64, count: f64) -> Vec<f64> {
    let Some(step) = round_length((high - low) / count.max(1.0)) else { return Vec::new() };
    let first = (low / step).ceil();
    // At most ten times the requested count: steps are at most 2.5 times too short.
    let number = (((high - low) / step).floor().max(0.0) as u32).min(1000);
    let ticks = (0..=number).map(|i| (first + f64::from(i)) * step).filter(|tick| *tick <= high + 1e-9 * step);
    ticks.map(|tick| format!("{tick:.12e}").parse().unwrap_or(tick)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lengths_are_1_2_or_5() {
        for (most, expected) in
            [(1.0, 1.0), (1.99, 1.0), (2.0, 2.0), (49.0, 20.0), (0.07, 0.05), (9.9e-7, 5e-7), (3e5, 2e5)]
        {
            assert_eq!(round_length(most), Some(expected), "{most}");
        }
        for none in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            assert_eq!(round_length(none), None, "{none}");
        }
    }

    #[test]
    fn ticks_are_round_and_within() {
        assert_eq!(ticks(-0.5, 10.2, 5.0), [0.0, 2.0, 4.0, 6.0, 8.0, 10.0]);
        assert_eq!(ticks(0.05, 0.31, 3.0), [0.05, 0.1, 0.15, 0.2, 0.25, 0.3]);
        assert_eq!(ticks(3.0, 3.0, 3.0), [0.0; 0]);
        assert_eq!(ticks(f64::NAN, 3.0, 3.0), [0.0; 0]);
    }
}
