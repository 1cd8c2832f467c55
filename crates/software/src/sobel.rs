//! Sobel gradients of a padded brick's codes, linearly filtered, at eight places at a time.
//!
//! The operator takes differences along an axis and smooths them across it, so it goes axis by axis: the sixteen lines
//! around a place are mixed along x, four of them at a time along y, and the results along z. A gradient costs 32 reads
//! of two neighbours, against 104 for its 26 separate samples. If one of a packet's voxels has no value, or a number
//! too far off to be a code, separate samples are taken after all.

use crate::differences::SOBEL;
use crate::packet::{LANES, Packet};
use crate::sample::{Brick, Code, mix};
use crate::unit::Unit;
use brickyard_volume::lighting::SMOOTH;

/// The smoothing of four neighbours along an axis, at a place between the middle two.
struct Across {
    weights: [Packet; 4],
    /// Fractions towards the third.
    t: Packet,
}

impl Across {
    #[inline(always)]
    fn new(t: &Packet) -> Self {
        let [beside, middle] = [SMOOTH[0] as f32, SMOOTH[1] as f32];
        let mut weights = [[0.0; LANES]; 4];
        for i in 0..LANES {
            let (near, far) = (1.0 - t[i], t[i]);
            weights[0][i] = beside * near;
            weights[1][i] = beside * far + middle * near;
            weights[2][i] = middle * far + beside * near;
            weights[3][i] = beside * far;
        }
        Self { weights, t: *t }
    }

    #[inline(always)]
    fn smoothed(&self, four: [&Packet; 4]) -> Packet {
        let mut sum = [0.0; LANES];
        for (weights, values) in self.weights.iter().zip(four) {
            for i in 0..LANES {
                sum[i] += weights[i] * values[i];
            }
        }
        sum
    }

    /// The difference across two of four neighbours.
    #[inline(always)]
    fn difference(&self, [a, b, c, d]: [&Packet; 4]) -> Packet {
        let mut found = [0.0; LANES];
        for i in 0..LANES {
            found[i] = mix(c[i] - a[i], d[i] - b[i], self.t[i]);
        }
        found
    }
}

impl Brick<'_> {
    /// Computes the differences of the Sobel operator, otherwise like [`Brick::central_differences`].
    #[inline(always)]
    pub(crate) fn sobel_differences<C: Code, U: Unit>(&self, points: &[Packet; 3], middle: &Packet) -> [Packet; 3] {
        U::call(
            (points, middle),
            #[inline(always)]
            move |(points, middle)| {
                let (voxel, t) = self.voxels_around(points);
                // SAFETY: such are the returned voxels.
                let (differences, odd) = unsafe { self.shared_sobel::<C>(&voxel, &t) };
                if C::INVALID && odd > 0.0 {
                    return self.sampled_differences::<C, U, _>(&SOBEL, points, middle);
                }
                differences
            },
        )
    }

    /// [`Brick::sobel_differences`] at the given voxels and fractions towards their upper neighbours. Also returns
    /// the number of voxels read that are no codes, if voxels may have no value; unless it is 0, the differences are
    /// useless.
    ///
    /// # Safety
    /// Every index is that of a voxel with a lower neighbour and two upper ones along each axis.
    #[inline(always)]
    unsafe fn shared_sobel<C: Code>(&self, voxel: &[i32; LANES], t: &[Packet; 3]) -> ([Packet; 3], f32) {
        let (row, slice) = (self.padded() as isize, (self.padded() * self.padded()) as isize);
        let [x, y, z] = [0, 1, 2].map(|a| Across::new(&t[a]));
        // Of each slice: the difference along x, that along y, and the smoothed sum.
        let (mut along_x, mut along_y, mut smooth) = ([[0.0; LANES]; 4], [[0.0; LANES]; 4], [[0.0; LANES]; 4]);
        let mut odd = [0.0; LANES];
        for k in 0..4 {
            let (mut line_along, mut line) = ([[0.0; LANES]; 4], [[0.0; LANES]; 4]);
            for j in 0..4 {
                let at = (k as isize - 1) * slice + (j as isize - 1) * row;
                let [mut a, mut b, mut c, mut d] = [[0.0; LANES]; 4];
                // SAFETY: by the caller's promise these voxels are inside the brick.
                unsafe {
                    self.pairs::<C>(voxel, at - 1, [&mut a, &mut b], &mut odd);
                    self.pairs::<C>(voxel, at + 1, [&mut c, &mut d], &mut odd);
                }
                line_along[j] = x.difference([&a, &b, &c, &d]);
                line[j] = x.smoothed([&a, &b, &c, &d]);
            }
            along_x[k] = y.smoothed(line_along.each_ref());
            along_y[k] = y.difference(line.each_ref());
            smooth[k] = y.smoothed(line.each_ref());
        }
        let mut differences =
            [z.smoothed(along_x.each_ref()), z.smoothed(along_y.each_ref()), z.difference(smooth.each_ref())];
        self.scale_to_codes::<C>(&mut differences);
        (differences, odd.iter().sum())
    }
}
