//! BloscLZ, Blosc's own compressor, after FastLZ: runs of bytes, and references up to 73,727 bytes back.

/// Largest distance told in thirteen bits; farther ones follow in two bytes.
const NEAR: usize = 8191;

/// Decodes a stream into `out` and returns the number of bytes; `None` if it is damaged or longer.
pub(crate) fn decode(stream: &[u8], out: &mut [u8]) -> Option<usize> {
    let mut rest = stream;
    let mut written = 0;
    // Upper bits of the first control byte, which is of a run, are the format's version.
    let mut control = next(&mut rest)? & 31;
    loop {
        if control < 32 {
            let (run, after) = rest.split_at_checked(usize::from(control) + 1)?;
            out.get_mut(written..)?.get_mut(..run.len())?.copy_from_slice(run);
            (written, rest) = (written + run.len(), after);
        } else {
            let (back, length) = reference(control, &mut rest)?;
            let start = written.checked_sub(back)?;
            if length > out.len() - written {
                return None;
            }
            // A reference may reach into its own output.
            for at in 0..length {
                out[written + at] = out[start + at];
            }
            written += length;
        }
        match next(&mut rest) {
            Some(byte) => control = byte,
            None => return Some(written),
        }
    }
}

fn next(rest: &mut &[u8]) -> Option<u8> {
    let (first, after) = rest.split_first()?;
    *rest = after;
    Some(*first)
}

/// Distance and length of a reference.
fn reference(control: u8, rest: &mut &[u8]) -> Option<(usize, usize)> {
    let mut length = usize::from(control >> 5) + 2;
    if control >> 5 == 7 {
        loop {
            let more = next(rest)?;
            length = length.checked_add(more.into())?;
            if more < 255 {
                break;
            }
        }
    }
    let (high, low) = (usize::from(control & 31) << 8, usize::from(next(rest)?));
    if high + low < NEAR {
        return Some((high + low + 1, length));
    }
    let far = usize::from(next(rest)?) << 8 | usize::from(next(rest)?);
    Some((far + NEAR + 1, length))
}

#[cfg(test)]
mod tests {
    use super::decode;

    #[test]
    fn runs_and_references_are_copied() {
        let decoded = |stream: &[u8], length: usize| {
            let mut out = vec![0; length];
            decode(stream, &mut out).map(|count| out[..count].to_vec())
        };
        // "abc" (with a version in the upper bits), 4 bytes from 3 back, 9 + 255 + 2 from 1 back, "d".
        let stream = [0x22, b'a', b'b', b'c', 2 << 5, 2, 7 << 5, 255, 2, 0, 0, b'd'];
        let expected = [&b"abcabca"[..], &[b'a'; 266], b"d"].concat();
        assert_eq!(decoded(&stream, 400), Some(expected));
        assert_eq!(decoded(&stream, 100), None, "longer than told");
        for length in [0, 3, 5, 8, 9, 11] {
            assert_eq!(decoded(&stream[..length], 400), None, "{length}");
        }
        assert_eq!(decoded(&[0, 7, 2 << 5, 1], 9), None, "before the start");
        // 8,203 bytes, and a far reference to the second of them.
        let mut far = vec![2, 1, 2, 9, 7 << 5];
        far.extend([255; 32]);
        far.extend([31, 0, 2 << 5 | 31, 255, 0, 10]);
        let out = decoded(&far, 9000).unwrap();
        assert_eq!((out.len(), &out[8203..]), (8207, &[2, 9, 9, 9][..]));
    }
}
