//! The perceptual colour maps: their published tables of 256 colours, to 8 bits a channel (at most half of 1/255 from the
//! published numbers), red first, six hexadecimal digits a colour.
//!
//! `viridis`, `magma`, `inferno` and `plasma` are by Nathaniel Smith, Stefan van der Walt and (viridis) Eric Firing, made for
//! matplotlib and given to the public domain (CC0). `turbo` is by Anton Mikhailov, Copyright 2019 Google LLC, Apache-2.0.

/// The colours of a map; `None` if there is no such map.
pub(super) fn colors(name: &str) -> Option<Vec<[f64; 3]>> {
    let table = match name {
        "viridis" => include_str!("maps/viridis.txt"),
        "magma" => include_str!("maps/magma.txt"),
        "inferno" => include_str!("maps/inferno.txt"),
        "plasma" => include_str!("maps/plasma.txt"),
        "turbo" => include_str!("maps/turbo.txt"),
        _ => return None,
    };
    let digits: String = table.split_whitespace().collect();
    let channel = |at: usize| u8::from_str_radix(&digits[at..at + 2], 16).expect("hexadecimal digits") as f64 / 255.0;
    Some((0..digits.len()).step_by(6).map(|at| [channel(at), channel(at + 2), channel(at + 4)]).collect())
}
