//! Conversion of cores to aprons by way of *shells*: the outermost voxels of a core, enough for all of its neighbours'
//! aprons.
//!
//! A shell is six slabs like an apron's (see [`Apron`]), but of the core: for each axis its first and last `width`
//! layers, whole, so edges and corners lie in several. At 64^3 and a width of 1 it is 9 % of its core. An apron is
//! copied from the shells of the brick and its neighbours, 26 boxes in all. Without a neighbour, the brick's own
//! outermost voxels repeat; where the level ends inside a brick, packing has padded the core with them.

use brickyard_volume::{Apron, BrickIndex, Extent};

/// Cuts shells out of cores, and assembles aprons from shells.
#[derive(Clone, Copy)]
pub(crate) struct ApronMaker {
    pub(crate) apron: Apron,
    pub(crate) voxel_bytes: usize,
}

/// A box of voxels inside a packed array, in bytes: its start, and the steps along each axis.
#[derive(Clone, Copy)]
struct Place {
    start: usize,
    step: [usize; 3],
}

impl Place {
    /// The box starting at `at` in an array of `shape` that starts at byte `base`.
    fn new(base: usize, shape: [usize; 3], at: [usize; 3], voxel_bytes: usize) -> Self {
        let step = [voxel_bytes, shape[0] * voxel_bytes, shape[0] * shape[1] * voxel_bytes];
        Self { start: base + (0..3).map(|a| at[a] * step[a]).sum::<usize>(), step }
    }
}

impl ApronMaker {
    pub(crate) fn shell_bytes(&self) -> usize {
        6 * self.side_bytes()
    }

    pub(crate) fn apron_bytes(&self) -> usize {
        self.apron.voxels() * self.voxel_bytes
    }

    fn edge(&self) -> usize {
        self.apron.edge as usize
    }

    fn width(&self) -> usize {
        self.apron.width as usize
    }

    /// Bytes of one of a shell's slabs.
    fn side_bytes(&self) -> usize {
        self.edge().pow(2) * self.width() * self.voxel_bytes
    }

    /// The shape of a shell's slabs across an axis.
    fn side_shape(&self, axis: usize) -> [usize; 3] {
        let mut shape = [self.edge(); 3];
        shape[axis] = self.width();
        shape
    }

    pub(crate) fn cut(&self, core: &[u8], shell: &mut [u8]) {
        for axis in 0..3 {
            let shape = self.side_shape(axis);
            for is_high in [false, true] {
                let mut at = [0; 3];
                at[axis] = if is_high { self.edge() - self.width() } else { 0 };
                let from = Place::new(0, [self.edge(); 3], at, self.voxel_bytes);
                let to = Place::new(self.side_start(axis, is_high), shape, [0; 3], self.voxel_bytes);
                copy(self.voxel_bytes, shape, core, from, shell, to);
            }
        }
    }

    /// The start of a shell's slab, in bytes.
    fn side_start(&self, axis: usize, is_high: bool) -> usize {
        (2 * axis + is_high as usize) * self.side_bytes()
    }

    /// Makes a brick's apron from the shells of its level's bricks. A shell missing from `shell_of` is all zero.
    /// Returns `false` if the apron is all zero.
    pub(crate) fn make<'a>(
        &self,
        index: BrickIndex,
        grid: Extent,
        shell_of: impl Fn(BrickIndex) -> Option<&'a [u8]>,
        out: &mut [u8],
    ) -> bool {
        let (index, grid) = (index.to_array(), grid.to_array());
        out.fill(0);
        let mut any = false;
        for side in (0..27).map(|i| [i % 3, i / 3 % 3, i / 9]).filter(|&side| side != [1; 3]) {
            // Whether the brick has a neighbour on that side, along each axis.
            let lends = std::array::from_fn(|a| match side[a] {
                0 => index[a] > 0,
                1 => true,
                _ => index[a] + 1 < grid[a],
            });
            let lender = std::array::from_fn(|a| if lends[a] { index[a] + side[a] as u32 - 1 } else { index[a] });
            if let Some(shell) = shell_of(BrickIndex::from_array(lender)) {
                self.copy_part(side, lends, shell, out);
                any = true;
            }
        }
        any && out.iter().any(|&byte| byte != 0)
    }

    /// Copies the part on one side of a brick (0 before, 1 level with, 2 after its core, along each axis).
    fn copy_part(&self, side: [usize; 3], lends: [bool; 3], shell: &[u8], out: &mut [u8]) {
        let (edge, width) = (self.edge(), self.width());
        // Parts with z are in the apron's z slabs, then come those with y.
        let Some(axis) = (0..3).rev().find(|&a| side[a] != 1) else { return };
        let start_in_brick = [0, width, width + edge];
        let slabs = self.apron.slabs();
        let slab = 2 * (2 - axis) + (side[axis] == 2) as usize;
        let base = slabs[..slab].iter().map(|slab| slab.extent().volume() as usize).sum::<usize>() * self.voxel_bytes;
        let corner = slabs[slab].min.to_array();
        let at = std::array::from_fn(|a| start_in_brick[side[a]] - corner[a] as usize);
        let shape = slabs[slab].extent().to_array().map(|n| n as usize);
        let to = Place::new(base, shape, at, self.voxel_bytes);

        // A lender before lends its last layers; without one, the brick's own first voxels repeat.
        let is_high = (side[axis] == 0) == lends[axis];
        let at = std::array::from_fn(|a| {
            let length = if a == axis { width } else { edge };
            match (side[a], lends[a]) {
                (0, true) => length - width,
                (2, false) => length - 1,
                _ => 0,
            }
        });
        let base = self.side_start(axis, is_high);
        let mut from = Place::new(base, self.side_shape(axis), at, self.voxel_bytes);
        (0..3).filter(|&a| !lends[a]).for_each(|a| from.step[a] = 0);
        copy(self.voxel_bytes, side.map(|s| if s == 1 { edge } else { width }), shell, from, out, to);
    }
}

/// Copies a box; the rows of `to` are contiguous.
fn copy(voxel_bytes: usize, shape: [usize; 3], bytes: &[u8], from: Place, out: &mut [u8], to: Place) {
    let run = shape[0] * voxel_bytes;
    let repeats = from.step[0] == 0 && shape[0] > 1;
    for z in 0..shape[2] {
        let (from_z, to_z) = (from.start + z * from.step[2], to.start + z * to.step[2]);
        if !repeats && from.step[1] == run && to.step[1] == run {
            out[to_z..to_z + shape[1] * run].copy_from_slice(&bytes[from_z..from_z + shape[1] * run]);
            continue;
        }
        for y in 0..shape[1] {
            let (from_y, to_y) = (from_z + y * from.step[1], to_z + y * to.step[1]);
            if repeats {
                let voxel = &bytes[from_y..from_y + voxel_bytes];
                out[to_y..to_y + run].chunks_exact_mut(voxel_bytes).for_each(|v| v.copy_from_slice(voxel));
            } else {
                out[to_y..to_y + run].copy_from_slice(&bytes[from_y..from_y + run]);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// Every voxel of every apron equals the level's voxel there, clamped to the level.
        #[test]
        fn aprons_are_the_levels_voxels(
            extent in prop::array::uniform3(1u32..30), width in 1u32..3, voxel_bytes in prop::sample::select(vec![1usize, 2, 4]),
            seed in any::<u32>(),
        ) {
            const EDGE: u32 = 8;
            let maker = ApronMaker { apron: Apron { edge: EDGE, width }, voxel_bytes };
            let grid = Extent::from_array(extent.map(|n| n.div_ceil(EDGE)));
            let voxel = |v: [u32; 3]| -> Vec<u8> {
                let v: [u32; 3] = std::array::from_fn(|a| v[a].min(extent[a] - 1));
                // A third of the bricks are empty.
                let brick = v.map(|v| v / EDGE);
                if (seed ^ (brick[0] * 7 + brick[1] * 5 + brick[2] * 3)).is_multiple_of(3) {
                    return vec![0; voxel_bytes];
                }
                let hash = (v[0] ^ v[1] << 8 ^ v[2] << 16 ^ seed).wrapping_mul(2654435761);
                (hash ^ hash >> 15).to_le_bytes()[..voxel_bytes].to_vec()
            };
            let bricks: Vec<[u32; 3]> =
                (0..grid.volume() as u32).map(|i| [i % grid.x, i / grid.x % grid.y, i / grid.x / grid.y]).collect();
            let shell = |b: &[u32; 3]| {
                let core: Vec<u8> = (0..EDGE.pow(3)).flat_map(|i| {
                    let at = [i % EDGE, i / EDGE % EDGE, i / EDGE / EDGE];
                    voxel(std::array::from_fn(|a| b[a] * EDGE + at[a]))
                }).collect();
                let mut shell = vec![0; maker.shell_bytes()];
                maker.cut(&core, &mut shell);
                core.iter().any(|&b| b != 0).then_some(shell)
            };
            let shells: Vec<Option<Vec<u8>>> = bricks.iter().map(shell).collect();
            for brick in bricks {
                let mut apron = vec![9; maker.apron_bytes()];
                let shell_of = |i: BrickIndex| shells[grid.linear(i.to_array()) as usize].as_deref();
                let any = maker.make(BrickIndex::from_array(brick), grid, shell_of, &mut apron);
                prop_assert_eq!(any, apron.iter().any(|&b| b != 0));
                let mut found = apron.chunks_exact(voxel_bytes);
                for slab in maker.apron.slabs() {
                    for at in crate::test_store::voxels(slab) {
                        let v = std::array::from_fn(|a| (brick[a] * EDGE + at[a]).saturating_sub(width));
                        prop_assert_eq!(found.next().unwrap(), &voxel(v)[..], "brick {:?} at {:?}", brick, at);
                    }
                }
            }
        }
    }
}
