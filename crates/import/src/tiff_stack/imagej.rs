//! ImageJ's looks of a hyperstack's channels: look-up tables and display ranges, in two private tags. The bytes are a head of kinds and
//! counts, in the file's byte order, then the blocks of each kind in turn.

use brickyard_volume::ChannelLook;
use tiff::tags::Tag;

/// Lengths of the head and of each block of [`METADATA`].
pub(super) const BYTE_COUNTS: Tag = Tag::Unknown(50838);

/// The head and the blocks.
pub(super) const METADATA: Tag = Tag::Unknown(50839);

/// Bytes of a look-up table: 256 of red, then of green, then of blue.
const TABLE_BYTES: usize = 768;

/// Looks of the channels; empty if missing or damaged.
pub(super) fn channel_looks(bytes: &[u8], byte_counts: &[u64]) -> Vec<ChannelLook> {
    let blocks = blocks(bytes, byte_counts).unwrap_or_default();
    let of_kind = |kind: [u8; 4]| blocks.iter().filter(move |(found, _)| *found == kind).map(|(_, block)| *block);
    let is_big = bytes.starts_with(b"IJIJ");
    let numbers: Vec<f64> = of_kind(*b"rang")
        .flat_map(|block| block.as_chunks::<8>().0)
        .map(|&number| if is_big { f64::from_be_bytes(number) } else { f64::from_le_bytes(number) })
        .collect();
    let windows: Vec<[f64; 2]> = numbers.as_chunks::<2>().0.to_vec();
    let colors: Vec<Option<[u8; 3]>> = of_kind(*b"luts").map(color_of_table).collect();
    let look = |i: usize| ChannelLook {
        name: None,
        color: colors.get(i).copied().flatten(),
        window: windows.get(i).copied().filter(|[low, high]| low.is_finite() && high.is_finite() && low < high),
        unit: None,
    };
    (0..windows.len().max(colors.len())).map(look).collect()
}

/// Splits the blocks, each with its kind as letters; `None` if the head contradicts the bytes.
fn blocks<'a>(bytes: &'a [u8], byte_counts: &[u64]) -> Option<Vec<([u8; 4], &'a [u8])>> {
    let is_big = match bytes.get(..4)? {
        b"IJIJ" => true,
        b"JIJI" => false,
        _ => return None,
    };
    let (head_bytes, block_bytes) = byte_counts.split_first()?;
    let (head, mut rest) = bytes.split_at_checked(usize::try_from(*head_bytes).ok()?)?;
    let mut lengths = block_bytes.iter();
    let mut blocks = Vec::new();
    for &[a, b, c, d, e, f, g, h] in head.get(4..)?.as_chunks::<8>().0 {
        let (kind, count) = match is_big {
            true => ([a, b, c, d], u32::from_be_bytes([e, f, g, h])),
            false => ([d, c, b, a], u32::from_le_bytes([e, f, g, h])),
        };
        for _ in 0..count {
            let (block, after) = rest.split_at_checked(usize::try_from(*lengths.next()?).ok()?)?;
            blocks.push((kind, block));
            rest = after;
        }
    }
    Some(blocks)
}

/// The colour reached from black by a look-up table in a straight line; `None` for other tables.
fn color_of_table(table: &[u8]) -> Option<[u8; 3]> {
    if table.len() != TABLE_BYTES {
        return None;
    }
    let entry = |i: usize| [table[i], table[256 + i], table[512 + i]];
    let last = entry(255);
    let is_straight = (0..256).all(|i| {
        let expected = last.map(|part| (usize::from(part) * i) as f64 / 255.0);
        // Programs round in several ways.
        entry(i).into_iter().zip(expected).all(|(found, expected)| (f64::from(found) - expected).abs() <= 1.0)
    });
    is_straight.then_some(last)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table(last: [u8; 3]) -> Vec<u8> {
        last.iter().flat_map(|&part| (0..256).map(move |i| (usize::from(part) * i / 255) as u8)).collect()
    }

    /// Metadata of two channels, and the lengths of its parts.
    fn written(is_big: bool) -> (Vec<u8>, Vec<u64>) {
        let number = |n: f64| if is_big { n.to_be_bytes() } else { n.to_le_bytes() };
        let count = |n: u32| if is_big { n.to_be_bytes() } else { n.to_le_bytes() };
        let kind = |letters: [u8; 4]| count(u32::from_be_bytes(letters));
        let ranges: Vec<u8> = [100.0, 900.0, -3.0, 65535.0].into_iter().flat_map(number).collect();
        let head =
            [kind(*b"IJIJ"), kind(*b"info"), count(1), kind(*b"rang"), count(1), kind(*b"luts"), count(2)].concat();
        let mut fire = table([255, 255, 255]);
        fire[100] = 255;
        let blocks = [b"note".to_vec(), ranges, table([0, 128, 255]), fire];
        let lengths = std::iter::once(&head).chain(&blocks).map(|block| block.len() as u64).collect();
        ([vec![head], blocks.to_vec()].concat().concat(), lengths)
    }

    #[test]
    fn colours_and_windows_are_read_in_both_byte_orders() {
        for is_big in [false, true] {
            let (bytes, counts) = written(is_big);
            let first =
                ChannelLook { name: None, color: Some([0, 128, 255]), window: Some([100.0, 900.0]), unit: None };
            // A table of several colours has no single one.
            let second = ChannelLook { name: None, color: None, window: Some([-3.0, 65535.0]), unit: None };
            assert_eq!(channel_looks(&bytes, &counts), [first, second]);
        }
    }

    #[test]
    fn damaged_metadata_say_nothing() {
        let (bytes, counts) = written(false);
        for cut in 0..bytes.len() {
            assert_eq!(channel_looks(&bytes[..cut], &counts), [], "{cut}");
        }
        for cut in 0..counts.len() {
            assert_eq!(channel_looks(&bytes, &counts[..cut]), [], "{cut}");
        }
        assert_eq!(channel_looks(&bytes, &[u64::MAX; 5]), []);
        let mut claimed = bytes.clone();
        claimed[8..12].copy_from_slice(&u32::MAX.to_le_bytes());
        assert_eq!(channel_looks(&claimed, &counts), []);
    }
}
