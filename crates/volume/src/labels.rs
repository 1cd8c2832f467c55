//! The look of labels: visibility and colours. A label is a number naming a thing, such as an organ or a cell; nothing lies between two
//! labels, so they are never interpolated.
//!
//! Colours are hashed from the labels: a label has the same colour in every picture of every store, without a table of all labels. Label 0
//! is the hidden background.

use crate::slot_encoding::SlotEncoding;
use serde::{Deserialize, Serialize};

/// The label of no particular thing: hidden unless requested.
pub const BACKGROUND: i64 = 0;

/// The label of a value; `None` for fractions, infinities and NaN among floats, which are none.
pub fn label_of(value: f64) -> Option<i64> {
    (value.fract() == 0.0).then_some(value as i64)
}

/// Number of hashed colours.
pub const HASHED_COLORS: u32 = 1 << 15;

/// The look of a layer's labels.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct LabelLook {
    /// The shown labels; `None` shows all but [`BACKGROUND`].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub shown: Option<Vec<i64>>,
    /// Colours of labels, sorted by label; the other labels have [hashed](hashed_color) ones. With `None` the transfer function colours all
    /// labels by their numbers.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub colors: Option<Vec<LabelColor>>,
}

/// The colour of one label.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LabelColor {
    /// The label.
    pub label: i64,
    /// Red, green and blue, each in 0..=1, display-referred.
    pub color: [f64; 3],
}

impl LabelLook {
    /// The look of labels with hashed colours, all but the background shown.
    pub fn hashed() -> Self {
        Self { shown: None, colors: Some(Vec::new()) }
    }

    /// Whether a label is shown.
    pub fn shows(&self, label: i64) -> bool {
        self.shown.as_ref().map_or(label != BACKGROUND, |shown| shown.contains(&label))
    }

    /// Whether any label from `low` to `high` is shown; both may be infinite.
    pub fn shows_between(&self, low: f64, high: f64) -> bool {
        let is_between = |label: i64| (low..=high).contains(&(label as f64));
        match &self.shown {
            Some(shown) => shown.iter().any(|&label| is_between(label)),
            None => {
                low.ceil() <= high.floor() && (low.ceil() != BACKGROUND as f64 || high.floor() != BACKGROUND as f64)
            }
        }
    }

    /// The colour of a label; `None` if the transfer function gives it one.
    pub fn color(&self, label: i64) -> Option<[f64; 3]> {
        let colors = self.colors.as_ref()?;
        let own = colors.binary_search_by_key(&label, |entry| entry.label).map(|i| colors[i].color);
        Some(own.unwrap_or_else(|_| hashed_color(color_index(label))))
    }

    /// The first colour outside 0..=1 or out of order: its index, and the problem.
    pub(crate) fn bad_color(&self) -> Option<(usize, String)> {
        let colors = self.colors.as_deref().unwrap_or_default();
        colors.iter().enumerate().find_map(|(index, LabelColor { label, color })| {
            let before = index.checked_sub(1).map(|before| colors[before].label).filter(|before| before >= label);
            let disorder =
                before.map(|before| format!("label {label} comes after {before}: sort the colours by label"));
            let is_color = color.iter().all(|part| (0.0..=1.0).contains(part));
            let outside = (!is_color).then(|| format!("{color:?} is outside 0..1"));
            Some((index, outside.or(disorder)?))
        })
    }
}

/// 16-bit codes of labels further apart than 16 bits reach. A label named by its look has its own code; the others share the codes of their
/// hashed colours, which suffice because they are shown or hidden together.
#[derive(Clone, Debug, Default, PartialEq, Eq, Hash)]
pub struct LabelCodes {
    /// The labels with codes of their own, from 1 on; sorted.
    named: Vec<i64>,
}

/// The first code of unnamed labels.
const FIRST_HASHED: u32 = 1 << 15;

impl LabelCodes {
    /// The most labels with codes of their own.
    pub const MOST: usize = FIRST_HASHED as usize - 1;

    /// Returns the codes for labels of this look; `None` if it names more than [`LabelCodes::MOST`] labels.
    pub fn of(look: &LabelLook) -> Option<Self> {
        let shown = look.shown.iter().flatten().copied();
        let colored = look.colors.iter().flatten().map(|entry| entry.label);
        let mut named: Vec<i64> = shown.chain(colored).filter(|&label| label != BACKGROUND).collect();
        named.sort_unstable();
        named.dedup();
        (named.len() <= Self::MOST).then_some(Self { named })
    }

    /// The code of a label; 0 for the background.
    pub fn code(&self, label: i64) -> u16 {
        if label == BACKGROUND {
            return 0;
        }
        match self.named.binary_search(&label) {
            Ok(place) => (place + 1) as u16,
            Err(_) => (FIRST_HASHED + color_index(label)) as u16,
        }
    }

    /// Encodes little-endian voxels of labels, with `encoding`'s type and no-data value, into 16-bit codes. Costs a search among the named
    /// labels for each voxel unlike its predecessor.
    ///
    /// # Panics
    /// If the two lengths do not hold the same number of voxels.
    pub fn encode(&self, encoding: &SlotEncoding, voxels: &[u8], codes: &mut [u8]) {
        let SlotEncoding { voxel_type, nodata, .. } = *encoding;
        assert_eq!(voxels.len() / voxel_type.bytes(), codes.len() / 2);
        let nodata = nodata.map(|value| value.round() as i64);
        let mut last = (BACKGROUND, 0);
        for (i, code) in codes.chunks_exact_mut(2).enumerate() {
            let label = voxel_type.read(voxels, i).round() as i64;
            if label != last.0 {
                // No data is hidden, like the background.
                last = (label, self.code(if nodata == Some(label) { BACKGROUND } else { label }));
            }
            code.copy_from_slice(&last.1.to_le_bytes());
        }
    }

    /// Decodes a code.
    pub fn coded(&self, code: u32) -> Coded {
        match code.checked_sub(FIRST_HASHED) {
            Some(color) => Coded::Color(color),
            None if code == 0 => Coded::Label(BACKGROUND),
            None => self.named.get(code as usize - 1).map_or(Coded::Nothing, |&label| Coded::Label(label)),
        }
    }
}

/// The meaning of one of [`LabelCodes`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Coded {
    /// One label.
    Label(i64),
    /// All unnamed labels with this hashed colour.
    Color(u32),
    /// No label has the code.
    Nothing,
}

/// Index of a label's colour among the [`HASHED_COLORS`]: the upper bits of its lower 32, mixed by the finaliser of MurmurHash3.
pub fn color_index(label: i64) -> u32 {
    let mut hash = label as u32;
    hash = (hash ^ (hash >> 16)).wrapping_mul(0x85eb_ca6b);
    hash = (hash ^ (hash >> 13)).wrapping_mul(0xc2b2_ae35);
    (hash ^ (hash >> 16)) >> 17
}

/// A hashed colour: bright, far from gray, and of any hue, to stand out from the background and from an image behind it.
pub fn hashed_color(index: u32) -> [f64; 3] {
    // Eleven bits of hue, two of saturation, two of brightness.
    let hue = f64::from(index >> 4) / 2048.0 * 6.0;
    let saturation = 0.55 + 0.15 * f64::from(index >> 2 & 3);
    let brightness = 0.7 + 0.1 * f64::from(index & 3);
    // From hue, saturation and value: each part's distance from its own hue on the circle.
    [5.0, 3.0, 1.0].map(|part: f64| {
        let along = (part + hue).rem_euclid(6.0);
        brightness * (1.0 - saturation * along.min(4.0 - along).clamp(0.0, 1.0))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::voxel_type::VoxelType;
    use std::collections::HashSet;

    #[test]
    fn hashed_colours_stay_and_tell_labels_apart() {
        // Fixed for good: these are in users' pictures.
        assert_eq!([1, 2, 3, 70_000, 4_000_000_000].map(color_index), [10_407, 6_266, 17_144, 8_630, 30_084]);
        let near: HashSet<u32> = (1..=256).map(color_index).collect();
        assert!(near.len() > 250, "{}", near.len());
        for index in (0..HASHED_COLORS).step_by(7) {
            let color = hashed_color(index);
            let (least, most) = color.iter().fold((1.0f64, 0.0f64), |(a, b), &c| (a.min(c), b.max(c)));
            assert!((0.7 - 1e-9..=1.0).contains(&most) && most - least > 0.35, "{index}: {color:?}");
        }
    }

    #[test]
    fn the_background_is_hidden_unless_it_is_asked_for() {
        let all = LabelLook::hashed();
        assert!(!all.shows(0) && all.shows(-1) && all.shows(u32::MAX.into()));
        assert!(!all.shows_between(-0.5, 0.5) && all.shows_between(-0.5, 1.0) && !all.shows_between(1.2, 1.8));
        assert!(all.shows_between(f64::NEG_INFINITY, 0.0));
        let some = LabelLook { shown: Some(vec![0, 7]), ..all };
        assert!(some.shows(0) && some.shows(7) && !some.shows(3));
        assert!(some.shows_between(6.5, 8.0) && !some.shows_between(1.0, 6.0));
    }

    #[test]
    fn named_labels_have_codes_of_their_own() {
        let colors = vec![LabelColor { label: 70_001, color: [0.0; 3] }];
        let look = LabelLook { shown: Some(vec![4_000_000_000, 70_001, 0]), colors: Some(colors) };
        let codes = LabelCodes::of(&look).unwrap();
        assert_eq!([0, 70_001, 4_000_000_000].map(|label| codes.code(label)), [0, 1, 2]);
        for label in [0, 70_001, 4_000_000_000] {
            assert_eq!(codes.coded(codes.code(label).into()), Coded::Label(label));
        }
        assert_eq!(codes.coded(codes.code(70_000).into()), Coded::Color(color_index(70_000)));
        assert_eq!(codes.coded(3), Coded::Nothing);
        let many = LabelLook { shown: Some((1..=LabelCodes::MOST as i64 + 1).collect()), colors: None };
        assert_eq!(LabelCodes::of(&many), None);
    }

    #[test]
    fn voxels_are_encoded_label_by_label_and_no_data_as_the_background() {
        let look = LabelLook { shown: Some(vec![-70_000]), colors: None };
        let codes = LabelCodes::of(&look).unwrap();
        let encoding = SlotEncoding::of_labels(VoxelType::I32, (-70_000.0, 2e9), false, Some(9.0));
        assert!(encoding.is_hashed);
        let labels = [9i32, 9, -70_000, -70_000, 0, 5, 9, 2_000_000_000];
        let voxels: Vec<u8> = labels.iter().flat_map(|label| label.to_le_bytes()).collect();
        let mut found = [0; 16];
        codes.encode(&encoding, &voxels, &mut found);
        let found: Vec<u16> = found.chunks_exact(2).map(|code| u16::from_le_bytes([code[0], code[1]])).collect();
        assert_eq!(found, [0, 0, 1, 1, 0, codes.code(5), 0, codes.code(2_000_000_000)]);
        assert!(codes.code(5) >= FIRST_HASHED as u16);
    }

    #[test]
    fn labels_have_their_own_colours_else_hashed_ones() {
        let own = vec![LabelColor { label: 3, color: [1.0, 0.0, 0.0] }, LabelColor { label: 9, color: [0.0; 3] }];
        let look = LabelLook { shown: None, colors: Some(own.clone()) };
        assert_eq!([look.color(3), look.color(4)], [Some([1.0, 0.0, 0.0]), Some(hashed_color(color_index(4)))]);
        assert_eq!(LabelLook::default().color(3), None);
        assert_eq!(look.bad_color(), None);
        let swapped = LabelLook { shown: None, colors: Some(vec![own[1], own[0]]) };
        assert!(swapped.bad_color().is_some_and(|(i, problem)| i == 1 && problem.contains("label 3 comes after 9")));
        let bright = LabelLook { shown: None, colors: Some(vec![LabelColor { label: 1, color: [1.5, 0.0, 0.0] }]) };
        assert!(bright.bad_color().is_some_and(|(i, problem)| i == 0 && problem.contains("outside")));
    }
}
