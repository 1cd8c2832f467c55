//! A brick's stored gradients, interpolated between their nodes: 24 half floats for a place, where a central difference takes 48
//! voxels.

use brickyard_volume::GradientNodes;
use brickyard_volume::gradients::{NODE_BYTES, decode};
use glam::Vec3;

/// The gradient nodes of one brick, to be interpolated.
#[derive(Clone, Copy)]
pub(crate) struct Gradients<'a> {
    nodes: &'a [[u8; NODE_BYTES]],
    along: usize,
    /// Slot coordinate (voxel centres at whole numbers) of the first node.
    first: f32,
}

impl<'a> Gradients<'a> {
    /// The gradients that lie, as `bytes`, behind the voxels of a brick with this apron.
    ///
    /// # Panics
    /// If `bytes` is not as long as such nodes are.
    #[inline(always)]
    pub(crate) fn new(bytes: &'a [u8], nodes: GradientNodes, apron: u32) -> Self {
        assert_eq!(bytes.len(), nodes.bytes(), "not a brick's gradients");
        Self { nodes: bytes.as_chunks().0, along: nodes.along() as usize, first: nodes.first() + apron as f32 - 0.5 }
    }

    /// The gradient at a slot coordinate: differences across two voxels along each axis, as shares of the greatest code, or of the unit of f32
    /// slots.
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
}

/// Each of neighbouring pairs mixed.
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
