//! Exif data of a picture: the orientation alone. Damaged data have none, since nothing else is taken from them.

/// Orientation in the first directory.
const ORIENTATION: u16 = 274;
/// Type of a 16-bit number.
const SHORT: u16 = 3;
const ENTRY_BYTES: usize = 12;

/// Finds the orientation, 1 to 8, in data that start like a TIFF file.
pub(super) fn orientation(data: &[u8]) -> Option<u16> {
    let big = match data.get(..4)? {
        b"II*\0" => false,
        b"MM\0*" => true,
        _ => return None,
    };
    let short = |at: usize| {
        let bytes = *data.get(at..)?.first_chunk()?;
        Some(if big { u16::from_be_bytes(bytes) } else { u16::from_le_bytes(bytes) })
    };
    let long = *data.get(4..)?.first_chunk()?;
    let start = if big { u32::from_be_bytes(long) } else { u32::from_le_bytes(long) } as usize;
    let entries = usize::from(short(start)?);
    let entry_at = |i: usize| start.checked_add(2 + i * ENTRY_BYTES);
    let found = (0..entries).map_while(entry_at).find(|&at| short(at) == Some(ORIENTATION))?;
    let value = short(found + 8).filter(|_| short(found + 2) == Some(SHORT))?;
    (1..=8).contains(&value).then_some(value)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_orientation_is_found_in_both_byte_orders() {
        let little = b"II*\0\x08\0\0\0\x02\0\x0f\x01\x02\0\x01\0\0\0A\0\0\0\x12\x01\x03\0\x01\0\0\0\x06\0\0\0";
        let big = b"MM\0*\0\0\0\x08\0\x01\x01\x12\0\x03\0\0\0\x01\0\x08\0\0";
        assert_eq!((orientation(little), orientation(big)), (Some(6), Some(8)));
        for end in 0..little.len() - 3 {
            assert_eq!(orientation(&little[..end]), None, "{end}");
        }
        let mut far = little.to_vec();
        far[4..8].fill(0xff);
        assert_eq!(orientation(&far), None);
    }
}
