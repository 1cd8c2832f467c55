//! The transfer table on the GPU: places so dense that the nearest one suffices, instead of the volume crate's
//! interpolated entries. A sample then costs one load of 8 bytes and one power less: opacity is stored as the argument
//! of an exponential.

use brickyard_volume::compositing::OPAQUE;
use brickyard_volume::jitter::{self, BLUE_EDGE};
use brickyard_volume::{Mode, Needs, SlotFormat, TransferGrid, TransferTable};

/// Contents of a table's places.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Places {
    /// Media: a colour of 32 bits, and a depth for an exponential.
    Media,
    /// A projection's colours, of 63 bits, so that rounding never shows in a value's colour; and one bit for any
    /// opacity.
    Colors,
}

impl Places {
    pub(crate) fn of(mode: Mode) -> Self {
        if mode.is_projection() { Self::Colors } else { Self::Media }
    }
}

const PLACE_BYTES: u64 = size_of::<[u32; 2]>() as u64;

pub(crate) const COMBINED: SlotFormat = SlotFormat::U16;

/// The most places of a transfer table, after the first. 8-bit codes have 64 per code: where a table jumps from clear
/// to opaque within a code, the nearest place is off by less than 2/255 in one sample; 16-bit codes are as dense
/// already.
fn most_places(codes: SlotFormat) -> u32 {
    match codes {
        SlotFormat::U8 => 255 * 64,
        SlotFormat::U16 | SlotFormat::F32 => 65535,
    }
}

/// Returns the index of the last place of a transfer table; each entry has a whole number of places.
pub(crate) fn last_place(table: &TransferTable, codes: SlotFormat) -> u32 {
    let last = table.last_entry() as u32;
    last * places_per_entry(last, codes)
}

fn places_per_entry(last_entry: u32, codes: SlotFormat) -> u32 {
    (most_places(codes) / last_entry).max(1)
}

/// Channels of running integrals: three of colour, and depth.
const CHANNELS: u64 = 4;

/// Size of the mask, in places.
const MASK_PLACES: u32 = (BLUE_EDGE * BLUE_EDGE) as u32 / PLACE_BYTES as u32;

/// The capacity of a transfer table's buffer: places, running integrals if wanted, the mask of
/// [jitter](brickyard_volume::jitter), and entries over values and gradients if wanted, in this order.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct TableCapacity {
    pub(crate) codes: SlotFormat,
    pub(crate) has_integrals: bool,
    pub(crate) has_grid: bool,
}

impl TableCapacity {
    pub(crate) fn new(codes: SlotFormat, needs: &Needs) -> Self {
        Self { codes, has_integrals: needs.is_pre_integrated, has_grid: needs.has_grid }
    }

    /// The capacity without integrals and without entries over gradients.
    pub(crate) fn of_places(codes: SlotFormat) -> Self {
        Self { codes, has_integrals: false, has_grid: false }
    }

    pub(crate) fn bytes(&self) -> u64 {
        let entries = if self.has_grid { TransferGrid::MOST_ROWS * TransferGrid::COLUMNS } else { 0 };
        (self.grid_at() as u64 + entries as u64) * PLACE_BYTES
    }

    /// The bytes of the buffer and of the staging memory for its upload.
    pub(crate) fn bytes_staged(&self) -> u64 {
        2 * self.bytes()
    }

    /// Returns the start of the jitter mask, in places of 8 bytes.
    pub(crate) fn mask_at(&self) -> u32 {
        let sums = if self.has_integrals { TransferTable::most_entries(self.codes) as u64 * CHANNELS } else { 0 };
        most_places(self.codes) + 1 + sums as u32
    }

    /// Returns the start of the entries over values and gradients, in places of 8 bytes.
    pub(crate) fn grid_at(&self) -> u32 {
        self.mask_at() + MASK_PLACES
    }
}

/// Returns the words of a transfer table's buffer in pairs: places; for each entry the low and high word of each running
/// integral; unused room; the jitter mask, one byte per threshold; entries over values and gradients, colour and opacity.
/// And the value of 1 in the low word of a running integral.
pub(crate) fn words(table: &TransferTable, room: TableCapacity, holds: Places) -> (Vec<[u32; 2]>, f32) {
    let mut words = places(table, room.codes, holds);
    let mut sum_unit = 0.0;
    if room.has_integrals {
        let integrals = table.integrals();
        let total = integrals.sums().last().map_or(0.0, |sums| sums[3]);
        // Differences of 64-bit integers are exact anywhere along the table.
        sum_unit = (total / (1u64 << 62) as f64).max(f32::MIN_POSITIVE as f64) as f32;
        for sum in integrals.sums().iter().flatten() {
            let count = (sum / sum_unit as f64) as u64;
            words.push([count as u32, (count >> 32) as u32]);
        }
    }
    words.resize(room.mask_at() as usize, [0; 2]);
    words.extend(mask());
    if let Some(grid) = table.grid.as_ref().filter(|_| room.has_grid) {
        words.extend(grid.entries.iter().map(|&[r, g, b, alpha]| [pack_color([r, g, b]), alpha.to_bits()]));
    }
    (words, sum_unit)
}

/// The mask's words, lowest bytes first.
fn mask() -> impl Iterator<Item = [u32; 2]> {
    let word = |bytes: &[u8]| bytes.iter().rev().fold(0, |word, &byte| word << 8 | byte as u32);
    jitter::blue_mask().chunks(8).map(move |chunk| [word(&chunk[..4]), word(&chunk[4..])])
}

pub(crate) fn places(table: &TransferTable, codes: SlotFormat, holds: Places) -> Vec<[u32; 2]> {
    let last = last_place(table, codes);
    let medium = |[r, g, b, alpha]: [f32; 4]| {
        let depth = (-(1.0 - alpha as f64).log2()).min(OPAQUE) as f32;
        [pack_color([r, g, b]), depth.to_bits()]
    };
    let per_entry = places_per_entry(table.last_entry() as u32, codes);
    let place = |i: u32| match holds {
        Places::Media => medium(table.lookup(i as f32 / last as f32)),
        // An unchanged entry.
        Places::Colors if i.is_multiple_of(per_entry) => pack_exactly(table.entries[(i / per_entry) as usize]),
        Places::Colors => pack_exactly(table.lookup(i as f32 / last as f32)),
    };
    (0..=last).map(place).collect()
}

/// 21 bits for each colour channel, from the lowest, and one for any opacity.
fn pack_exactly([r, g, b, alpha]: [f32; 4]) -> [u32; 2] {
    let part = |part: f32| (f64::from(part.clamp(0.0, 1.0)) * 2_097_151.0).round() as u64;
    let word = part(r) | part(g) << 21 | part(b) << 42 | u64::from(alpha > 0.0) << 63;
    [word as u32, (word >> 32) as u32]
}

/// 11, 11 and 10 bits, from the lowest: within an eighth of a display code.
fn pack_color(rgb: [f32; 3]) -> u32 {
    let [r, g, b] = [0, 1, 2].map(|k| (rgb[k].clamp(0.0, 1.0) * [2047.0, 2047.0, 1023.0][k]).round() as u32);
    r | g << 11 | b << 22
}

#[cfg(test)]
mod tests {
    use super::*;
    use brickyard_volume::{SlotEncoding, TransferFunction, VoxelType};

    #[test]
    fn places_say_what_the_table_says() {
        for codes in [SlotFormat::U8, SlotFormat::U16] {
            let entries = (0..=codes.max_code()).map(|i| i as f32 / codes.max_code() as f32);
            let table = TransferTable::from_entries(entries.map(|t| [t, 1.0 - t, t * t, t]).collect(), 1.0);
            let colors = places(&table, codes, Places::Colors);
            let places = places(&table, codes, Places::Media);
            assert_eq!(places.len() as u32 - 1, most_places(codes), "one entry a code");
            for has_integrals in [false, true] {
                let room = TableCapacity { codes, has_integrals, has_grid: false };
                assert_eq!(words(&table, room, Places::Media).0.len() as u64 * 8, room.bytes());
            }
            for (i, ([color, depth], exact)) in places.iter().zip(&colors).enumerate() {
                let [r, g, b, alpha] = table.lookup(i as f32 / most_places(codes) as f32);
                let unpacked = [color & 2047, color >> 11 & 2047, color >> 22].map(|c| c as f32);
                // Half a step of each component's bits.
                assert!((unpacked[0] / 2047.0 - r).abs() < 0.0003 && (unpacked[1] / 2047.0 - g).abs() < 0.0003);
                assert!((unpacked[2] / 1023.0 - b).abs() < 0.0005);
                let exact = u64::from(exact[0]) | u64::from(exact[1]) << 32;
                for (k, part) in [r, g, b].into_iter().enumerate() {
                    assert!(((exact >> (21 * k) & 0x1f_ffff) as f64 / 2_097_151.0 - f64::from(part)).abs() < 3e-7);
                }
                assert_eq!(exact >> 63 == 1, alpha > 0.0);
                // The depth is rounded to f32 once; near 1 the remaining light is a small difference.
                assert!(((-f32::from_bits(*depth)).exp2() - (1.0 - alpha)).abs() < 1e-6, "{i}: {alpha}");
            }
            assert_eq!(f32::from_bits(places[0][1]), 0.0, "clear stays clear");
            assert_eq!((-f32::from_bits(places[places.len() - 1][1]) * 1e-9).exp2(), 0.0, "opaque stays opaque");
        }
    }

    #[test]
    fn entries_over_values_and_gradients_fit_their_room() {
        for voxel_type in [VoxelType::U8, VoxelType::U16] {
            let encoding = SlotEncoding::new(voxel_type, (0.0, 1.0), false);
            let transfer = TransferFunction {
                opacity: vec![[0.0, 0.0], [encoding.high, 1.0]],
                gradient_opacity: vec![[0.0, 0.5], [9.0, 1.0]],
                ..TransferFunction::default()
            };
            let table = TransferTable::new(&transfer, &encoding);
            let room = TableCapacity { codes: encoding.format, has_integrals: true, has_grid: true };
            let (words, _) = words(&table, room, Places::Media);
            let (entries, grid) = (&words[room.grid_at() as usize..], table.grid.unwrap());
            // A row for each code, and room for the most rows.
            let left = (TransferGrid::MOST_ROWS - grid.rows()) * TransferGrid::COLUMNS;
            assert_eq!((words.len() + left) as u64 * 8, room.bytes(), "values of all codes fill it");
            assert_eq!(grid.rows(), [256, TransferGrid::MOST_ROWS][usize::from(voxel_type == VoxelType::U16)]);
            for (word, entry) in entries.iter().zip(&grid.entries) {
                assert_eq!([word[0], word[1]], [pack_color([1.0; 3]), entry[3].to_bits()]);
            }
        }
    }
}
