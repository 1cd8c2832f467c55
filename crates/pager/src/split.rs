//! Derivation of cuts from the last ones, for one volume or for several sharing a number of cells.
//!
//! The result has one definition. Cells are split in the order of their screen-space errors, weighted by visibility (see [`visibility`];
//! hidden cells are not split), largest first across all volumes (ties: coarse first, then least brick id), until a split does not fit. A
//! larger budget makes the same splits and then more: no cell is ever coarser for having more slots. *Hysteresis* favours cells split in
//! the last cut: their errors count 1 / [`KEEP`] times as much, so only a cell worse by that factor displaces them; they stay split until
//! the error is below [`KEEP`] of the target, but are the first to yield where room runs out.
//!
//! Therefore: where not memory bound, no error is above the target, and every split of a cold cut is made; where memory bound, the largest
//! error is at most 1 / [`KEEP`] of the cold cut's; and a new cut for the same view is at least as fine.
//!
//! Volumes on one grid in one place, such as the channels of an image, share a tree, and can thus be drawn cell by cell. A node visible to
//! any of them is split for all, and takes up one cell per child and volume that sees it.
//!
//! The work is incremental and two-ended: one linear pass repeats the still necessary splits of the last cut; then heaps exchange the worst
//! unsplit cell for the least needed split, until nothing is out of order. The order is total, with ancestors before descendants, so the
//! outcome is the definition's.
//!
//! Costs 0.1 to 0.3 µs per cell for the linear pass and 0.3 to 0.5 µs per new split, whatever the volume's size.

use crate::cut::{Cut, Frusta, Members, Node, NodeId, OPEN, View, roots, world_box};
use crate::source::BrickSource;
use crate::visibility::{self, Visibility};
use brickyard_volume::{BrickIndex, Level, LevelPolicy, MAX_VOLUMES, ViewRays};
use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::sync::Arc;

/// Hysteresis: fraction of the target below which a split cell is merged. The cell must then be a quarter farther away than at its split:
/// more than a hand-held, orbiting or wobbling camera moves to and fro in a second, and short of the half at which its parent would have
/// been merged anyway. The price: on the way out, up to a quarter more of each level's radius is kept.
pub(crate) const KEEP: f64 = 0.8;

impl Cut {
    /// Cut of `source` for `view` with at most `max_cells` wanted cells. All coarsest bricks count, in the cut or not, as they are pinned.
    pub fn new(source: &dyn BrickSource, view: &View, max_cells: usize) -> Self {
        cuts(&[Subject { source, view, visibility: None }], max_cells, &[]).swap_remove(0)
    }

    /// Cut for a view following this cut's view, with at most `max_cells` wanted cells. Cells near the threshold stay as they are.
    pub fn next(&self, source: &dyn BrickSource, view: &View, max_cells: usize) -> Self {
        cuts(&[Subject { source, view, visibility: None }], max_cells, &[self]).swap_remove(0)
    }
}

/// A volume to cut.
#[derive(Clone, Copy)]
pub(crate) struct Subject<'a> {
    pub(crate) source: &'a dyn BrickSource,
    pub(crate) view: &'a View,
    /// Known visibility of the volume's cells, if any.
    pub(crate) visibility: Option<&'a Visibility>,
}

impl Subject<'_> {
    /// Whether `other` has the same grid in the same place, and the same eyes.
    fn shares_grid_with(&self, other: &Self) -> bool {
        let seen_as = |view: &View| {
            (view.rays, view.other_eye, view.level, view.window, view.pixel_error.to_bits(), view.placement)
        };
        self.source.pyramid() == other.source.pyramid()
            && self.source.geometry() == other.source.geometry()
            && seen_as(self.view) == seen_as(other.view)
    }
}

/// Groups of volumes that share something, such as a tree, by their indices: the groups in the order of their first volumes.
pub(crate) fn groups<T>(volumes: &[T], share: impl Fn(&T, &T) -> bool) -> Vec<Vec<usize>> {
    let mut groups: Vec<Vec<usize>> = Vec::new();
    for (i, volume) in volumes.iter().enumerate() {
        match groups.iter_mut().find(|members| share(&volumes[members[0]], volume)) {
            Some(members) => members.push(i),
            None => groups.push(vec![i]),
        }
    }
    groups
}

/// Results of all volumes in order, from those of each group's members.
pub(crate) fn by_volume<T>(groups: &[Vec<usize>], of_groups: impl Iterator<Item = Vec<T>>) -> Vec<T> {
    let of_members = groups.iter().zip(of_groups).flat_map(|(members, of_group)| members.iter().zip(of_group));
    let mut all: Vec<(&usize, T)> = of_members.collect();
    all.sort_by_key(|(i, _)| **i);
    all.into_iter().map(|(_, of_volume)| of_volume).collect()
}

/// Whether the cuts of volumes on one grid, seen alike, are made of one tree.
pub(crate) fn share_trees(subjects: &[Subject<'_>], cuts: &[Arc<Cut>]) -> bool {
    let groups = groups(subjects, Subject::shares_grid_with);
    groups.iter().all(|members| members.iter().all(|&i| cuts[i].shares_tree_with(&cuts[members[0]])))
}

/// Cuts of several volumes with at most `max_cells` wanted cells in total, following `last` unless that is empty.
pub(crate) fn cuts(subjects: &[Subject<'_>], max_cells: usize, last: &[&Cut]) -> Vec<Cut> {
    debug_assert!(subjects.len() <= MAX_VOLUMES, "{} volumes", subjects.len());
    let groups = groups(subjects, Subject::shares_grid_with);
    let build = |members: &Vec<usize>| {
        let last = last.get(members[0]).map_or(&[][..], |last| &last.nodes);
        Build::new(members.iter().map(|&i| subjects[i]).collect(), last)
    };
    let (trees, memory_bound) = Forest::new(groups.iter().map(build).collect(), max_cells).grow();
    let cuts = groups.iter().zip(&trees).map(|(members, Tree { nodes, roots })| {
        let cut = |(&i, member): (&usize, Members)| {
            Cut::of_tree(subjects[i].view.clone(), nodes, 1 << member, *roots, memory_bound)
        };
        members.iter().zip(0..).map(cut).collect()
    });
    by_volume(&groups, cuts)
}

/// A finished tree.
struct Tree {
    nodes: Arc<Vec<Node>>,
    roots: usize,
}

/// Order of splitting, the largest first. Errors are not negative, so their bits order as they do.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Key {
    /// False if only hysteresis keeps the split.
    is_called_for: bool,
    error_bits: u64,
    level: Level,
    index: Reverse<BrickIndex>,
    build: usize,
    node: NodeId,
}

/// All trees sharing a number of cells.
struct Forest<'a> {
    builds: Vec<Build<'a>>,
    max_cells: usize,
    /// Wanted cells, plus all roots and every split node without a visible child. Thus no split lowers the count, and the order does not
    /// affect what fits.
    count: usize,
}

impl<'a> Forest<'a> {
    fn new(builds: Vec<Build<'a>>, max_cells: usize) -> Self {
        let count = builds.iter().map(|build| build.roots * build.subjects.len()).sum();
        Self { builds, max_cells, count }
    }

    /// Returns the trees, and whether a necessary split did not fit.
    fn grow(mut self) -> (Vec<Tree>, bool) {
        let mut splits = Vec::new();
        for build in 0..self.builds.len() {
            self.repeat_splits(build, &mut splits);
        }
        let memory_bound = self.exchange(splits);
        (self.builds.into_iter().map(Build::finish).collect(), memory_bound)
    }

    /// Repeats the still necessary splits of a tree's last cut. Collects the other cells to split.
    fn repeat_splits(&mut self, build: usize, splits: &mut Vec<Key>) {
        let mut node = NodeId(0);
        while node.index() < self.builds[build].nodes.len() {
            match self.key(build, node) {
                Some(_) if self.builds[build].was_split(node) => self.count += self.builds[build].split(node),
                Some(key) => splits.push(key),
                None => {}
            }
            node.0 += 1;
        }
    }

    /// Splits the worst cells in exchange for the least needed splits. Returns whether a necessary split did not fit.
    fn exchange(&mut self, splits: Vec<Key>) -> bool {
        let mut splits = BinaryHeap::from(splits);
        let mut merges = None;
        while self.count > self.max_cells {
            let Some(merged) = self.merge_least(&mut merges, None) else { break };
            splits.push(merged);
        }
        while let Some(worst) = splits.pop() {
            self.count += self.builds[worst.build].split(worst.node);
            while self.count > self.max_cells {
                match self.merge_least(&mut merges, Some(worst)) {
                    Some(merged) => splits.push(merged),
                    None => {
                        self.count -= self.builds[worst.build].undo(worst.node);
                        return worst.is_called_for;
                    }
                }
            }
            let children = self.builds[worst.build].node(worst.node).children();
            splits.extend(children.filter_map(|child| self.key(worst.build, child)));
        }
        false
    }

    /// Merges the last node in the splitting order, if it comes after `limit`.
    fn merge_least(&mut self, merges: &mut Option<BinaryHeap<Reverse<Key>>>, limit: Option<Key>) -> Option<Key> {
        let merges = merges.get_or_insert_with(|| {
            let of_build = |(i, build): (usize, &Build<'_>)| {
                let mergeable = build.ids().filter(|&node| build.is_mergeable(node));
                mergeable.filter_map(|node| self.key(i, node).map(Reverse)).collect::<Vec<_>>()
            };
            self.builds.iter().enumerate().flat_map(of_build).collect()
        });
        loop {
            let Reverse(least) = *merges.peek()?;
            if limit.is_some_and(|limit| least >= limit) {
                return None;
            }
            merges.pop();
            let build = &mut self.builds[least.build];
            // It may have been merged since, or one of its children split.
            if !build.is_mergeable(least.node) {
                continue;
            }
            self.count -= build.merge(least.node);
            let parent = build.node(least.node).parent;
            if parent != least.node && build.is_mergeable(parent) {
                merges.extend(self.key(least.build, parent).map(Reverse));
            }
            return Some(least);
        }
    }

    /// A node's place in the order of splitting; `None` if it stays whole.
    fn key(&self, build: usize, node: NodeId) -> Option<Key> {
        let of = &self.builds[build];
        let Node { level, index, error_px, weight, .. } = *of.node(node);
        let was_split = of.was_split(node);
        let view = of.view();
        let (is_called_for, is_kept) = match view.level {
            LevelPolicy::Auto => (error_px > view.pixel_error, error_px > view.pixel_error * KEEP),
            LevelPolicy::Locked(locked) => (level.0 > locked, false),
        };
        if of.node(node).seen() == 0 || level.0 == 0 || !(is_called_for || was_split && is_kept) {
            return None;
        }
        let error = error_px * visibility::factor(weight);
        let error = if was_split { error / KEEP } else { error };
        Some(Key { is_called_for, error_bits: error.to_bits(), level, index: Reverse(index), build, node })
    }
}

/// A tree in the making, and the volumes sharing it.
struct Build<'a> {
    subjects: Vec<Subject<'a>>,
    frusta: Frusta,
    voxel_size: f64,
    last: &'a [Node],
    nodes: Vec<Node>,
    /// For each node, the same node of the last cut, if any.
    twins: Vec<Option<NodeId>>,
    roots: usize,
    /// Whether the arena holds unreachable nodes.
    has_merged: bool,
}

impl<'a> Build<'a> {
    /// Starts a tree with the roots.
    fn new(subjects: Vec<Subject<'a>>, last: &'a [Node]) -> Self {
        let Subject { source, view, .. } = subjects[0];
        // Finer levels would show the most stretched direction.
        let voxel_size =
            source.geometry().voxel_size(source.pyramid().levels()[0].extent) * view.placement.stretches().0;
        let (nodes, twins) = (Vec::with_capacity(last.len() + last.len() / 8), Vec::with_capacity(last.len()));
        let (frusta, roots_of) = (view.frusta(), roots(source, view.time, view.channel));
        let (roots, has_merged) = (roots_of.len(), false);
        let mut build = Self { subjects, frusta, voxel_size, last, nodes, twins, roots, has_merged };
        for (id, root) in NodeId::range(NodeId(0), roots).zip(roots_of) {
            build.push(root.level, root.index, id, (!last.is_empty()).then_some(id));
        }
        build
    }

    /// The shared view, except for its shown content.
    fn view(&self) -> &'a View {
        self.subjects[0].view
    }

    fn node(&self, id: NodeId) -> &Node {
        &self.nodes[id.index()]
    }

    fn ids(&self) -> impl Iterator<Item = NodeId> + use<> {
        NodeId::range(NodeId(0), self.nodes.len())
    }

    fn finish(self) -> Tree {
        let nodes = if self.has_merged { without_dead(&self.nodes, self.roots) } else { self.nodes };
        Tree { nodes: Arc::new(nodes), roots: self.roots }
    }

    fn is_mergeable(&self, id: NodeId) -> bool {
        let node = self.node(id);
        !node.is_cell() && node.children().all(|child| self.node(child).is_cell())
    }

    fn twin(&self, id: NodeId) -> Option<&Node> {
        self.twins[id.index()].map(|twin| &self.last[twin.index()])
    }

    fn was_split(&self, id: NodeId) -> bool {
        self.twin(id).is_some_and(|twin| !twin.is_cell())
    }

    /// Splits a node. Returns the cells that this adds to the count.
    fn split(&mut self, id: NodeId) -> usize {
        let Node { level, index, .. } = *self.node(id);
        let mut twins = self.twin(id).filter(|twin| !twin.is_cell()).map(Node::children);
        let first = NodeId(self.nodes.len() as u32);
        for child in self.subjects[0].source.pyramid().children(level, index) {
            let twin = twins.as_mut().and_then(Iterator::next);
            self.push(Level(level.0 - 1), child, id, twin);
        }
        let children = (self.nodes.len() - first.index()) as u8;
        let node = &mut self.nodes[id.index()];
        (node.first_child, node.children) = (Some(first), children);
        self.gain(id)
    }

    /// Merges a node. Returns the cells that this takes from the count.
    fn merge(&mut self, id: NodeId) -> usize {
        let gain = self.gain(id);
        let node = &mut self.nodes[id.index()];
        (node.first_child, node.children) = (None, 0);
        self.has_merged = true;
        gain
    }

    /// Undoes the newest split. Returns the cells that this takes from the count.
    fn undo(&mut self, id: NodeId) -> usize {
        let gain = self.gain(id);
        let node = &mut self.nodes[id.index()];
        let first = node.first_child.take();
        node.children = 0;
        self.nodes.truncate(first.map_or(self.nodes.len(), NodeId::index));
        self.twins.truncate(self.nodes.len());
        gain
    }

    /// Cells that the split of a node adds to the count.
    fn gain(&self, id: NodeId) -> usize {
        let node = self.node(id);
        let (mut seen, mut of_any) = (0, 0);
        for child in node.children() {
            let by = self.node(child).seen();
            seen += by.count_ones() as usize;
            of_any |= by;
        }
        if id.index() < self.roots {
            return seen;
        }
        // A volume that sees the node but none of its children keeps the node's cell in the count.
        seen + (node.seen() & !of_any).count_ones() as usize - node.seen().count_ones() as usize
    }

    fn push(&mut self, level: Level, index: BrickIndex, parent: NodeId, twin: Option<NodeId>) {
        let Subject { source, view, .. } = self.subjects[0];
        let twin_box = twin.map(|twin| (self.last[twin.index()].low, self.last[twin.index()].high));
        let (low, high) = twin_box.unwrap_or_else(|| world_box(source, level, index));
        let pixel_size = |rays: &ViewRays| rays.pixel_size(view.distance(rays, low, high));
        let least_pixel = view.eyes().map(pixel_size).fold(f64::INFINITY, f64::min);
        let error_px = self.voxel_size * (1u64 << level.0) as f64 / least_pixel;
        let (first_child, children) = (None, 0);
        // No more light than at the parent, so an ancestor is never split after its descendants.
        let most = self.nodes.get(parent.index()).map_or(OPEN, |parent| parent.weight);
        let mut node =
            Node { level, index, low, high, error_px, parent, first_child, children, weight: most, visible: 0 };
        node.visible = visible_to(&self.subjects, &self.frusta, &node);
        // Parts of one volume hidden by another are visible in neither; unknown visibility counts as visible.
        let known = |(i, subject): (usize, &Subject<'_>)| {
            let weight = subject.visibility.and_then(|visibility| visibility.weight(subject.view, &node));
            if node.visible >> i & 1 != 0 { weight.unwrap_or(OPEN) } else { 0 }
        };
        let weight = self.subjects.iter().enumerate().map(known).max().filter(|_| node.visible != 0);
        node.weight = weight.map_or(most, |weight| weight.min(most));
        self.nodes.push(node);
        self.twins.push(twin);
    }
}

/// Members of a shared tree with something in this box: in the frustum and not empty.
fn visible_to(subjects: &[Subject<'_>], frusta: &Frusta, &Node { level, index, low, high, .. }: &Node) -> Members {
    if !frusta.meet_box(low, high) {
        return 0;
    }
    let is_visible =
        |Subject { source, view, .. }: &Subject<'_>| view.shows(*source, view.id(level, index), (low, high));
    subjects.iter().zip(0..).fold(0, |all, (subject, i)| all | (is_visible(subject) as Members) << i)
}

/// The cells of these cuts at the views' time steps and channels: a guess at the cells wanted there.
pub(crate) fn recut(cuts: &[Arc<Cut>], sources: &[Arc<dyn BrickSource>], views: &[View]) -> Vec<Arc<Cut>> {
    let at = |(cut, view): (&Arc<Cut>, &View)| View { time: view.time, channel: view.channel, ..cut.view.clone() };
    let views: Vec<View> = cuts.iter().zip(views).map(at).collect();
    let groups = groups(cuts, |a, b| a.shares_tree_with(b));
    let recut = groups.iter().map(|members| {
        let subject = |&i: &usize| Subject { source: &*sources[i], view: &views[i], visibility: None };
        let subjects: Vec<Subject<'_>> = members.iter().map(subject).collect();
        let frusta = subjects[0].view.frusta();
        let renewed = |node: &Node| Node { visible: visible_to(&subjects, &frusta, node), weight: OPEN, ..*node };
        let nodes = Arc::new(cuts[members[0]].nodes.iter().map(renewed).collect());
        let cut = |&i: &usize| {
            let Cut { member, roots, memory_bound, .. } = *cuts[i];
            Arc::new(Cut::of_tree(views[i].clone(), &nodes, member, roots, memory_bound))
        };
        members.iter().map(cut).collect()
    });
    by_volume(&groups, recut)
}

/// A tree without its unreachable nodes.
fn without_dead(nodes: &[Node], roots: usize) -> Vec<Node> {
    let mut kept: Vec<Node> = nodes[..roots].to_vec();
    let mut at = NodeId(0);
    while at.index() < kept.len() {
        let children = kept[at.index()].children();
        if !kept[at.index()].is_cell() {
            kept[at.index()].first_child = Some(NodeId(kept.len() as u32));
            kept.extend(children.map(|child| Node { parent: at, ..nodes[child.index()] }));
        }
        at.0 += 1;
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
        // A tenth nearer to and farther from the nearest corner than before, with room and without.
        for max_cells in [80, 600] {
            let mut cut = Cut::new(&source, &view, max_cells);
            let mut changes = Vec::new();
            for step in 0..8 {
                view.rays.eye = eye * if step % 2 == 0 { 0.97 } else { 1.03 };
                let next = cut.next(&source, &view, max_cells);
                let ids = |cut: &Cut| cut.ids().map(|node| cut.id(node)).collect::<Vec<_>>();
                changes.push(ids(&next) != ids(&cut));
                cut = next;
            }
            assert_eq!(changes[2..], [false; 6], "{max_cells}");
        }
    }
}
