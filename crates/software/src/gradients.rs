//! A brick's stored gradients, interpolated between their nodes, at one place or at eight: 24 half floats per place,
//! where a central difference takes 48 voxels.

use crate::packet::{LANES, Packet};
use crate::unit::Unit;
use brickyard_volume::GradientNodes;
use brickyard_volume::gradients::{NODE_BYTES, decode, from_half};
use glam::Vec3;

/// Gradient nodes of one brick, for interpolation.
#[derive(Clone, Copy)]
pub(crate) struct Gradients<'a> {
    nodes: &'a [[u8; NODE_BYTES]],
    along: usize,
    /// Slot coordinate (voxel centres at whole numbers) of the first node.
    first: f32,
}

impl<'a> Gradients<'a> {
    /// Wraps the gradients stored, as `bytes`, behind the voxels of a brick with this apron.
    ///
    /// # Panics
    /// If `bytes` does not have the length of such nodes.
    #[inline(always)]
    pub(crate) fn new(bytes: &'a [u8], nodes: GradientNodes, apron: u32) -> Self {
        assert_eq!(bytes.len(), nodes.bytes(), "not a brick's gradients");
        Self { nodes: bytes.as_chunks().0, along: nodes.along() as usize, first: nodes.first() + apron as f32 - 0.5 }
    }

    /// The gradient at a slot coordinate: differences across two voxels along each axis, as shares of the greatest
    /// code, or of the unit of f32 slots.
    #[inline(always)]
    pub(crate) fn at(&self, place: [f32; 3]) -> Vec3 {
        let (mut first, mut t) = (0, [0.0; 3]);
        for a in [2, 1, 0] {
            let at = ((place[a] - self.first) * 0.5).clamp(0.0, (self.along - 1) as f32);
            let node = (at as usize).min(self.along - 2);
            t[a] = at - node as f32;
            first = first * self.along + node;
        }
        let mut corners = [[0; NODE_BYTES]; 8];
        for i in 0..4 {
            let line = first + (i / 2 * self.along + i % 2) * self.along;
            corners[2 * i..2 * i + 2].copy_from_slice(&self.nodes[line..line + 2]);
        }
        let corners = decode(corners);
        let lines = mix::<8, 4>(&corners, t[0]);
        let planes = mix::<4, 2>(&lines, t[1]);
        Vec3::from_slice(&mix::<2, 1>(&planes, t[2])[0])
    }

    /// [`Gradients::at`] at eight slot coordinates, given axis by axis, times `scale`. Not inlined: it is large.
    #[inline(always)]
    pub(crate) fn packet<U: Unit>(&self, points: &[Packet; 3], scale: f32) -> [Packet; 3] {
        U::call(
            points,
            #[inline(always)]
            move |points| self.packet_on(points, scale),
        )
    }

    #[inline(always)]
    fn packet_on(&self, points: &[Packet; 3], scale: f32) -> [Packet; 3] {
        let (mut first, mut t) = ([0; LANES], [[0.0; LANES]; 3]);
        for a in [2, 1, 0] {
            for i in 0..LANES {
                let at = ((points[a][i] - self.first) * 0.5).clamp(0.0, (self.along - 1) as f32);
                let node = (at as i32).min(self.along as i32 - 2);
                t[a][i] = at - node as f32;
                first[i] = first[i] * self.along as i32 + node;
            }
        }
        let mut differences = [[0.0; LANES]; 3];
        for line in 0..4 {
            let at = (line / 2 * self.along + line % 2) * self.along;
            let (mut near, mut far) = ([0; LANES], [0; LANES]);
            for i in 0..LANES {
                let node = first[i] as usize + at;
                let pair = &self.nodes[node..node + 2];
                (near[i], far[i]) = (u64::from_le_bytes(pair[0]), u64::from_le_bytes(pair[1]));
            }
            let mut share = [0.0; LANES];
            for i in 0..LANES {
                let [y, z] = [t[1][i], t[2][i]];
                share[i] = scale * if line % 2 == 0 { 1.0 - y } else { y } * if line / 2 == 0 { 1.0 - z } else { z };
            }
            for a in 0..3 {
                for i in 0..LANES {
                    let [near, far] = [near[i], far[i]].map(|node: u64| from_half((node >> (16 * a)) as u16));
                    differences[a][i] += share[i] * (near + t[0][i] * (far - near));
                }
            }
        }
        differences
    }
}

#[inline(always)]
fn mix<const N: usize, const HALF: usize>(all: &[[f32; 4]; N], t: f32) -> [[f32; 4]; HALF] {
    let mut mixed = [[0.0; 4]; HALF];
    for i in 0..HALF {
        for k in 0..4 {
            mixed[i][k] = all[2 * i][k] + t * (all[2 * i + 1][k] - all[2 * i][k]);
        }
    }
    mixed
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::unit::Portable;

    #[test]
    fn a_packet_has_what_each_of_its_places_has() {
        let nodes = GradientNodes { edge: 8, layers: 1 };
        let mut state = 5u32;
        let mut noise = || {
            state = state.wrapping_mul(1664525).wrapping_add(1013904223);
            state >> 16
        };
        // Half floats of either sign, subnormal ones among them, and none infinite.
        let bytes: Vec<u8> = (0..nodes.bytes() / 2)
            .flat_map(|_| ((noise() & 0x83ff) as u16 | ((noise() % 30) << 10) as u16).to_le_bytes())
            .collect();
        let gradients = Gradients::new(&bytes, nodes, 2);
        for _ in 0..200 {
            let mut points = [[0.0; LANES]; 3];
            // Including places a little outside of all nodes.
            points.as_flattened_mut().iter_mut().for_each(|v| *v = noise() as f32 / 65535.0 * 14.0 - 1.0);
            let found = gradients.packet::<Portable>(&points, 3.0);
            for i in 0..LANES {
                let expected = gradients.at([0, 1, 2].map(|a| points[a][i])) * 3.0;
                for a in 0..3 {
                    // Eight products in another order; the greatest half float is some 65,504 / SCALE.
                    let rounding = 3.0 * 256.0 * 8.0 * f32::EPSILON;
                    assert!((found[a][i] - expected[a]).abs() <= rounding, "{found:?} {expected}");
                }
            }
        }
    }
}
