//! Stored gradients: one for every eight voxels of a brick, made once as the brick is assembled. A lit sample reads them instead of several voxels.
//!
//! *Nodes* lie in the middle of each 2 x 2 x 2 voxels, counted from the level's first, like voxels of the next coarser level. A node has the exact
//! gradient of the trilinear field there: along each axis the mean of the four differences of neighbours. Voxels outside the level do not count: a
//! node half or wholly outside has the gradient of the nearest inner one. Between nodes gradients are interpolated unnormalised, so that weak ones
//! count for little.
//!
//! ```text
//! texel    4 half floats: along x, y, z; and nothing.   2 * (next voxel - voxel) / unit * 256, where the unit is the greatest code, or that of f32 slots
//! brick    nodes^3 texels, x fastest, from node -layers on;  nodes = edge / 2 + 2 * layers
//! ```
//!
//! Stored gradients cost a byte per voxel (`8 / 2^3`), and about half a millisecond for a brick of 64^3.

use crate::slot_encoding::{LEAST_SLOT, SlotFormat};
use glam::Vec3;
use half::slice::HalfFloatSliceExt;
use std::ops::Range;

/// Bytes of a gradient node: three half floats, and a fourth to fill up the texel.
pub const NODE_BYTES: usize = 8;

/// Stored number of a difference of one unit; for codes the unit is their whole range, and a difference of one code of 65,536 is no subnormal half
/// float.
pub const SCALE: f32 = 256.0;

/// The steepest stored gradient: differences of codes stay below, those of f32 slots may not.
const MOST_HALF: f32 = 65000.0;

/// The greatest difference across a voxel stored unclamped, in units.
pub(crate) const STEEPEST_UNITS: f64 = (MOST_HALF / (2.0 * SCALE)) as f64;

/// The layout of a brick's gradient nodes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct GradientNodes {
    /// Voxels along the edge of the brick's core; even.
    pub edge: u32,
    /// Layers of nodes on each side outside the core; 0 means no gradients at all.
    pub layers: u32,
}

impl GradientNodes {
    /// Layers of nodes needed outside the core to read gradients up to `reach` voxels outside it.
    pub const fn layers(reach: f64) -> u32 {
        // The outermost node lies a voxel inside its layer.
        ((reach + 1.0) / 2.0).ceil() as u32
    }

    /// Width of the apron, in voxels, needed to make a brick's gradients.
    pub const fn apron(self) -> u32 {
        2 * self.layers
    }

    /// Nodes along a brick's edge; 0 if there are no gradients.
    pub const fn along(self) -> u32 {
        if self.layers == 0 { 0 } else { self.edge / 2 + 2 * self.layers }
    }

    /// Bytes of all nodes of a brick.
    pub const fn bytes(self) -> usize {
        (self.along() as usize).pow(3) * NODE_BYTES
    }

    /// Position of the first node along each axis, in voxels from the corner of the core.
    pub const fn first(self) -> f32 {
        1.0 - 2.0 * self.layers as f32
    }

    /// Fills `nodes` with the gradients of a padded brick. `inside` is the range of the level's voxels along each axis, counted from the corner of
    /// the core.
    ///
    /// # Panics
    /// If the brick's apron is narrower than [`GradientNodes::apron`], or the lengths of codes or nodes do not fit.
    pub fn fill(&self, brick: PaddedCodes<'_>, inside: &[Range<i64>; 3], nodes: &mut [u8]) {
        assert!(brick.apron >= self.apron(), "no voxels to take gradients of");
        let padded = (self.edge + 2 * brick.apron) as usize;
        assert_eq!(brick.codes.len(), padded.pow(3) * brick.format.bytes(), "not a padded brick");
        assert_eq!(nodes.len(), self.bytes(), "not a brick's gradients");
        let pairs = [0, 1, 2].map(|a| self.pairs(brick.apron, &inside[a]));
        match brick.format {
            SlotFormat::U8 => fill(&brick, brick.codes, padded, |&code| code as f32, &pairs, nodes),
            SlotFormat::F32 => {
                fill(&brick, brick.codes.as_chunks().0, padded, |&slot| f32::from_le_bytes(slot), &pairs, nodes);
            }
            SlotFormat::U16 => {
                let code = |&code: &[u8; 2]| u16::from_le_bytes(code) as f32;
                fill(&brick, brick.codes.as_chunks().0, padded, code, &pairs, nodes);
            }
        }
    }

    /// The two voxels beside each node along an axis, as places in the padded brick.
    fn pairs(&self, apron: u32, inside: &Range<i64>) -> Vec<[usize; 2]> {
        let pair = |i: u32| {
            let first = 2 * i as i64 - self.apron() as i64;
            let low = first.min(inside.end - 2).max(inside.start);
            [low, (low + 1).min(inside.end - 1)].map(|v| (v + apron as i64) as usize)
        };
        (0..self.along()).map(pair).collect()
    }
}

/// The codes of a padded brick's voxels.
#[derive(Clone, Copy, Debug)]
pub struct PaddedCodes<'a> {
    /// `(edge + 2 * apron)^3` little-endian codes, or numbers of f32 slots, x fastest.
    pub codes: &'a [u8],
    /// Format of the codes.
    pub format: SlotFormat,
    /// Whether some voxels have no value.
    pub has_invalid: bool,
    /// The difference stored as [`SCALE`]: for codes the greatest code, for f32 slots their [unit](crate::FloatSlots::unit).
    pub unit: f32,
    /// Width of the apron around the core, in voxels.
    pub apron: u32,
}

/// Fills rows of nodes from codes of one width.
fn fill<T>(
    brick: &PaddedCodes<'_>,
    codes: &[T],
    padded: usize,
    code: impl Fn(&T) -> f32,
    [x, y, z]: &[Vec<[usize; 2]>; 3],
    nodes: &mut [u8],
) {
    let scale = 2.0 * SCALE / brick.unit;
    let least = if brick.format == SlotFormat::F32 { LEAST_SLOT } else { 0.0 };
    let (mut row, mut halves) = (vec![0.0; 4 * x.len()], vec![half::f16::ZERO; 4 * x.len()]);
    let mut rows = nodes.chunks_exact_mut(row.len() * 2);
    for z in z {
        for (y, out) in y.iter().zip(&mut rows) {
            // The four lines along x: both of y, then both of z.
            let lines = [0, 1, 2, 3].map(|i| &codes[(z[i / 2] * padded + y[i % 2]) * padded..][..padded]);
            for (x, node) in x.iter().zip(row.as_chunks_mut::<4>().0) {
                let block: [f32; 8] = std::array::from_fn(|i| code(&lines[i / 2][x[i % 2]]));
                let differences =
                    if brick.has_invalid { valid_differences(&block, least) } else { differences(&block) };
                *node = halved(differences * scale).extend(0.0).to_array();
            }
            halves.convert_from_f32_slice(&row);
            out.copy_from_slice(bytemuck::cast_slice(&halves));
        }
    }
}

/// Limits a gradient to the range of half floats, keeping its direction.
fn halved(gradient: Vec3) -> Vec3 {
    let steepest = gradient.abs().max_element();
    if steepest > MOST_HALF { gradient * (MOST_HALF / steepest) } else { gradient }
}

/// The mean differences across a block of 2 x 2 x 2, x fastest.
fn differences(b: &[f32; 8]) -> Vec3 {
    // Along the block's four diagonals.
    let [all, x, y, z] = [b[7] - b[0], b[1] - b[6], b[2] - b[5], b[4] - b[3]];
    0.25 * Vec3::new(all + x - y - z, all - x + y - z, all - x - y + z)
}

/// The mean differences over valid pairs: only codes above `least` are values.
fn valid_differences(block: &[f32; 8], least: f32) -> Vec3 {
    Vec3::from_array([1, 2, 4].map(|stride| {
        let (mut sum, mut count) = (0.0, 0.0);
        for i in (0..8).filter(|i| i & stride == 0) {
            let (near, far) = (block[i], block[i + stride]);
            if near > least && far > least {
                sum += far - near;
                count += 1.0;
            }
        }
        if count > 0.0 { sum / count } else { 0.0 }
    }))
}

/// Decodes nodes to differences of codes across two voxels along x, y and z, as shares of the unit. The fourth number of each node is meaningless and
/// fills up the vector.
#[inline(always)]
pub fn decode<const N: usize>(nodes: [[u8; NODE_BYTES]; N]) -> [[f32; 4]; N] {
    let mut numbers = [[0.0; 4]; N];
    for i in 0..N {
        for k in 0..4 {
            numbers[i][k] = from_half(u16::from_le_bytes([nodes[i][2 * k], nodes[i][2 * k + 1]]));
        }
    }
    numbers
}

/// Converts a half float, finite, divided by [`SCALE`]: its bits are those of a float too small by a power of two.
#[inline(always)]
pub fn from_half(bits: u16) -> f32 {
    const POWER: f32 = (1u128 << 112) as f32 / SCALE;
    let magnitude = f32::from_bits(((bits & 0x7fff) as u32) << 13) * POWER;
    f32::from_bits(magnitude.to_bits() | ((bits & 0x8000) as u32) << 16)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// The gradients of a brick at the corner of a level of `n` voxels, by its voxels' codes.
    fn gradients(
        nodes: GradientNodes,
        apron: u32,
        n: [i64; 3],
        has_invalid: bool,
        code: impl Fn([i64; 3]) -> u16,
    ) -> Vec<Vec3> {
        let (padded, apron_voxels) = ((nodes.edge + 2 * apron) as i64, apron as i64);
        let place = |i: i64, a: usize| (i - apron_voxels).clamp(0, n[a] - 1);
        let at = |i: i64| [place(i % padded, 0), place(i / padded % padded, 1), place(i / padded / padded, 2)];
        let codes: Vec<u8> = (0..padded.pow(3)).flat_map(|i| code(at(i)).to_le_bytes()).collect();
        let mut out = vec![0; nodes.bytes()];
        let brick = PaddedCodes { codes: &codes, format: SlotFormat::U16, has_invalid, unit: 65535.0, apron };
        nodes.fill(brick, &n.map(|n| 0..n), &mut out);
        out.as_chunks().0.iter().map(|&node| Vec3::from_slice(&decode([node])[0])).collect()
    }

    #[test]
    fn layers_reach_as_far_as_is_read() {
        assert_eq!([0.0, 0.5, 1.0, 1.5].map(GradientNodes::layers), [1, 1, 1, 2]);
        let nodes = GradientNodes { edge: 64, layers: 1 };
        assert_eq!((nodes.apron(), nodes.along(), nodes.first()), (2, 34, -1.0));
        assert_eq!(GradientNodes { edge: 64, layers: 0 }.bytes(), 0);
    }

    /// A field linear along each axis has exact gradients everywhere, also at the level's faces and outside it.
    #[test]
    fn a_linear_field_has_one_gradient() {
        for n in [[9, 12, 40], [2, 3, 7]] {
            let found = gradients(GradientNodes { edge: 8, layers: 2 }, 4, n, false, |[x, y, z]| {
                (1000 + 40 * x + 7 * y + 300 * z) as u16
            });
            let expected = Vec3::new(80.0, 14.0, 600.0) / 65535.0;
            // Half a unit in the last of 11 bits.
            assert!(found.iter().all(|g| (*g - expected).abs().max_element() <= 600.0 / 65535.0 / 2048.0), "{n:?}");
        }
        let flat = gradients(GradientNodes { edge: 4, layers: 1 }, 2, [1, 5, 5], false, |[_, y, _]| 10 * y as u16);
        assert!(flat.iter().all(|g| g.x == 0.0 && g.y > 0.0), "one voxel has no difference");
    }

    #[test]
    fn voxels_without_a_value_are_left_out() {
        let ramp = |x: i64| (100 + 10 * x) as u16;
        let found = gradients(GradientNodes { edge: 4, layers: 1 }, 2, [4; 3], true, |[x, y, z]| {
            if (x, y, z) == (1, 1, 1) || x == 2 { 0 } else { ramp(x) }
        });
        let at = |x: usize, y: usize, z: usize| found[(z * 4 + y) * 4 + x] * 65535.0;
        // Seven of the eight voxels have a value, so three of the four pairs along each axis do.
        assert!((at(1, 1, 1) - Vec3::new(20.0, 0.0, 0.0)).abs().max_element() < 0.02);
        assert_eq!(at(2, 1, 1), Vec3::ZERO, "no pair along x");
    }

    proptest! {
        /// Every node is the mean of its block's four differences, for any codes.
        #[test]
        fn nodes_are_the_trilinear_field_s_gradients(b in prop::array::uniform8(0u16..=65535)) {
            let block = b.map(f32::from);
            let expected = valid_differences(&block.map(|code| code + 1.0), 0.0);
            prop_assert!((differences(&block) - expected).abs().max_element() <= 0.05);
        }

        #[test]
        fn halves_are_read_as_they_are_written(bits in 0u16..0x7c00, negative: bool) {
            let bits = bits | (negative as u16) << 15;
            prop_assert_eq!(from_half(bits), half::f16::from_bits(bits).to_f32() / SCALE);
        }
    }
}
