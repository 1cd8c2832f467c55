//! Back-to-front order of the cut's cells, by octree traversal.
//!
//! Along any axis a ray moves away from the eye (or, orthographic, along one direction) and never turns, so of two siblings
//! it first meets the one nearer to the eye's grid position on every axis. Siblings are therefore visited by descending
//! distance in whole bricks, summed over the axes. This is exact for 8, 4 or 2 children, for a grid of roots, and for cells
//! of mixed size, where centre distances are wrong. Costs one pass over the visible part of the tree.

use crate::cut::{Cut, Members, Node, NodeId};
use crate::source::BrickSource;
use brickyard_volume::{BrickIndex, Placement, ViewRays};

/// Cells of a shared tree, back to front, each with the volumes to which it is visible.
pub(crate) fn back_to_front(
    source: &dyn BrickSource,
    rays: &ViewRays,
    placement: &Placement,
    cut: &Cut,
    visible: impl Fn(&Node) -> Members,
) -> Vec<(NodeId, Members)> {
    let origins = Origins::new(source, rays, placement);
    let mut cells = Vec::with_capacity(cut.wanted);
    let mut stack = Vec::new();
    let mut siblings: Vec<(i64, NodeId)> = Vec::new();
    // The last is popped first.
    let mut push_near_first = |stack: &mut Vec<NodeId>, first: NodeId, count: usize| {
        siblings.clear();
        siblings.extend(NodeId::range(first, count).map(|id| (origins.distance(&cut[id]), id)));
        siblings.sort_unstable();
        stack.extend(siblings.iter().map(|sibling| sibling.1));
    };
    push_near_first(&mut stack, NodeId(0), cut.roots);
    while let Some(id) = stack.pop() {
        let node = &cut[id];
        let members = visible(node);
        if members == 0 {
            continue;
        }
        match node.first_child {
            None => cells.push((id, members)),
            Some(first) => push_near_first(&mut stack, first, node.children as usize),
        }
    }
    cells
}

/// Per level and axis, the origin of rays in grid positions; `None` where no ray moves along the axis.
struct Origins(Vec<[Option<i64>; 3]>);

impl Origins {
    fn new(source: &dyn BrickSource, rays: &ViewRays, placement: &Placement) -> Self {
        let pyramid = source.pyramid();
        let eye = source.geometry().voxel_from_world(placement.volume_from_world(rays.eye)).to_array();
        let forward = placement.volume_vector(rays.middle()).to_array();
        let levels = pyramid.levels().iter().map(|level| {
            let bricks = level.bricks.to_array();
            std::array::from_fn(|a| {
                if rays.orthographic {
                    // Just outside the grid, on the side from which the rays come.
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
