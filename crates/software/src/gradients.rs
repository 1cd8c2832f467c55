//! A brick's stored gradients, interpolated between their nodes: 24 half floats for a place, where a central difference takes 48
//! voxels.

use brickyard_volume::GradientNodes;
use brickyard_volume::gradients::{NODE_BYTES, decode};
use glam::Vec3;

/// The nodes of one brick.
#[derive(Clone, Copy)]
pub(crate) struct Gradients<'a> {
    nodes: &'a [[u8; NODE_BYTES]],
    along: usize,
    /// Slot coordinate (voxel centres at whole numbers) of the first node.
    first: f32,
}

impl<'a> Gradients<'a> {
    /// Those behind a brick's voxels, of which there are `apron` around the core.
    ///
    /// # Panics
    /// If they are not as many as these.
    #[inline(always)]
    pub(crate) fn new(bytes: &'a [u8], nodes: GradientNodes, apron: u32) -> Self {
        assert_eq!(bytes.len(), nodes.bytes(), "not a brick's gradients");
        Self { nodes: bytes.as_chunks().0, along: nodes.along() as usize, first: nodes.first() + apron as f32 - 0.5 }
    }

    /// Differences across two voxels along each axis, as shares of the greatest code, at a slot coordinate.
    #[inline(always)]
    pub(crate) fn at(&self, place: [f32; 3]) -> Vec3 {
        let (mut node, mut t) = ([0; 3], [0.0; 3]);
        for a in 0..3 {
            let at = ((place[a] - self.first) * 0.5).clamp(0.0, (self.along - 1) as f32);
            node[a] = (at as usize).min(self.along - 2);
            t[a] = at - node[a] as f32;
        }
        let row = |y: usize, z: usize| {
            let first = ((node[2] + z) * self.along + node[1] + y) * self.along + node[0];
            decode(self.nodes[first]).lerp(decode(self.nodes[first + 1]), t[0])
        };
        let plane = |z: usize| row(0, z).lerp(row(1, z), t[1]);
        plane(0).lerp(plane(1), t[2])
    }
}
