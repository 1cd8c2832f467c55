//! Box reads of a padded brick ([`brickyard_volume::extremes`]): the extreme of all voxels touched by each segment's
//! box.
//!
//! Where no box touches more than two voxels along an axis, only its corners are read, eight boxes at once, neighbours
//! along x together. As in `sample`, everything is inlined, for the vector unit of its final function.

use crate::packet::{LANES, PACKETS, Packet};
use crate::sample::{Brick, Code, SampleChunk};
use crate::unit::Unit;
use brickyard_volume::Extreme;

const fn sign(extreme: Extreme) -> f32 {
    match extreme {
        Extreme::Greatest => 1.0,
        Extreme::Least => -1.0,
    }
}

/// A chunk's segments in a brick: middles at the slot coordinates `origin + along * step`, `whole` as the weight of a
/// whole one, and `reach` as the extent of the boxes beyond their segments.
#[derive(Clone, Copy)]
pub(crate) struct Segments {
    pub(crate) origin: [f32; 3],
    pub(crate) step: [f32; 3],
    pub(crate) whole: f32,
    pub(crate) reach: [f32; 3],
}

/// The voxels touched by eight boxes: the first of each, and the number of further ones along each axis. Along x the
/// first always has a voxel above it; 1 in `skipped` marks boxes touching only that one.
struct Touched {
    first: [i32; LANES],
    skipped: [i32; LANES],
    more: [[i32; LANES]; 3],
}

impl Brick<'_> {
    /// Fills in the extreme code of each of a chunk's segments, with weight 0 if no touched voxel has a value.
    #[inline(always)]
    pub(crate) fn read_boxes<C: Code, U: Unit>(&self, extreme: Extreme, segments: &Segments, chunk: &mut SampleChunk) {
        U::call(
            (segments, chunk),
            #[inline(always)]
            move |(segments, chunk)| self.read_boxes_on::<C>(extreme, segments, chunk),
        );
    }

    #[inline(always)]
    fn read_boxes_on<C: Code>(&self, extreme: Extreme, segments: &Segments, chunk: &mut SampleChunk) {
        let sign = sign(extreme);
        for p in 0..chunk.packets.min(PACKETS) {
            let touched = self.touched(segments, &chunk.along[p], &chunk.weight[p]);
            let mut most = 0;
            for a in 0..3 {
                for i in 0..LANES {
                    most = if touched.more[a][i] > most { touched.more[a][i] } else { most };
                }
            }
            // SAFETY: the voxels have been found in this brick.
            let best = unsafe {
                if most <= 1 {
                    self.best_of_corners::<C>(&touched, sign)
                } else {
                    self.best_of_all::<C>(&touched, sign)
                }
            };
            for i in 0..LANES {
                let number = sign * best[i];
                chunk.code[p][i] = if C::IS_FLOAT { self.map.code(number) } else { number };
                if C::INVALID && best[i] == f32::NEG_INFINITY {
                    chunk.weight[p][i] = 0.0;
                }
            }
        }
    }

    /// The voxels touched by the boxes of eight segments. Outside the brick, its outermost voxels stand in.
    #[inline(always)]
    fn touched(&self, segments: &Segments, along: &Packet, weight: &Packet) -> Touched {
        let Segments { origin, step, whole, reach } = *segments;
        let mut longest = 0.0f32;
        for a in 0..3 {
            longest = if step[a].abs() > longest { step[a].abs() } else { longest };
        }
        // Half of each segment's examined part, as a share of a whole segment.
        let mut half = [0.0; LANES];
        for i in 0..LANES {
            let share = weight[i] / whole;
            let voxels = share * longest;
            half[i] = 0.5 * if voxels > 1.0 { share / voxels } else { share };
        }
        let (padded, last) = (self.padded() as i32, (self.padded() - 1) as f32);
        let mut touched = Touched { first: [0; LANES], skipped: [0; LANES], more: [[0; LANES]; 3] };
        for a in [2, 1, 0] {
            for i in 0..LANES {
                // Voxel 0 spans -1/2 to 1/2.
                let middle = origin[a] + along[i] * step[a] + 0.5;
                let to_face = half[i] * step[a].abs() + reach[a];
                let low = clamped(middle - to_face, last);
                let high = clamped(middle + to_face, last);
                touched.first[i] = touched.first[i] * padded + low;
                touched.more[a][i] = high - low;
                if a == 0 {
                    touched.skipped[i] = (low == padded - 1) as i32;
                    touched.first[i] -= touched.skipped[i];
                }
            }
        }
        touched
    }

    /// The best number at the corners of each of eight boxes.
    ///
    /// # Safety
    /// The voxels are in the brick.
    #[inline(always)]
    unsafe fn best_of_corners<C: Code>(&self, touched: &Touched, sign: f32) -> Packet {
        let padded = self.padded() as i32;
        let mut best = [f32::NEG_INFINITY; LANES];
        for line in 0..4 {
            let (y, z) = (line & 1, line >> 1);
            let mut pair = [C::Pair::default(); LANES];
            for i in 0..LANES {
                let voxel = touched.first[i] + (y * touched.more[1][i] + z * touched.more[2][i] * padded) * padded;
                // SAFETY: by the caller's promise the voxel is in the brick, and so is the one above it along x.
                pair[i] = unsafe { C::pair(self.codes.as_ptr().add(voxel as usize * C::BYTES)) };
            }
            for i in 0..LANES {
                let near = self.signed::<C>(C::near(pair[i]), sign);
                let far = self.signed::<C>(C::far(pair[i]), sign);
                let near = if touched.skipped[i] == 0 { near } else { f32::NEG_INFINITY };
                let far = if touched.skipped[i] + touched.more[0][i] > 0 { far } else { f32::NEG_INFINITY };
                let better = if near > far { near } else { far };
                best[i] = if better > best[i] { better } else { best[i] };
            }
        }
        best
    }

    /// The best number of all voxels in each of eight boxes.
    ///
    /// # Safety
    /// The voxels are in the brick.
    #[inline(always)]
    unsafe fn best_of_all<C: Code>(&self, touched: &Touched, sign: f32) -> Packet {
        let padded = self.padded();
        let mut best = [f32::NEG_INFINITY; LANES];
        for i in 0..LANES {
            for z in 0..=touched.more[2][i] as usize {
                for y in 0..=touched.more[1][i] as usize {
                    for x in 0..=touched.more[0][i] as usize {
                        let voxel = (touched.first[i] + touched.skipped[i]) as usize + x + (y + z * padded) * padded;
                        // SAFETY: by the caller's promise the voxel is in the brick; no alignment is needed.
                        let stored = unsafe {
                            let at = self.codes.as_ptr().add(voxel * C::BYTES);
                            match C::BYTES {
                                1 => f32::from(*at),
                                2 => f32::from(u16::from_le(at.cast::<u16>().read_unaligned())),
                                _ => f32::from_bits(u32::from_le(at.cast::<u32>().read_unaligned())),
                            }
                        };
                        let number = self.signed::<C>(stored, sign);
                        best[i] = if number > best[i] { number } else { best[i] };
                    }
                }
            }
        }
        best
    }

    /// A voxel's number, times `sign`; less than all numbers if the voxel has no value.
    #[inline(always)]
    fn signed<C: Code>(&self, stored: f32, sign: f32) -> f32 {
        let (number, has_value) = C::part(stored, &self.map);
        if C::INVALID && !has_value { f32::NEG_INFINITY } else { sign * number }
    }
}

#[inline(always)]
fn clamped(v: f32, last: f32) -> i32 {
    // Written so that NaN ends up inside, too.
    let v = if v > 0.0 { v } else { 0.0 };
    let v = if v < last { v } else { last };
    // SAFETY: 0 <= v <= last < 2^31.
    unsafe { v.to_int_unchecked::<i32>() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sample::{Code8, Code16, CodeMap, Float32};
    use crate::unit::Portable;
    use brickyard_volume::extremes::half_box;
    use brickyard_volume::slot_encoding::INVALID_SLOT;
    use proptest::prelude::*;

    const CODES: CodeMap = CodeMap { first: 0.0, per_number: 1.0, farthest: f32::MAX };
    const PADDED: usize = 7;

    /// The codes found by boxes of segments at these places, each a share of a step; `None` without weight.
    fn read<C: Code>(
        bytes: &[u8],
        extreme: Extreme,
        (origin, step, reach): ([f32; 3], [f32; 3], [f32; 3]),
        share: f32,
    ) -> Vec<Option<f32>> {
        let brick = Brick::new::<C>(bytes, PADDED as u32, CODES);
        let along = std::array::from_fn(|p| std::array::from_fn(|i| (p * LANES + i) as f32));
        let weight = [[3.0 * share; LANES]; PACKETS];
        let mut chunk = SampleChunk::EMPTY;
        (chunk.packets, chunk.along, chunk.weight) = (PACKETS, along, weight);
        let segments = Segments { origin, step, whole: 3.0, reach };
        brick.read_boxes::<C, Portable>(extreme, &segments, &mut chunk);
        let found = chunk.code.as_flattened().iter().zip(chunk.weight.as_flattened());
        found.map(|(&code, &weight)| (weight > 0.0).then_some(code)).collect()
    }

    proptest! {
        /// Compares with a plain loop over all voxels, in f64, for codes and numbers of every width.
        #[test]
        fn the_extreme_of_what_is_touched_is_found(
            voxels in prop::collection::vec(prop::sample::select(vec![0u8, 1, 7, 200, 255]), PADDED.pow(3)),
            origin in prop::array::uniform3(-1.0f32..7.0), step in prop::array::uniform3(-1.2f32..1.2),
            reach in prop::array::uniform3(prop::sample::select(vec![0.0f32, 0.125, 0.5, 1.5])), share in 0.1f32..=1.0,
            is_least in any::<bool>(), kind in 0usize..4,
        ) {
            let extreme = if is_least { Extreme::Least } else { Extreme::Greatest };
            let (at, has_invalid) = ((origin, step, reach), kind != 0);
            let number = |v: u8| if v == 0 { INVALID_SLOT } else { f32::from(v) - 100.0 };
            let wide = |of: &dyn Fn(u8) -> Vec<u8>| voxels.iter().flat_map(|&v| of(v)).collect::<Vec<u8>>();
            let found = match kind {
                0 => read::<Code8<false>>(&voxels, extreme, at, share),
                1 => read::<Code8<true>>(&voxels, extreme, at, share),
                2 => read::<Code16<true>>(&wide(&|v| (u16::from(v) * 257).to_le_bytes().into()), extreme, at, share),
                _ => read::<Float32>(&wide(&|v| number(v).to_le_bytes().into()), extreme, at, share),
            };
            let value = |v: u8| [f64::from(v), f64::from(v) * 257.0, f64::from(v) - 100.0][[0, 0, 1, 2][kind]];
            for (i, found) in found.into_iter().enumerate() {
                let half = half_box(step.map(|s| f64::from(s * share)), reach.map(f64::from));
                let faces = |a: usize| {
                    let middle = f64::from(origin[a] + i as f32 * step[a]) + 0.5;
                    [middle - half[a], middle + half[a]]
                };
                // A face near a voxel boundary may round either way: left open.
                let is_open = (0..3).flat_map(faces).any(|face| (face - face.round()).abs() < 1e-4);
                let range = |a: usize| {
                    let [low, high] = faces(a).map(|face| face.clamp(0.0, (PADDED - 1) as f64) as usize);
                    low..=high
                };
                let mut expected: Option<f64> = None;
                for (z, y) in range(2).flat_map(|z| range(1).map(move |y| (z, y))) {
                    for x in range(0) {
                        let voxel = voxels[(z * PADDED + y) * PADDED + x];
                        let better = |best: f64| if is_least { best.min(value(voxel)) } else { best.max(value(voxel)) };
                        expected = if has_invalid && voxel == 0 { expected } else { Some(expected.map_or(value(voxel), better)) };
                    }
                }
                prop_assert!(is_open || found.map(f64::from) == expected, "{i}: {found:?} {expected:?}");
            }
        }
    }
}
