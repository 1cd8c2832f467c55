//! How a cut is made from the last one.
//!
//! There is one definition. Cells are split in the order of their screen-space errors, weighted by what is seen of them (see
//! [`visibility`]; what is hidden is not split), largest first (ties: coarse first,
//! then least brick id), and the first split that does not fit ends the work. So a larger budget makes the same splits
//! and then more: no cell is ever coarser for having more slots. Cells that the last cut had split have an advantage, the
//! *hysteresis*: their errors count [`KEEP`] times less, in other words others must be worse by 1 / [`KEEP`] to displace
//! them; and they stay split until the error is below [`KEEP`] of the target, but as the first to yield where room runs out.
//!
//! Therefore: where not memory bound, no error is above the target, and whatever a cold cut splits is split; where memory
//! bound, the largest error is at most 1 / [`KEEP`] of the cold cut's; and a cut made anew for the same view is at least as fine.
//!
//! The work is incremental and two-ended: one linear pass repeats those splits of the last cut that are still called for;
//! then heaps exchange the worst cell that is not split for the least needed split, until nothing is out of order. The
//! order is total, and an ancestor is never after its descendants, so the outcome is the definition's.
//!
//! Cost: 0.1 to 0.3 µs a cell for the linear pass, 0.3 to 0.5 for each split that is new, whatever the volume's size.

use crate::cut::{Cut, Frusta, LEAF, Node, OPEN, View, roots, world_box};
use crate::source::BrickSource;
use crate::visibility::{self, Visibility};
use brickyard_volume::{BrickIndex, Level, LevelPolicy, ViewRays};
use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// Hysteresis. A cell that is split where its error passes the target has to be a quarter farther away before it is merged:
/// more than what a hand-held, orbiting or wobbling camera moves to and fro in a second, and short of the half at which
/// its parent would have been merged anyway. The price: on the way out, up to a quarter more of each level's radius is kept.
pub(crate) const KEEP: f64 = 0.8;

impl Cut {
    /// The cut of `source` for `view` that wants at most `max_cells` cells, all bricks of the coarsest level always counted
    /// (they are pinned, so they hold their slots whether they are in the cut or not).
    pub fn new(source: &dyn BrickSource, view: &View, max_cells: usize) -> Self {
        cut(source, view, max_cells, None, None)
    }

    /// The same for a view that follows this cut's: cells near the threshold stay as they are.
    pub fn next(&self, source: &dyn BrickSource, view: &View, max_cells: usize) -> Self {
        cut(source, view, max_cells, Some(self), None)
    }
}

/// The cut for a view, after `last`.
pub(crate) fn cut(
    source: &dyn BrickSource,
    view: &View,
    max_cells: usize,
    last: Option<&Cut>,
    visibility: Option<&Visibility>,
) -> Cut {
    let mut build = Build::new(source, view, max_cells, last, visibility);
    let splits = build.repeat_splits();
    let memory_bound = build.exchange(splits);
    let Build { mut nodes, roots, has_merged, .. } = build;
    if has_merged {
        nodes = without_dead(&nodes, roots);
    }
    let wanted = nodes.iter().filter(|n| n.is_wanted());
    let effective_error_px = wanted.clone().filter(|n| n.level.0 > 0).map(|n| n.error_px).fold(0.0, f64::max);
    let wanted = wanted.count();
    Cut { view: view.clone(), nodes, roots, wanted, effective_error_px, memory_bound }
}

/// The order of splitting: the largest first. Errors are not negative, so their bits order as they do.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Key {
    /// False for what only hysteresis keeps.
    is_called_for: bool,
    error_bits: u64,
    level: Level,
    index: Reverse<BrickIndex>,
    position: u32,
}

struct Build<'a> {
    source: &'a dyn BrickSource,
    view: &'a View,
    frusta: Frusta,
    voxel_size: f64,
    max_cells: usize,
    last: &'a [Node],
    visibility: Option<&'a Visibility>,
    nodes: Vec<Node>,
    /// Of each node, the position of the same node in the last cut; [`LEAF`] if it was not there.
    twins: Vec<u32>,
    roots: usize,
    /// Wanted cells with all roots counted, and with a split node counted that has no seen child: so that no split
    /// lowers it, and what fits does not depend on the order of the splits.
    count: usize,
    /// Whether the arena holds nodes that nothing leads to.
    has_merged: bool,
}

impl<'a> Build<'a> {
    fn new(
        source: &'a dyn BrickSource,
        view: &'a View,
        max_cells: usize,
        last: Option<&'a Cut>,
        visibility: Option<&'a Visibility>,
    ) -> Self {
        // What is stretched most is what finer levels would show.
        let voxel_size =
            source.geometry().voxel_size(source.pyramid().levels()[0].extent) * view.placement.stretches().0;
        let frusta = view.frusta();
        let last: &[Node] = last.map_or(&[], |last| &last.nodes);
        let (nodes, twins) = (Vec::with_capacity(last.len() + last.len() / 8), Vec::with_capacity(last.len()));
        let mut build = Self {
            source,
            view,
            frusta,
            voxel_size,
            max_cells,
            last,
            visibility,
            nodes,
            twins,
            roots: 0,
            count: 0,
            has_merged: false,
        };
        for root in roots(source, view.time, view.channel) {
            let position = build.nodes.len() as u32;
            build.push(root.level, root.index, position, if last.is_empty() { LEAF } else { position });
        }
        build.roots = build.nodes.len();
        build.count = build.roots;
        build
    }

    /// Splits what the last cut had split, as far as it is still called for. Returns the cells that others are to be split.
    fn repeat_splits(&mut self) -> Vec<Key> {
        let mut splits = Vec::new();
        let mut position = 0;
        while position < self.nodes.len() as u32 {
            match self.key(position) {
                Some(_) if self.was_split(position) => self.split(position),
                Some(key) => splits.push(key),
                None => {}
            }
            position += 1;
        }
        splits
    }

    /// Splits the worst cells in exchange for the least needed splits. Returns whether a split that is called for did not fit.
    fn exchange(&mut self, splits: Vec<Key>) -> bool {
        let mut splits = BinaryHeap::from(splits);
        let mut merges = None;
        while self.count > self.max_cells {
            let Some(merged) = self.merge_least(&mut merges, None) else { break };
            splits.push(merged);
        }
        while let Some(worst) = splits.pop() {
            self.split(worst.position);
            while self.count > self.max_cells {
                match self.merge_least(&mut merges, Some(worst)) {
                    Some(merged) => splits.push(merged),
                    None => {
                        self.undo(worst.position);
                        return worst.is_called_for;
                    }
                }
            }
            let Node { first_child, children, .. } = self.nodes[worst.position as usize];
            splits.extend((first_child..first_child + children as u32).filter_map(|child| self.key(child)));
        }
        false
    }

    /// Merges the node that is split last of all, if it comes after `limit`.
    fn merge_least(&mut self, merges: &mut Option<BinaryHeap<Reverse<Key>>>, limit: Option<Key>) -> Option<Key> {
        let merges = merges.get_or_insert_with(|| {
            let mergeable = (0..self.nodes.len() as u32).filter(|&position| self.is_mergeable(position));
            mergeable.filter_map(|position| self.key(position).map(Reverse)).collect()
        });
        loop {
            let Reverse(least) = *merges.peek()?;
            if limit.is_some_and(|limit| least >= limit) {
                return None;
            }
            merges.pop();
            // It may have been merged, or one of its children split, since it was put here.
            if !self.is_mergeable(least.position) {
                continue;
            }
            self.merge(least.position);
            let parent = self.nodes[least.position as usize].parent;
            if parent != least.position && self.is_mergeable(parent) {
                merges.extend(self.key(parent).map(Reverse));
            }
            return Some(least);
        }
    }

    /// Whether a node is split into cells.
    fn is_mergeable(&self, position: u32) -> bool {
        let Node { first_child, children, .. } = self.nodes[position as usize];
        let of = |children: u8| first_child as usize..first_child as usize + children as usize;
        first_child != LEAF && self.nodes[of(children)].iter().all(Node::is_cell)
    }

    fn was_split(&self, position: u32) -> bool {
        let twin = self.twins[position as usize];
        twin != LEAF && !self.last[twin as usize].is_cell()
    }

    /// Where a node comes in the order of splitting; `None` if it is not to be split.
    fn key(&self, position: u32) -> Option<Key> {
        let node = &self.nodes[position as usize];
        let Node { level, index, error_px, .. } = *node;
        let was_split = self.was_split(position);
        let (is_called_for, is_kept) = match self.view.level {
            LevelPolicy::Auto => (error_px > self.view.pixel_error, error_px > self.view.pixel_error * KEEP),
            LevelPolicy::Locked(locked) => (level.0 > locked, false),
        };
        if !node.is_seen() || level.0 == 0 || !(is_called_for || was_split && is_kept) {
            return None;
        }
        let error = error_px * visibility::factor(node.weight);
        let error = if was_split { error / KEEP } else { error };
        Some(Key { is_called_for, error_bits: error.to_bits(), level, index: Reverse(index), position })
    }

    fn split(&mut self, position: u32) {
        let Node { level, index, .. } = self.nodes[position as usize];
        let twin = self.twins[position as usize];
        let first_twin = if twin == LEAF { LEAF } else { self.last[twin as usize].first_child };
        let first = self.nodes.len();
        for (i, child) in self.source.pyramid().children(level, index).enumerate() {
            let twin = if first_twin == LEAF { LEAF } else { first_twin + i as u32 };
            self.push(Level(level.0 - 1), child, position, twin);
        }
        let node = &mut self.nodes[position as usize];
        (node.first_child, node.children) = (first as u32, (self.twins.len() - first) as u8);
        self.count += self.gain(position);
    }

    fn merge(&mut self, position: u32) {
        self.count -= self.gain(position);
        self.nodes[position as usize].first_child = LEAF;
        self.has_merged = true;
    }

    /// Takes the newest split back.
    fn undo(&mut self, position: u32) {
        self.count -= self.gain(position);
        let node = &mut self.nodes[position as usize];
        let first = std::mem::replace(&mut node.first_child, LEAF) as usize;
        self.nodes.truncate(first);
        self.twins.truncate(first);
    }

    /// What the split of a node adds to the count.
    fn gain(&self, position: u32) -> usize {
        let Node { first_child, children, .. } = self.nodes[position as usize];
        let children = &self.nodes[first_child as usize..][..children as usize];
        let seen = children.iter().filter(|child| child.is_seen()).count();
        if (position as usize) < self.roots { seen } else { seen.max(1) - 1 }
    }

    fn push(&mut self, level: Level, index: BrickIndex, parent: u32, twin: u32) {
        let twin_box = self.last.get(twin as usize).map(|node| (node.low, node.high));
        let (low, high) = twin_box.unwrap_or_else(|| world_box(self.source, level, index));
        let is_in_sight = self.frusta.meet_box(low, high) && self.view.is_inside_clip(low, high);
        let is_visible = is_in_sight && self.view.shows(self.source, self.view.id(level, index));
        let pixel_size = |rays: &ViewRays| rays.pixel_size(self.view.distance(rays, low, high));
        let least_pixel = self.view.eyes().map(pixel_size).fold(f64::INFINITY, f64::min);
        let error_px = self.voxel_size * (1u64 << level.0) as f64 / least_pixel;
        let (first_child, children) = (LEAF, 0);
        let mut node =
            Node { level, index, low, high, error_px, parent, first_child, children, is_visible, weight: OPEN };
        // No more can come here than to what holds it: so an ancestor is never split after its descendants.
        node.weight = self.nodes.get(parent as usize).map_or(OPEN, |parent| parent.weight);
        if let Some(weight) = self.visibility.and_then(|visibility| visibility.weight(self.view, &node)) {
            node.weight = node.weight.min(weight);
        }
        self.nodes.push(node);
        self.twins.push(twin);
    }
}

/// The same tree without the nodes that nothing leads to.
fn without_dead(nodes: &[Node], roots: usize) -> Vec<Node> {
    let mut kept: Vec<Node> = nodes[..roots].to_vec();
    let mut position = 0;
    while position < kept.len() {
        if !kept[position].is_cell() {
            let Node { first_child, children, .. } = kept[position];
            kept[position].first_child = kept.len() as u32;
            let children = &nodes[first_child as usize..][..children as usize];
            kept.extend(children.iter().map(|&child| Node { parent: position as u32, ..child }));
        }
        position += 1;
    }
    kept
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cut::cut_capacity;
    use crate::test_source::{TestSource, box_view};
    use brickyard_volume::Projection;

    fn locked(level: u8) -> View {
        View {
            level: LevelPolicy::Locked(level),
            ..box_view(&TestSource::cube(64), Projection::Orthographic { height: 999.0 })
        }
    }

    #[test]
    fn a_locked_level_is_reached_where_it_fits() {
        let source = TestSource::cube(64);
        for (level, cells) in [(0, 512), (1, 64), (2, 8), (3, 1), (9, 1)] {
            let cut = Cut::new(&source, &locked(level), 1000);
            assert_eq!(cut.wanted(), cells);
            assert!(cut.cells().all(|id| id.level.0 == level.min(3)) && !cut.memory_bound());
        }
    }

    #[test]
    fn a_larger_budget_is_nowhere_coarser() {
        let source = TestSource::cube(64);
        let eye = glam::DVec3::new(-10.0, 20.0, 70.0);
        let mut view = box_view(&source, Projection::Perspective { fov_y_deg: 60.0 });
        view.rays.eye = eye;
        view.pixel_error = 0.1;
        let mut last: Option<Cut> = None;
        for max in 1..600 {
            let cut = Cut::new(&source, &view, max);
            assert!(cut.wanted() <= max);
            if let Some(last) = last {
                assert!(cut.effective_error_px() <= last.effective_error_px());
                // Every node of the smaller cut's tree is in the larger one's.
                assert!(last.nodes.iter().all(|a| cut.nodes.iter().any(|b| (a.level, a.index) == (b.level, b.index))));
            }
            last = Some(cut);
        }
        assert!(!last.unwrap().memory_bound());
    }

    #[test]
    fn errors_follow_the_distance() {
        let source = TestSource::cube(64);
        let mut view = box_view(&source, Projection::Perspective { fov_y_deg: 90.0 });
        // Edge 8 and 8 bricks a side at level 0; the eye 100 in front of the box: a pixel there is 2 * 100 / 512.
        view.rays.eye = glam::DVec3::new(31.5, 31.5, -100.5);
        view.rays.forward = glam::DVec3::Z;
        (view.rays.right, view.rays.up) = (glam::DVec3::X, glam::DVec3::Y);
        view.level = LevelPolicy::Locked(3);
        let cut = Cut::new(&source, &view, 1);
        assert!((cut.effective_error_px() - 8.0 / (200.0 / 512.0)).abs() < 1e-9);
        assert_eq!(cut_capacity(1, 1), 1);
        assert_eq!(cut_capacity(100, 1), 90);
    }

    #[test]
    fn a_camera_that_wobbles_changes_nothing() {
        let source = TestSource::cube(64);
        let mut view = box_view(&source, Projection::Perspective { fov_y_deg: 60.0 });
        view.pixel_error = 0.1;
        let eye = view.rays.eye;
        // One part in ten nearer and farther from the nearest corner than it was, with room and without.
        for max_cells in [80, 600] {
            let mut cut = Cut::new(&source, &view, max_cells);
            let mut changes = Vec::new();
            for step in 0..8 {
                view.rays.eye = eye * if step % 2 == 0 { 0.97 } else { 1.03 };
                let next = cut.next(&source, &view, max_cells);
                let ids = |cut: &Cut| (0..cut.nodes.len() as u32).map(|n| cut.id(n)).collect::<Vec<_>>();
                changes.push(ids(&next) != ids(&cut));
                cut = next;
            }
            assert_eq!(changes[2..], [false; 6], "{max_cells}");
        }
    }
}
