//! Fragments of encapsulated frames: the items of pixel data, by a table of offsets, their number, or the markers of their codec. Costs 8 bytes an
//! item; without a table some more, if frames are in several fragments.

use crate::error::{ImportError, Result};
use brickyard_volume::counted;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::Path;

/// First bytes and lengths, in bytes.
pub(super) type Ranges = Vec<(u64, u64)>;

/// Bytes looked at on either end of a fragment: a frame's longest start, and its end before some padding.
const LOOKED_AT: usize = 16;

/// The last marker of JPEG and JPEG 2000, which neither has within its data.
const END: &[u8] = b"\xff\xd9";

/// Places of the fragments of each frame in encapsulated pixel data: items, the first of which is a table of offsets. Frames begin with one of
/// `starts`, if there are any.
pub(super) fn fragment_places(path: &Path, count: u64, start: u64, starts: &[&[u8]]) -> Result<Vec<Ranges>> {
    let mut file = File::open(path).map_err(ImportError::io(path))?;
    let end = file.metadata().map_err(ImportError::io(path))?.len();
    let mut items = Vec::new();
    let mut position = start;
    loop {
        let mut head = [0; 8];
        let cut = |needed: u64| {
            let problem =
                format!("cut short: its pixel data go on past byte {needed}, found {end}; fetch the file again");
            ImportError::invalid(path, problem)
        };
        if position + 8 > end {
            return Err(cut(position + 8));
        }
        file.seek(SeekFrom::Start(position)).and_then(|_| file.read_exact(&mut head)).map_err(ImportError::io(path))?;
        let length = u32::from_le_bytes([head[4], head[5], head[6], head[7]]) as u64;
        match head[..4] {
            [0xfe, 0xff, 0x00, 0xe0] if position + 8 + length > end => return Err(cut(position + 8 + length)),
            [0xfe, 0xff, 0x00, 0xe0] => items.push((position + 8, length)),
            [0xfe, 0xff, 0xdd, 0xe0] => break,
            _ => {
                let problem =
                    format!("its pixel data are damaged: no item begins at byte {position}; fetch the file again");
                return Err(ImportError::invalid(path, problem));
            }
        }
        position += 8 + length;
    }
    let Some((table, fragments)) = items.split_first() else {
        return Err(ImportError::invalid(path, "its pixel data hold no item; fetch the file again"));
    };
    if count == 1 && !fragments.is_empty() {
        return Ok(vec![fragments.to_vec()]);
    }
    if fragments.len() as u64 == count {
        return Ok(fragments.iter().map(|f| vec![*f]).collect());
    }
    let offsets = read_ranges(path, std::slice::from_ref(table))?;
    let (offsets, _) = offsets.as_chunks::<4>();
    if offsets.is_empty()
        && let Some(frames) = told_by_markers(path, &mut file, count, fragments, starts)?
    {
        return Ok(frames);
    }
    if offsets.len() as u64 != count {
        let (frames, offsets) = (counted(count, "frame"), counted(offsets.len() as u64, "offset"));
        let fragments = counted(fragments.len() as u64, "fragment");
        let problem = format!(
            "has {frames} in {fragments}, and a table of {offsets}: fragments cannot be assigned to frames; write it again"
        );
        return Err(ImportError::invalid(path, problem));
    }
    // Offsets count from the first fragment's item.
    let base = table.0 + table.1;
    let starts: Vec<u64> = offsets.iter().map(|o| base + u32::from_le_bytes(*o) as u64 + 8).collect();
    let of_frame = |i: usize| {
        let next = starts.get(i + 1).copied().unwrap_or(u64::MAX);
        fragments.iter().copied().filter(|f| (starts[i]..next).contains(&f.0)).collect()
    };
    Ok((0..starts.len()).map(of_frame).collect())
}

/// The fragments of each frame by their first and last bytes: `None` unless every frame begins and ends where a fragment does, and they are as
/// many as the header says.
fn told_by_markers(
    path: &Path,
    file: &mut File,
    count: u64,
    fragments: &[(u64, u64)],
    starts: &[&[u8]],
) -> Result<Option<Vec<Ranges>>> {
    let mut frames: Vec<Ranges> = Vec::new();
    let mut is_ended = true;
    for &(first, length) in fragments {
        let [mut head, mut tail] = [[0; LOOKED_AT]; 2];
        let looked_at = length.min(LOOKED_AT as u64);
        let (head, tail) = (&mut head[..looked_at as usize], &mut tail[..looked_at as usize]);
        let read = file.seek(SeekFrom::Start(first)).and_then(|_| file.read_exact(head));
        let read = read.and_then(|()| file.seek(SeekFrom::Start(first + length - looked_at)));
        read.and_then(|_| file.read_exact(tail)).map_err(ImportError::io(path))?;
        let is_start = starts.iter().any(|start| head.starts_with(start));
        match frames.last_mut() {
            // The end of a frame and the start of the next belong together.
            _ if is_start != is_ended => return Ok(None),
            Some(frame) if !is_start => frame.push((first, length)),
            _ => frames.push(vec![(first, length)]),
        }
        let padding = tail.iter().rev().take_while(|byte| **byte == 0).count();
        is_ended = tail[..tail.len() - padding].ends_with(END);
    }
    Ok(Some(frames).filter(|frames| is_ended && frames.len() as u64 == count))
}

pub(super) fn read_ranges(path: &Path, ranges: &[(u64, u64)]) -> Result<Vec<u8>> {
    let mut file = File::open(path).map_err(ImportError::io(path))?;
    let mut bytes = vec![0; ranges.iter().map(|r| r.1 as usize).sum()];
    let mut rest = &mut bytes[..];
    for &(first, length) in ranges {
        let (part, tail) = rest.split_at_mut(length as usize);
        file.seek(SeekFrom::Start(first)).and_then(|_| file.read_exact(part)).map_err(ImportError::io(path))?;
        rest = tail;
    }
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::temp_file;

    const STARTS: &[&[u8]] = &[b"\xff\xd8\xff", b"\xff\x4f\xff\x51"];

    /// Fragments of each frame as their numbers, of items behind an empty table.
    fn frames_of(count: u64, fragments: &[&[u8]], starts: &[&[u8]]) -> Result<Vec<Vec<usize>>, String> {
        let mut bytes = b"\xfe\xff\x00\xe0\0\0\0\0".to_vec();
        let mut places = Vec::new();
        for fragment in fragments {
            bytes.extend(b"\xfe\xff\x00\xe0");
            bytes.extend((fragment.len() as u32).to_le_bytes());
            places.push((bytes.len() as u64, fragment.len() as u64));
            bytes.extend(*fragment);
        }
        bytes.extend(b"\xfe\xff\xdd\xe0\0\0\0\0");
        let (_folder, path) = temp_file("a.dcm", &bytes);
        let frames = fragment_places(&path, count, 0, starts).map_err(|error| error.to_string())?;
        let number = |place| places.iter().position(|other| *other == place).unwrap();
        Ok(frames.into_iter().map(|frame| frame.into_iter().map(number).collect()).collect())
    }

    #[test]
    fn frames_begin_and_end_at_their_markers() {
        let (start, middle, end) = (&b"\xff\xd8\xff\xe0abcdefgh"[..], &b"0123456789"[..], &b"rest\xff\xd9\0\0"[..]);
        let (whole, wavelet) = (&b"\xff\xd8\xff\xdb\xff\xd9"[..], &b"\xff\x4f\xff\x51 x"[..]);
        let two = frames_of(2, &[start, middle, end, whole], STARTS).unwrap();
        assert_eq!(two, [vec![0, 1, 2], vec![3]]);
        assert_eq!(
            frames_of(3, &[whole, wavelet, end, start, end], STARTS).unwrap(),
            [vec![0], vec![1, 2], vec![3, 4]]
        );
        let refused: [(u64, &[&[u8]]); 6] = [
            // Another number of frames than the header's.
            (2, &[whole, wavelet, end, start, end]),
            // A start without the end before it, an end without a start behind it, none of both.
            (2, &[start, middle, start, end]),
            (2, &[whole, end, whole]),
            (2, &[middle, whole, start, end]),
            (2, &[whole, start, middle]),
            (2, &[whole, b"", start, end]),
        ];
        for (count, fragments) in refused {
            let message = frames_of(count, fragments, STARTS).unwrap_err();
            assert!(message.contains("cannot be assigned"), "{message}");
        }
        assert!(frames_of(2, &[start, end, whole], &[]).is_err(), "a codec without markers");
    }
}
