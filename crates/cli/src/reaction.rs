//! A small simulation whose steps are appended to a store as it runs: two substances in a box react and diffuse, by the
//! model of Gray and Scott (J. E. Pearson, *Complex patterns in a simple system*, Science 261, 1993), on a periodic
//! grid. Costs 16 bytes a voxel, and about 2 ns of processor time for each voxel and round.

use brickyard::import::{ImportError, Lent, Source, SourceInfo, SynthKind, SynthSource, uniform};
use brickyard::volume::{Extent, VoxelBox, VoxelType};
use std::num::NonZeroUsize;

/// Rounds of the simulation from one time step to the next.
const ROUNDS: u32 = 20;

/// Diffusion of the substances, squared voxels per round.
const DIFFUSION: [f32; 2] = [0.12, 0.06];

/// Feed rate of the first substance, and additional decay rate of the second.
const FEED: f32 = 0.035;
const KILL: f32 = 0.06;

/// Approximate greatest share of the second substance anywhere.
const MOST: f32 = 0.45;

/// The simulation, at some round.
pub(crate) struct Reaction {
    extent: Extent,
    seed: u64,
    step: u32,
    now: [Vec<f32>; 2],
    next: [Vec<f32>; 2],
}

/// One time step: the amount of the second substance, from 0 to the greatest value of 8 or 16 bits, or as a share in
/// f32.
pub(crate) struct ReactionStep {
    info: SourceInfo,
    voxels: Vec<u8>,
}

impl Reaction {
    /// Creates the start: the first substance everywhere, and drops of the second one around the middle.
    pub(crate) fn new(extent: Extent, seed: u64) -> Self {
        let count = extent.volume() as usize;
        let mut now = [vec![1.0; count], vec![0.0; count]];
        let size = extent.to_array().map(f64::from);
        let radius = (size.iter().copied().fold(f64::INFINITY, f64::min) / 16.0).max(1.0);
        for drop in 0..12 {
            let centre = [0, 1, 2].map(|axis| (0.3 + 0.4 * uniform(seed, 3 * drop + axis as u64)) * size[axis]);
            for (i, [x, y, z]) in places(extent).enumerate() {
                let at = [x, y, z].map(|at| f64::from(at) + 0.5);
                let distance: f64 = at.iter().zip(centre).map(|(at, centre)| (at - centre).powi(2)).sum();
                if distance < radius * radius {
                    (now[0][i], now[1][i]) = (0.5, 0.25);
                }
            }
        }
        Self { extent, seed, step: 0, next: now.clone(), now }
    }

    /// Bytes of a simulation of this size with a step of this voxel type.
    pub(crate) fn bytes(extent: Extent, voxel_type: VoxelType) -> u64 {
        extent.volume().saturating_mul(4 * size_of::<f32>() as u64 + voxel_type.bytes() as u64)
    }

    /// Runs on to the next time step, on this many threads.
    pub(crate) fn advance(&mut self, threads: NonZeroUsize) {
        let slice = self.extent.x as usize * self.extent.y as usize;
        let rows = (self.extent.z as usize).div_ceil(threads.get());
        for _ in 0..ROUNDS {
            let (extent, now) = (self.extent, &self.now);
            let [first, second] = &mut self.next;
            std::thread::scope(|scope| {
                let parts = first.chunks_mut(rows * slice).zip(second.chunks_mut(rows * slice));
                for (part, (first, second)) in parts.enumerate() {
                    scope.spawn(move || round(now, extent, (part * rows) as u32, [first, second]));
                }
            });
            std::mem::swap(&mut self.now, &mut self.next);
        }
        self.step += 1;
    }

    /// Returns the present time step; `None` for an unsupported voxel type.
    pub(crate) fn step(&self, voxel_type: VoxelType) -> Option<ReactionStep> {
        let shares = self.now[1].iter().map(|share| (share / MOST).clamp(0.0, 1.0));
        let voxels: Vec<u8> = match voxel_type {
            VoxelType::U8 => shares.map(|share| (share * 255.0).round() as u8).collect(),
            VoxelType::U16 => shares.flat_map(|share| ((share * 65535.0).round() as u16).to_le_bytes()).collect(),
            VoxelType::F32 => self.now[1].iter().flat_map(|share| share.to_le_bytes()).collect(),
            _ => return None,
        };
        let identity = format!("synth reaction {} {voxel_type} seed {} step {}", self.extent, self.seed, self.step);
        // But for its name, like any volume that is made.
        let alike = SynthSource::new(SynthKind::Constant, self.extent, voxel_type, 1, self.seed).ok()?;
        let info = SourceInfo { identity, ..alike.info().clone() };
        Some(ReactionStep { info, voxels })
    }
}

/// Runs one round of the slices from `first_z` on that fit in `out`.
fn round(now: &[Vec<f32>; 2], extent: Extent, first_z: u32, [first, second]: [&mut [f32]; 2]) {
    let (width, slice) = (extent.x as usize, extent.x as usize * extent.y as usize);
    let row = |y: u32, z: u32| z as usize * slice + y as usize * width;
    let around = |at: u32, size: u32| ((at + size - 1) % size, (at + 1) % size);
    for (i, (first, second)) in first.chunks_exact_mut(width).zip(second.chunks_exact_mut(width)).enumerate() {
        let (y, z) = (i as u32 % extent.y, first_z + i as u32 / extent.y);
        let ((up, down), (front, back)) = (around(y, extent.y), around(z, extent.z));
        let rows = [row(y, z), row(up, z), row(down, z), row(y, front), row(y, back)];
        for x in 0..width {
            let (left, right) = around(x as u32, extent.x);
            let [mut a, mut b] = [0, 1].map(|of| now[of][rows[0] + x]);
            let spread = [0, 1].map(|of: usize| {
                let substance = &now[of];
                let own = substance[rows[0] + x];
                let beside = substance[rows[0] + left as usize] + substance[rows[0] + right as usize];
                let around: f32 = rows[1..].iter().map(|row| substance[row + x]).sum();
                DIFFUSION[of] * (beside + around - 6.0 * own)
            });
            let reacted = a * b * b;
            a += spread[0] - reacted + FEED * (1.0 - a);
            b += spread[1] + reacted - (FEED + KILL) * b;
            (first[x], second[x]) = (a, b);
        }
    }
}

impl Source for ReactionStep {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    fn read_box(&self, time: u32, channel: u32, region: VoxelBox, out: &mut [u8]) -> Result<(), ImportError> {
        assert!(time == 0 && channel == 0, "no t{time} c{channel} in the source");
        let row = region.extent().x as usize * self.info.voxel_type.bytes();
        let rows = (region.min.z..region.max.z).flat_map(|z| (region.min.y..region.max.y).map(move |y| (y, z)));
        for (out, (y, z)) in out.chunks_exact_mut(row).zip(rows) {
            let start = self.offset([region.min.x, y, z]);
            out.copy_from_slice(&self.voxels[start..start + row]);
        }
        Ok(())
    }

    fn lend(
        &self,
        _time: u32,
        _channel: u32,
        region: VoxelBox,
        take: &mut dyn FnMut(Lent<'_>),
    ) -> Result<bool, ImportError> {
        let row_bytes = self.info.extent.x as usize * self.info.voxel_type.bytes();
        let slice_bytes = row_bytes * self.info.extent.y as usize;
        let start = self.offset(region.min.to_array());
        take(Lent { slices: 0..region.extent().z as usize, bytes: &self.voxels[start..], row_bytes, slice_bytes });
        Ok(true)
    }
}

impl ReactionStep {
    fn offset(&self, [x, y, z]: [u32; 3]) -> usize {
        let Extent { x: width, y: height, .. } = self.info.extent;
        ((z as usize * height as usize + y as usize) * width as usize + x as usize) * self.info.voxel_type.bytes()
    }
}

/// Returns all voxels of a volume, x fastest.
fn places(extent: Extent) -> impl Iterator<Item = [u32; 3]> {
    (0..extent.z).flat_map(move |z| (0..extent.y).flat_map(move |y| (0..extent.x).map(move |x| [x, y, z])))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_number_of_threads_makes_the_same_steps() {
        let run = |threads| {
            let mut reaction = Reaction::new(Extent::new(24, 17, 13), 3);
            (0..4).for_each(|_| reaction.advance(NonZeroUsize::new(threads).unwrap()));
            reaction.step(VoxelType::F32).unwrap().voxels
        };
        let one = run(1);
        assert!(run(2) == one && run(5) == one && run(40) == one);
    }

    #[test]
    fn what_spreads_stays_between_nothing_and_all() {
        let mut reaction = Reaction::new(Extent::new(32, 32, 32), 1);
        let covered = |reaction: &Reaction| reaction.now[1].iter().filter(|share| **share > 0.1).count();
        let start = covered(&reaction);
        (0..20).for_each(|_| reaction.advance(NonZeroUsize::new(2).unwrap()));
        assert!(covered(&reaction) > 2 * start, "{start}: {}", covered(&reaction));
        assert!(reaction.now.iter().flatten().all(|share| (0.0..=1.0).contains(share)));
    }

    #[test]
    fn without_reaction_what_diffuses_is_conserved_and_goes_round() {
        // One voxel's worth at the corner reaches its six neighbours, three of them round the ends.
        let extent = Extent::new(5, 4, 3);
        let mut reaction = Reaction::new(extent, 1);
        reaction.now = [vec![0.0; 60], vec![0.0; 60]];
        reaction.now[1][0] = 1.0;
        let [first, second] = &mut reaction.next;
        round(&reaction.now, extent, 0, [first, second]);
        let loss = FEED + KILL;
        assert!((second.iter().sum::<f32>() - (1.0 - loss)).abs() < 1e-6);
        for i in [1, 4, 5, 15, 20, 40] {
            assert!((second[i] - DIFFUSION[1]).abs() < 1e-7, "{i}: {}", second[i]);
        }
    }

    #[test]
    fn boxes_are_parts_of_what_is_lent() {
        let mut reaction = Reaction::new(Extent::new(9, 8, 7), 2);
        reaction.advance(NonZeroUsize::MIN);
        let step = reaction.step(VoxelType::U16).unwrap();
        let region = VoxelBox::new([2, 1, 3], [6, 7, 5]);
        let mut out = vec![0; region.extent().volume() as usize * 2];
        step.read_box(0, 0, region, &mut out).unwrap();
        let mut expected = Vec::new();
        let is_lent = step.lend(0, 0, region, &mut |lent| {
            let rows = (0..2).flat_map(|z| (0..6).map(move |y| z * lent.slice_bytes + y * lent.row_bytes));
            expected.extend(rows.flat_map(|start| lent.bytes[start..start + 8].to_vec()));
        });
        assert!(is_lent.unwrap());
        assert!(out == expected && out.iter().any(|byte| *byte > 0));
        assert!(reaction.step(VoxelType::I16).is_none());
    }
}
