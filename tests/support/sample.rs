//! Samples of long lists of cases, by a seed: `BRICKYARD_SEED`, which `tools/test` sets to the commit's hash and prints, or 0.
//! `BRICKYARD_CASES=all` takes every case. A failed sample becomes a test of its own.

use crate::{Random, Way};
use brickyard::backend::BackendChoice;

/// Seed of this run's samples.
///
/// # Panics
/// If `BRICKYARD_SEED` is not a hexadecimal number.
pub fn seed() -> u64 {
    std::env::var("BRICKYARD_SEED")
        .map_or(0, |text| u64::from_str_radix(&text, 16).expect("BRICKYARD_SEED is a hexadecimal number"))
}

/// Whether this run takes every case.
pub fn takes_all() -> bool {
    std::env::var("BRICKYARD_CASES").is_ok_and(|text| text == "all")
}

/// Indices of this run's cases in a list: one in `one_in`, or all.
pub fn sampled(list: &str, count: usize, one_in: usize) -> Vec<usize> {
    places(list, count, if takes_all() { count } else { count.div_ceil(one_in) })
}

/// Indices of `wanted` of `count` cases, ascending: one from each of `wanted` equal parts of the list. Lists are sampled independently, by
/// name.
pub fn places(list: &str, count: usize, wanted: usize) -> Vec<usize> {
    let wanted = wanted.min(count);
    let mut random = random(list);
    let at = |part: usize| part * count / wanted;
    (0..wanted).map(|part| at(part) + (random.unit() * (at(part + 1) - at(part)) as f64) as usize).collect()
}

/// Whether this run draws a case, named with its way to draw: the CPU draws every case, and a GPU a third, because shaders compile slowly.
pub fn draws(case: &str, way: Way) -> bool {
    way.0 == BackendChoice::Cpu || takes_all() || random(case).bits().is_multiple_of(3)
}

/// A generator with a seed from the name and the run.
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
