//! Suggestions for misspelt names. Costs a table row for each known name.

/// `, did you mean '...'?` for the known name with the fewest edits, if they are few.
pub fn hint<'a>(name: &str, known: impl Iterator<Item = &'a str>) -> String {
    let lower = name.to_lowercase();
    let nearest = known.map(|k| (edits(&lower, &k.to_lowercase()), k)).min();
    let near = nearest.filter(|(edits, k)| 2 * edits <= k.chars().count());
    near.map_or(String::new(), |(_, k)| format!(", did you mean '{k}'?"))
}

/// Letters to insert, remove or replace to turn one word into the other (Levenshtein's distance).
fn edits(from: &str, to: &str) -> usize {
    let to: Vec<char> = to.chars().collect();
    let mut row: Vec<usize> = (0..=to.len()).collect();
    for (i, a) in from.chars().enumerate() {
        let mut diagonal = row[0];
        row[0] = i + 1;
        for (j, b) in to.iter().enumerate() {
            let replaced = diagonal + usize::from(a != *b);
            diagonal = row[j + 1];
            row[j + 1] = replaced.min(row[j] + 1).min(diagonal + 1);
        }
    }
    row[to.len()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_name_is_suggested() {
        assert_eq!([edits("gray", "grey"), edits("", "abc"), edits("kitten", "sitting")], [1, 3, 3]);
        let known = || ["gray", "ct-bone"].into_iter();
        assert_eq!(hint("CT_Bone", known()), ", did you mean 'ct-bone'?");
        assert_eq!(hint("bone", known()), ", did you mean 'ct-bone'?");
        assert_eq!(hint("sepia", known()), "");
    }
}
