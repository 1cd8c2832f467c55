//! Back-to-front order of the cut's cells, by octree traversal.
//!
//! Along any axis a ray moves away from the eye (or, orthographic, along one direction) and never turns, so of two
//! siblings it meets the one whose grid position is nearer to the eye's on every axis first. Siblings are therefore
//! visited by descending distance in whole bricks, summed over the axes: exact for 8, 4 or 2 children, for a grid of
//! roots, and for cells of mixed size, where centre distances are wrong. Cost: one pass over the tree.

use crate::cut::Node;
use brickyard_volume::{BrickIndex, Geometry, Pyramid, ViewRays};

/// Positions of the cells in `nodes`, back to front.
pub(crate) fn back_to_front(pyramid: &Pyramid, geometry: &Geometry, rays: &ViewRays, nodes: &[Node]) -> Vec<u32> {
    let origins = Origins::new(pyramid, geometry, rays);
    let near_first = |siblings: &mut [(i64, u32)]| {
        for sibling in siblings.iter_mut() {
            let node = &nodes[sibling.1 as usize];
            sibling.0 = origins.distance(node);
        }
        siblings.sort_unstable();
    };
    let roots = nodes.iter().enumerate().take_while(|(i, node)| node.parent as usize == *i).count();
    let mut siblings: Vec<(i64, u32)> = (0..roots as u32).map(|i| (0, i)).collect();
    near_first(&mut siblings);
    let mut stack: Vec<u32> = siblings.iter().map(|s| s.1).collect();
    let mut cells = Vec::with_capacity(nodes.len());
    while let Some(position) = stack.pop() {
        let node = &nodes[position as usize];
        if node.is_cell() {
            cells.push(position);
            continue;
        }
        let mut siblings = [(0, 0); 8];
        let siblings = &mut siblings[..node.children as usize];
        siblings.iter_mut().zip(node.first_child..).for_each(|(s, child)| s.1 = child);
        near_first(siblings);
        stack.extend(siblings.iter().map(|s| s.1));
    }
    cells
}

/// Per level and axis, the grid position that rays move away from; `None` where no ray moves along the axis.
struct Origins(Vec<[Option<i64>; 3]>);

impl Origins {
    fn new(pyramid: &Pyramid, geometry: &Geometry, rays: &ViewRays) -> Self {
        let eye = geometry.voxel_from_world(rays.eye).to_array();
        let forward = rays.forward.to_array();
        let levels = pyramid.levels().iter().map(|level| {
            let bricks = level.bricks.to_array();
            std::array::from_fn(|a| {
                if rays.orthographic {
                    // Just outside the grid, on the side the rays come from.
                    return (forward[a] != 0.0).then(|| if forward[a] > 0.0 { -1 } else { bricks[a] as i64 });
                }
                let brick = pyramid.edge() as f64 * level.factor[a] as f64;
                Some((eye[a] / brick).floor().clamp(-1.0, bricks[a] as f64) as i64)
            })
        });
        Self(levels.collect())
    }

    fn distance(&self, node: &Node) -> i64 {
        let index = BrickIndex::to_array(node.index);
        let origin = &self.0[node.level.index()];
        (0..3).map(|a| origin[a].map_or(0, |o| (index[a] as i64 - o).abs())).sum()
    }
}
