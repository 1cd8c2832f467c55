//! Numbers with their nouns, for messages.

/// Formats a number and its noun: `1 step`, `2 steps`, `0 steps`, `3 axes`.
pub fn counted(n: u64, noun: &str) -> String {
    match noun.strip_suffix("is") {
        _ if n == 1 => format!("1 {noun}"),
        Some(stem) => format!("{n} {stem}es"),
        None => format!("{n} {noun}s"),
    }
}

/// The verb after so many: `is` or `are`.
pub fn are(n: u64) -> &'static str {
    if n == 1 { "is" } else { "are" }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_is_not_many() {
        assert_eq!([0, 1, 2].map(|n| counted(n, "step")), ["0 steps", "1 step", "2 steps"]);
        assert_eq!([0, 1, 2].map(|n| counted(n, "axis")), ["0 axes", "1 axis", "2 axes"]);
        assert_eq!([0, 1, 2].map(are), ["are", "is", "are"]);
    }
}
