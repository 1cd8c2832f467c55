//! The table of a layer's medium, by code, for joint media of several layers. Per unit distance: colour times depth,
//! and depth; or an additive layer's colour.
//!
//! Media scale with a segment's length, so one table serves all lengths. It is interpolated linearly where its values
//! are nearly linear; elsewhere samples are computed one by one. 256 entries of the transfer table get two entries
//! each, and of 65,536 entries each 15 get one: tables of several layers then fit into the second-level cache, unlike
//! tables of every code. A frame's table takes a few microseconds, or a third of a millisecond for 16-bit codes.

use crate::mixture::{Mixed, OPAQUE};
use crate::packet::{LANES, Packet};
use crate::steps::Places;
use crate::unit::Unit;
use brickyard_volume::{Blend, SlotFormat, TransferTable};
use glam::Vec4;

/// Permitted errors of look-ups, relative and absolute: all samples of a ray together then stay within a quarter of a
/// picture's step.
const SHARE: f32 = 1.0 / 1024.0;
const LEAST: f32 = 1e-6;

/// A layer's medium by code, for layers drawn together.
pub(crate) struct DepthTable {
    blend: Blend,
    entries: Box<[Vec4]>,
    /// Whether the values from each entry to the next are not linear.
    bends: Box<[bool]>,
    has_bends: bool,
    /// The first and the last visible entry; the first is greater if none is.
    visible: [i32; 2],
    per_code: f32,
    /// The greatest position: short of the last entry, so that there is one to its right.
    limit: f32,
}

/// The most pieces of a table: 15 codes are one of 65,535.
const MOST: usize = 0xffff / 15;

/// The ratio of a table's pieces to those of a transfer table with this last entry.
const fn pieces(last: usize) -> (usize, usize) {
    if 2 * last <= MOST { (2, 1) } else { (1, last.div_ceil(MOST)) }
}

/// The most bytes of a table for codes of this format.
pub(crate) const fn bytes(format: SlotFormat) -> usize {
    let last = TransferTable::most_entries(format) - 1;
    let count = if last < MOST { last } else { MOST };
    (count + 1) * (size_of::<Vec4>() + size_of::<bool>())
}

impl DepthTable {
    pub(crate) fn new(table: &TransferTable, blend: Blend) -> Self {
        let (codes, last) = (&table.entries, table.last_entry());
        let (own, theirs) = pieces(last);
        let stride = theirs as f32 / own as f32;
        let at = |position: f32| {
            let code = (position as usize).min(last - 1);
            Vec4::from_array(codes[code]).lerp(Vec4::from_array(codes[code + 1]), (position - code as f32).min(1.0))
        };
        let count = (last * own).div_ceil(theirs);
        let entries: Box<[Vec4]> = (0..=count).map(|i| unit(blend, at(i as f32 * stride))).collect();
        let bends = |i: usize| {
            let (start, first, next) = (i as f32 * stride, at(i as f32 * stride), at((i + 1) as f32 * stride));
            let is_straight = |j: usize| {
                let (code, line) = (at(start + j as f32), first.lerp(next, j as f32 / stride));
                let most = (SHARE * code.w + LEAST) * (1.0 - code.w);
                (code.w - line.w).abs() <= most && (code - line).truncate().abs().max_element() <= SHARE
            };
            let middle = unit(blend, first.lerp(next, 0.5));
            let most = SHARE * middle.w.max(middle.max_element()) + LEAST;
            let is_linear = (entries[i].lerp(entries[i + 1], 0.5) - middle).abs().max_element() <= most;
            !(is_linear && (1..theirs).all(is_straight))
        };
        let bends: Box<[bool]> = (0..count).map(bends).collect();
        let shows = |i: &usize| {
            codes[i * theirs / own..=((i + 1) * theirs).div_ceil(own).min(last)].iter().any(|entry| entry[3] > 0.0)
        };
        let visible = [(0..count).find(shows).unwrap_or(count), (0..count).rev().find(shows).unwrap_or(0)];
        Self {
            blend,
            has_bends: bends.contains(&true),
            per_code: table.entries_per_code as f32 / stride,
            limit: ((entries.len() - 1) as f32).next_down(),
            visible: visible.map(|i| i as i32),
            entries,
            bends,
        }
    }

    /// Finds the places in the table of a packet of codes. Returns whether any is visible.
    #[inline(always)]
    pub(crate) fn find(&self, codes: &Packet, places: &mut Places) -> bool {
        let mut shows = 0;
        for i in 0..LANES {
            let position = codes[i] * self.per_code;
            // Written so that NaN ends up inside, too.
            let position = if position > 0.0 { position } else { 0.0 };
            let position = if position < self.limit { position } else { self.limit };
            // SAFETY: 0 <= position <= limit < 2^16.
            let index = unsafe { position.to_int_unchecked::<i32>() };
            places.fraction[i] = position - index as f32;
            places.at[i] = index;
            shows |= ((index >= self.visible[0]) & (index <= self.visible[1])) as i32;
        }
        shows != 0
    }

    /// Whether the table is too inexact at any place found by [`DepthTable::find`], which must then be
    /// [computed](DepthTable::computed).
    #[inline(always)]
    pub(crate) fn bends(&self, places: &Places) -> bool {
        let mut bends = false;
        if self.has_bends {
            for i in 0..LANES {
                bends |= self.bends[places.at[i] as usize];
            }
        }
        bends
    }

    /// Adds the layer's medium at the places found by [`DepthTable::find`] for a packet of samples. The samples'
    /// lengths times `share` are unit distances.
    ///
    /// # Safety
    /// The places have been found in this table.
    #[inline(always)]
    pub(crate) unsafe fn add<U: Unit>(
        &self,
        places: &Places,
        lengths: &Packet,
        share: f32,
        mixed: &mut [Mixed; LANES],
    ) {
        let (mut near, mut far) = ([0.0; LANES], [0.0; LANES]);
        for i in 0..LANES {
            let length = lengths[i] * share;
            far[i] = length * places.fraction[i];
            near[i] = length - far[i];
        }
        for i in 0..LANES {
            // SAFETY: the caller's promise; the limit is short of the last entry, so there are two from here on.
            let pair: &[Vec4; 2] = unsafe { &*self.entries.as_ptr().add(places.at[i] as usize).cast() };
            mixed[i].add_shares::<U>(pair, near[i], far[i]);
        }
    }

    /// Computes a unit distance of the medium with this straight colour and opacity, where [`DepthTable::add`] is too
    /// inexact.
    #[cold]
    pub(crate) fn computed(&self, entry: Vec4) -> Vec4 {
        unit(self.blend, entry)
    }
}

/// A unit distance of a medium of this straight colour and opacity, as part of the joint medium.
fn unit(blend: Blend, entry: Vec4) -> Vec4 {
    match blend {
        Blend::Mix | Blend::Over => entry.with_w(1.0) * (-(-entry.w).ln_1p()).min(OPAQUE),
        Blend::Add => entry.with_w(0.0) * entry.w,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::unit::Portable;
    use brickyard_volume::{SlotEncoding, TransferFunction, VoxelType};

    /// At codes between and at the entries, looked-up values equal computed ones or are marked as bent; few are.
    #[test]
    fn entries_are_what_a_unit_distance_has() {
        for (voxel_type, blend) in [VoxelType::U8, VoxelType::U16].map(|t| [(t, Blend::Mix), (t, Blend::Add)]).concat()
        {
            let encoding = SlotEncoding::new(voxel_type, (0.0, 1.0), false);
            let value = |t: f64| encoding.value(t);
            let transfer = TransferFunction {
                color: vec![[value(0.0), 1.0, 0.5, 0.0], [value(1.0), 0.0, 1.0, 0.25]],
                opacity: [[0.1955, 0.0], [0.4, 0.02], [0.401, 0.3], [0.9, 0.9], [1.0, 1.0]]
                    .map(|[t, a]| [value(t), a])
                    .to_vec(),
                ..TransferFunction::default()
            };
            let table = TransferTable::new(&transfer, &encoding);
            let max = encoding.format.max_code();
            let (depths, mut bent) = (DepthTable::new(&table, blend), 0);
            for i in 0..=1000 {
                let code = max as f32 * i as f32 / 1000.0;
                let mut places = Places::EMPTY;
                let shows = depths.find(&[code; LANES], &mut places);
                let bends = depths.bends(&places);
                let mut mixed = [Mixed::NONE; LANES];
                // SAFETY: the places have been found.
                unsafe { depths.add::<Portable>(&places, &[1.0; LANES], 1.0, &mut mixed) };
                let looked_up = mixed[7].sum();
                let [r, g, b, alpha] = table.lookup(code / max as f32).map(f64::from);
                assert!(if i < 190 { !shows } else { shows || alpha == 0.0 }, "{voxel_type} {code}");
                let expected = match blend {
                    Blend::Mix | Blend::Over => [r, g, b, 1.0].map(|v| v * -(-alpha).ln_1p()),
                    Blend::Add => [r, g, b, 0.0].map(|v| v * alpha),
                };
                bent += bends as usize;
                for (found, expected) in looked_up.to_array().into_iter().zip(expected).filter(|_| !bends) {
                    // Each part relative to the greatest, as samples of a picture are summed.
                    let most = 2e-3 * alpha.max(-(-alpha).ln_1p()) + 2e-6;
                    assert!(
                        (found as f64 - expected).abs() <= most,
                        "{voxel_type} {blend:?} {code}: {found} {expected}"
                    );
                }
            }
            assert!(bent < 150, "{voxel_type} {blend:?}: {bent} bend");
        }
    }
}
