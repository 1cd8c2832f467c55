//! Copies of boxes between dense arrays whose axes lie in any order. Axes contiguous in both arrays are one, so a box in the same order costs a
//! `memcpy` for each run; a box in another order is copied in tiles of a cache line by a few elements.

/// An axis of a box: its elements, and the bytes between them in both arrays.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct CopyAxis {
    pub(crate) count: usize,
    /// Bytes between neighbours in the source; zero for one element everywhere.
    pub(crate) from: usize,
    pub(crate) to: usize,
}

/// Copies a box of elements from the start of `from` to the start of `to`. Axes are slowest first.
///
/// # Panics
/// If the box leaves an array, or elements have none of 1, 2, 4 or 8 bytes.
pub(crate) fn copy(from: &[u8], to: &mut [u8], axes: &[CopyAxis], element_bytes: usize) {
    if axes.iter().any(|axis| axis.count == 0) {
        return;
    }
    let mut axes = merged(axes);
    let line = axes.pop().unwrap_or(CopyAxis { count: 1, from: element_bytes, to: element_bytes });
    // The source's own fastest axis, where it is another than the target's.
    let is_turned = line.from != element_bytes && line.to == element_bytes;
    let cross = axes.iter().position(|axis| is_turned && axis.from == element_bytes).map(|a| axes.remove(a));
    let mut at = vec![0; axes.len()];
    let (mut source, mut target) = (0, 0);
    loop {
        let (from, to) = (&from[source..], &mut to[target..]);
        match cross {
            None => copy_line(from, to, line, element_bytes),
            Some(cross) => copy_tiles(from, to, line, cross, element_bytes),
        }
        let Some(a) = (0..axes.len()).rev().find(|a| at[*a] + 1 < axes[*a].count) else { return };
        for (at, axis) in at.iter_mut().zip(&axes).skip(a + 1) {
            source -= *at * axis.from;
            target -= *at * axis.to;
            *at = 0;
        }
        at[a] += 1;
        source += axes[a].from;
        target += axes[a].to;
    }
}

/// Axes of several elements, as few as possible.
fn merged(axes: &[CopyAxis]) -> Vec<CopyAxis> {
    let mut merged: Vec<CopyAxis> = Vec::with_capacity(axes.len());
    for axis in axes.iter().filter(|axis| axis.count > 1) {
        match merged.last_mut() {
            Some(last) if last.from == axis.from * axis.count && last.to == axis.to * axis.count => {
                *last = CopyAxis { count: last.count * axis.count, ..*axis };
            }
            _ => merged.push(*axis),
        }
    }
    merged
}

fn copy_line(from: &[u8], to: &mut [u8], line: CopyAxis, element_bytes: usize) {
    if line.from == element_bytes && line.to == element_bytes {
        let bytes = line.count * element_bytes;
        return to[..bytes].copy_from_slice(&from[..bytes]);
    }
    match element_bytes {
        1 => copy_elements::<1>(from, to, line),
        2 => copy_elements::<2>(from, to, line),
        4 => copy_elements::<4>(from, to, line),
        8 => copy_elements::<8>(from, to, line),
        _ => panic!("elements of {element_bytes} bytes"),
    }
}

fn copy_elements<const N: usize>(from: &[u8], to: &mut [u8], line: CopyAxis) {
    if line.to == N {
        let elements = to[..line.count * N].as_chunks_mut::<N>().0;
        if line.from == 0 {
            return elements.fill(from[..N].try_into().expect("an element"));
        }
        for (element, source) in elements.iter_mut().zip(from.chunks(line.from)) {
            element.copy_from_slice(&source[..N]);
        }
        return;
    }
    for i in 0..line.count {
        to[i * line.to..][..N].copy_from_slice(&from[i * line.from..][..N]);
    }
}

/// Elements of a tile along the target's lines: so many lines of the source, a power of two apart, fit a cache.
const TILE: usize = 8;

/// Bytes of a tile along the source's lines.
const TILE_BYTES: usize = 64;

/// Copies a plane whose fastest axes are `line` in the target, and `cross` in the source.
fn copy_tiles(from: &[u8], to: &mut [u8], line: CopyAxis, cross: CopyAxis, element_bytes: usize) {
    let step = TILE_BYTES / element_bytes;
    for low in (0..cross.count).step_by(step) {
        let cross = CopyAxis { count: step.min(cross.count - low), ..cross };
        let (from, to) = (&from[low * cross.from..], &mut to[low * cross.to..]);
        for low in (0..line.count).step_by(TILE) {
            let line = CopyAxis { count: TILE.min(line.count - low), ..line };
            for i in 0..cross.count {
                let from = &from[low * line.from + i * cross.from..];
                copy_line(from, &mut to[low * line.to + i * cross.to..], line, element_bytes);
            }
        }
    }
}

/// Reverses the bytes of each element.
///
/// # Panics
/// If elements have none of 1, 2, 4 or 8 bytes.
pub(crate) fn swap_bytes(bytes: &mut [u8], element_bytes: usize) {
    match element_bytes {
        1 => {}
        2 => bytes.as_chunks_mut::<2>().0.iter_mut().for_each(|element| element.reverse()),
        4 => bytes.as_chunks_mut::<4>().0.iter_mut().for_each(|element| element.reverse()),
        8 => bytes.as_chunks_mut::<8>().0.iter_mut().for_each(|element| element.reverse()),
        _ => panic!("elements of {element_bytes} bytes"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::chunk_grid::{step, strides};
    use proptest::prelude::*;

    #[test]
    fn planes_of_several_tiles_are_transposed() {
        for element_bytes in [1, 2, 4, 8] {
            let (rows, columns) = (19, 150);
            let from: Vec<u8> = (0..rows * columns * element_bytes).map(|i| (i * 7 + i / 251) as u8).collect();
            let mut to = vec![0; from.len()];
            let across = CopyAxis { count: columns, from: element_bytes, to: rows * element_bytes };
            let down = CopyAxis { count: rows, from: columns * element_bytes, to: element_bytes };
            copy(&from, &mut to, &[across, down], element_bytes);
            for (i, element) in to.chunks_exact(element_bytes).enumerate() {
                let place = (i % rows * columns + i / rows) * element_bytes;
                assert_eq!(element, &from[place..][..element_bytes], "{element_bytes} {i}");
            }
        }
    }

    #[test]
    fn contiguous_axes_are_one() {
        let axis = |count, from, to| CopyAxis { count, from, to };
        assert_eq!(merged(&[axis(3, 24, 24), axis(1, 9, 9), axis(3, 8, 8), axis(4, 2, 2)]), [axis(36, 2, 2)]);
        assert_eq!(merged(&[axis(3, 32, 24), axis(3, 8, 8), axis(4, 2, 2)]), [axis(3, 32, 24), axis(12, 2, 2)]);
        assert_eq!(merged(&[axis(2, 0, 8), axis(4, 0, 2)]), [axis(8, 0, 2)], "one element everywhere");
    }

    proptest! {
        /// Each element of a box lands where plain loops put it, and no other byte changes.
        #[test]
        fn boxes_are_copied_in_any_order(
            // Long ones are of several tiles.
            counts in prop::collection::vec(prop_oneof![5 => 1u64..5, 1 => 60u64..75], 0..4),
            extra in prop::collection::vec(0u64..3, 5),
            turned in any::<bool>(),
            is_fill in any::<bool>(),
            element_bytes in prop::sample::select(vec![1usize, 2, 4, 8]),
        ) {
            let axes = counts.len();
            let sizes: Vec<u64> = counts.iter().zip(&extra).map(|(count, extra)| count + extra).collect();
            let mut from_strides: Vec<usize> = match turned {
                true => {
                    let reversed: Vec<u64> = sizes.iter().rev().copied().collect();
                    strides(&reversed, element_bytes).into_iter().rev().collect()
                }
                false => strides(&sizes, element_bytes),
            };
            if is_fill {
                from_strides.fill(0);
            }
            let to_strides = strides(&sizes, element_bytes);
            let total = sizes.iter().product::<u64>() as usize * element_bytes;
            let from: Vec<u8> = (0..total).map(|i| (i * 7 + i / 256) as u8).collect();
            let mut to = vec![0xee; total];
            let mut expected = to.clone();
            let box_axes: Vec<CopyAxis> = (0..axes)
                .map(|a| CopyAxis { count: counts[a] as usize, from: from_strides[a], to: to_strides[a] })
                .collect();
            copy(&from, &mut to, &box_axes, element_bytes);
            let (zeros, ends): (Vec<u64>, Vec<u64>) = counts.iter().map(|count| (0, count - 1)).unzip();
            let mut at = zeros.clone();
            loop {
                let place = |strides: &[usize]| (0..axes).map(|a| at[a] as usize * strides[a]).sum::<usize>();
                let source = &from[place(&from_strides)..][..element_bytes];
                expected[place(&to_strides)..][..element_bytes].copy_from_slice(source);
                if !step(&mut at, &zeros, &ends) {
                    break;
                }
            }
            prop_assert_eq!(to, expected);
        }
    }
}
