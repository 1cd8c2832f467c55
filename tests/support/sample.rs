//! Samples of long lists of cases: a run takes some of them, another commit's run takes others, and `BRICKYARD_CASES=all` takes all.
//!
//! The seed is `BRICKYARD_SEED`, which `tools/test` sets to the commit's number and prints; without it, 0. A case that has failed is put
//! beside its list, to be taken by every run.

use crate::Random;

/// What picks the samples of this run.
///
/// # Panics
/// If `BRICKYARD_SEED` is not a hexadecimal number.
pub fn seed() -> u64 {
    std::env::var("BRICKYARD_SEED")
        .map_or(0, |text| u64::from_str_radix(&text, 16).expect("BRICKYARD_SEED is a hexadecimal number"))
}

/// Whether every case is taken.
pub fn takes_all() -> bool {
    std::env::var("BRICKYARD_CASES").is_ok_and(|text| text == "all")
}

/// The places of the cases that a run takes of a list: every one in so many, or all.
pub fn sampled(list: &str, count: usize, one_in: usize) -> Vec<usize> {
    places(list, count, if takes_all() { count } else { count.div_ceil(one_in) })
}

/// Places of `wanted` of `count` cases, ascending: one in each of as many equal parts of the list, anywhere inside. `list` names the list,
/// so that those of equal length are sampled independently.
pub fn places(list: &str, count: usize, wanted: usize) -> Vec<usize> {
    let wanted = wanted.min(count);
    let mut random = random(list);
    let at = |part: usize| part * count / wanted;
    (0..wanted).map(|part| at(part) + (random.unit() * (at(part + 1) - at(part)) as f64) as usize).collect()
}

/// Whether a run takes this case: one in so many does.
pub fn takes(case: &str, one_in: u64) -> bool {
    takes_all() || random(case).bits().is_multiple_of(one_in)
}

/// Numbers that are others for each name and seed.
fn random(name: &str) -> Random {
    Random(seed() ^ name.bytes().fold(0u64, |hash, byte| hash.wrapping_mul(31).wrapping_add(u64::from(byte))))
}

#[cfg(test)]
mod tests {
    use super::places;

    #[test]
    fn each_part_of_a_list_gives_one_case() {
        for (count, wanted) in [(10, 3), (7, 7), (5, 9), (1000, 999), (3, 1)] {
            let places = places("a list", count, wanted);
            assert_eq!(places.len(), wanted.min(count));
            assert!(places.is_sorted_by(|a, b| a < b) && places.iter().all(|&place| place < count), "{places:?}");
        }
    }
}
