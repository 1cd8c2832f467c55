//! JPEG kinds of strips and tiles, by their first bytes: the library mistakes unsupported kinds for damage.

/// Returns the kind of an unsupported JPEG: any but baseline, extended and progressive. `None` also without a frame.
pub(super) fn kind_not_read(jpeg: &[u8]) -> Option<&'static str> {
    match frame_marker(jpeg)? {
        0xc0..=0xc2 => None,
        0xc3 => Some("lossless"),
        0xc9.. => Some("arithmetic-coded"),
        _ => Some("hierarchical"),
    }
}

/// The marker at the start of a JPEG's frame, which gives its kind; `None` if missing.
fn frame_marker(jpeg: &[u8]) -> Option<u8> {
    let mut at = 2;
    loop {
        let &[0xff, marker, high, low] = jpeg.get(at..)?.first_chunk()? else { return None };
        match marker {
            0xff => at += 1,
            0xc4 | 0xc8 | 0xcc => at += 2 + usize::from(u16::from_be_bytes([high, low])),
            0xc0..=0xcf => return Some(marker),
            0x01 | 0xd0..=0xd8 => at += 2,
            0xd9 | 0xda => return None,
            _ => at += 2 + usize::from(u16::from_be_bytes([high, low])),
        }
    }
}
