//! The cut: a disjoint octree covering of the whole volume, as fine as a view needs.
//!
//! Cells in the frustum, neither empty under the transfer function nor known to be hidden, are split until their screen-space error is
//! below the target; all others stay coarse and invisible. Since these cover the rest, a frame may draw an older cut with a newer camera
//! and leave nothing out (see [`VisibleCells`](crate::visible_cells::VisibleCells)).
//!
//! The tree lies in one arena, parents before children, siblings contiguous; later steps walk it in linear passes. Volumes on one grid in
//! one place, such as the channels of an image, share a tree, split wherever any of them needs it. A cut is a value, from which the next is
//! computed ([`split`](crate::split)). Pure: no residency, no I/O.

use crate::neighbourhood::Part;
use crate::source::BrickSource;
use brickyard_volume::{
    BrickId, BrickIndex, Clip, Filter, Frustum, Lattice, Level, LevelPolicy, Occupancy, PixelRect, Placement, ViewRays,
};
use glam::DVec3;
use std::ops::Index;
use std::sync::Arc;

/// Shown part of a volume: everything that decides a cut, besides the data.
#[derive(Clone, Debug, PartialEq)]
pub struct View {
    /// The camera, resolved for the picture's size.
    pub rays: ViewRays,
    /// The other eye of a stereo pair, if any. Cells visible to either eye are shown, at the nearer eye's level.
    pub other_eye: Option<ViewRays>,
    /// Visible value bins; bricks without any are left out. `None` keeps every brick (MIP and the like).
    pub opaque: Option<Occupancy>,
    /// Caps on the clip's cut faces; `None` without any.
    pub caps: Option<Caps>,
    /// Interpolation between voxels. A brick is empty only if all voxels read by its samples are.
    pub filter: Filter,
    /// Policy for choosing the level.
    pub level: LevelPolicy,
    /// The only wanted pixels, in the picture of each eye; `None` for all.
    pub window: Option<PixelRect>,
    /// Most pixels per voxel under [`LevelPolicy::Auto`].
    pub pixel_error: f64,
    /// The shown time step.
    pub time: u32,
    /// The shown channel.
    pub channel: u32,
    /// Shown part of the volume, in its own world; `None` for all of it.
    pub clip: Option<Clip>,
    /// Placement of the volume's own world, given by its source's geometry, in the world of the rays.
    pub placement: Placement,
    /// Identifies the appearance: differs if the same brick may hide different things, as with other opacities or another mode.
    pub appearance: u64,
}

/// Faces closing surfaces at a clip's cut, visible besides the bricks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Caps {
    /// Value bins with caps.
    pub bins: Occupancy,
    /// Lattice of the longest drawn segments: bricks next to the cut hold the middles of some segments shortened by it.
    pub lattice: Lattice,
}

impl View {
    /// This view from its other eye, with the same cells in another order; unchanged for a single eye.
    pub fn from_other_eye(&self) -> Self {
        match self.other_eye {
            Some(rays) => Self { rays, other_eye: Some(self.rays), ..self.clone() },
            None => self.clone(),
        }
    }

    pub(crate) fn eyes(&self) -> impl Iterator<Item = &ViewRays> {
        std::iter::once(&self.rays).chain(&self.other_eye)
    }

    /// Frusta of the eyes, in the volume's own world.
    pub(crate) fn frusta(&self) -> Frusta {
        let frustum = |rays: &ViewRays| rays.frustum_of(self.window.unwrap_or(rays.whole())).in_volume(&self.placement);
        Frusta(frustum(&self.rays), self.other_eye.as_ref().map(frustum))
    }

    /// Lower bound of the distance from an eye to a box of the volume's own world. Exact for placements that only turn, scale or stretch
    /// along axes; else too small by at most the ratio of the greatest to the least stretch.
    pub(crate) fn distance(&self, rays: &ViewRays, low: DVec3, high: DVec3) -> f64 {
        let to_box = |eye: DVec3, low: DVec3, high: DVec3| eye.clamp(low, high).distance(eye);
        if self.placement.is_identity() {
            return to_box(rays.eye, low, high);
        }
        let (_, least_stretch) = self.placement.stretches();
        let own = to_box(self.placement.volume_from_world(rays.eye), low, high) * least_stretch;
        let (low, high) = self.placement.world_box((low, high));
        own.max(to_box(rays.eye, low, high))
    }

    /// Whether a brick with this box in the volume's own world may show anything.
    pub(crate) fn shows(&self, source: &dyn BrickSource, id: BrickId, (low, high): (DVec3, DVec3)) -> bool {
        if self.clip.as_ref().is_some_and(|clip| !clip.meets_box(low, high)) {
            return false;
        }
        let Some(mut mask) = self.opaque else { return true };
        if let (Some(caps), Some(clip)) = (&self.caps, &self.clip) {
            let is_cut = |rays: &ViewRays| clip.cuts_segments((low, high), &caps.lattice, &self.placement, rays.eye);
            if self.eyes().any(is_cut) {
                mask = mask.union(caps.bins);
            }
        }
        source.occupancy(id).meets(mask) || self.filter == Filter::Tricubic && self.shows_neighbour(source, id, mask)
    }

    /// Whether any neighbour of a brick is not empty. A brick's own occupancy includes one voxel around it; wider filters read another one.
    fn shows_neighbour(&self, source: &dyn BrickSource, id: BrickId, mask: Occupancy) -> bool {
        let grid = source.pyramid().level(id.level).bricks;
        Part::lenders(id.index, grid).any(|index| source.occupancy(BrickId { index, ..id }).meets(mask))
    }

    pub(crate) fn id(&self, level: Level, index: BrickIndex) -> BrickId {
        BrickId { time: self.time, channel: self.channel, level, index }
    }
}

/// The frusta of a view's one or two eyes.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Frusta(Frustum, Option<Frustum>);

impl Frusta {
    /// Whether the box may be visible to any of the eyes.
    pub(crate) fn meet_box(&self, low: DVec3, high: DVec3) -> bool {
        self.0.meets_box(low, high) || self.1.is_some_and(|frustum| frustum.meets_box(low, high))
    }
}

/// Most wanted cells of a cut, pinned roots included: nine tenths of the slots, to load the next brick before evicting the last, but never
/// fewer than the roots.
pub fn cut_capacity(slots: u32, roots: usize) -> usize {
    (slots as usize * 9 / 10).max(roots)
}

/// Index of a node in the arena of a cut's tree.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(crate) struct NodeId(pub(crate) u32);

impl NodeId {
    pub(crate) fn index(self) -> usize {
        self.0 as usize
    }

    /// Ids of `count` consecutive nodes in the arena, from `first` on.
    pub(crate) fn range(first: Self, count: usize) -> impl Iterator<Item = Self> + Clone {
        (first.0..first.0 + count as u32).map(Self)
    }
}

/// Set of volumes sharing a tree, one bit each, by their places among them.
pub(crate) type Members = u32;

/// A cell of the cut, or a split node.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Node {
    pub(crate) level: Level,
    pub(crate) index: BrickIndex,
    /// Low corner of the node's box in the volume's own world, opposite `high`.
    pub(crate) low: DVec3,
    pub(crate) high: DVec3,
    pub(crate) error_px: f64,
    /// The parent; the node's own id for a root.
    pub(crate) parent: NodeId,
    /// The first child; `None` for a cell of the cut.
    pub(crate) first_child: Option<NodeId>,
    pub(crate) children: u8,
    /// Most light of any ray at the node, as a weight (see [`visibility`](crate::visibility)); 0 if no ray arrives.
    pub(crate) weight: u8,
    /// Volumes for which the node is in the frustum and not empty.
    pub(crate) visible: Members,
}

/// The [weight](Node::weight) of a node seen in the open, or of unknown visibility.
pub(crate) const OPEN: u8 = 9;

impl Node {
    pub(crate) fn is_cell(&self) -> bool {
        self.first_child.is_none()
    }

    pub(crate) fn children(&self) -> impl Iterator<Item = NodeId> + use<> {
        NodeId::range(self.first_child.unwrap_or(self.parent), self.children as usize)
    }

    /// Volumes for which the node is visible and not hidden.
    pub(crate) fn seen(&self) -> Members {
        if self.weight > 0 { self.visible } else { 0 }
    }
}

/// An octree cut of a volume: a view's wanted cells, among cells covering the rest.
#[derive(Clone, Debug)]
pub struct Cut {
    pub(crate) view: View,
    /// The tree, which other volumes may share.
    pub(crate) nodes: Arc<Vec<Node>>,
    /// The volume's own bit among those sharing the tree.
    pub(crate) member: Members,
    /// Number of roots, which are the first nodes.
    pub(crate) roots: usize,
    pub(crate) wanted: usize,
    pub(crate) effective_error_px: f64,
    pub(crate) memory_bound: bool,
}

impl Index<NodeId> for Cut {
    type Output = Node;

    fn index(&self, id: NodeId) -> &Node {
        &self.nodes[id.index()]
    }
}

impl Cut {
    /// The view's cut of a tree, for the volume with this bit.
    pub(crate) fn of_tree(
        view: View,
        nodes: &Arc<Vec<Node>>,
        member: Members,
        roots: usize,
        memory_bound: bool,
    ) -> Self {
        let (nodes, wanted, effective_error_px) = (nodes.clone(), 0, 0.0);
        let mut cut = Self { view, nodes, member, roots, wanted, effective_error_px, memory_bound };
        let improvable = |id: NodeId| if cut[id].level.0 > 0 { cut[id].error_px } else { 0.0 };
        let errors = cut.wanted_cells().map(improvable);
        (cut.wanted, cut.effective_error_px) = errors.fold((0, 0.0), |(n, most), error| (n + 1, error.max(most)));
        cut
    }

    /// Wanted cells, in no particular order: in the view's frustum, not empty and not known to be hidden.
    pub fn cells(&self) -> impl Iterator<Item = BrickId> {
        self.wanted_cells().map(|node| self.id(node))
    }

    /// Number of wanted cells.
    pub fn wanted(&self) -> usize {
        self.wanted
    }

    /// Largest screen-space error in pixels among wanted cells coarser than level 0; 0 without any, infinite if the eye is inside one.
    pub fn effective_error_px(&self) -> f64 {
        self.effective_error_px
    }

    /// Whether the cut would be finer with room for more cells.
    pub fn memory_bound(&self) -> bool {
        self.memory_bound
    }

    /// Whether another volume's cut shares this one's tree.
    pub(crate) fn shares_tree_with(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.nodes, &other.nodes)
    }

    /// Whether a node is in the frustum and not empty.
    pub(crate) fn is_visible(&self, node: NodeId) -> bool {
        self[node].visible & self.member != 0
    }

    /// Whether a node is visible, but behind something opaque.
    pub(crate) fn is_hidden(&self, node: NodeId) -> bool {
        self.is_visible(node) && self[node].weight == 0
    }

    pub(crate) fn is_wanted(&self, node: NodeId) -> bool {
        self[node].is_cell() && self[node].seen() & self.member != 0
    }

    /// Ids of all nodes, parents before children.
    pub(crate) fn ids(&self) -> impl Iterator<Item = NodeId> + use<> {
        NodeId::range(NodeId(0), self.nodes.len())
    }

    pub(crate) fn path_to_root(&self, node: NodeId) -> impl Iterator<Item = NodeId> {
        let parent = |&node: &NodeId| Some(self[node].parent).filter(|parent| *parent != node);
        std::iter::successors(Some(node), parent)
    }

    /// Wanted cells, coarse first.
    pub(crate) fn wanted_cells(&self) -> impl Iterator<Item = NodeId> {
        self.ids().filter(|&node| self.is_wanted(node))
    }

    pub(crate) fn id(&self, node: NodeId) -> BrickId {
        self.view.id(self[node].level, self[node].index)
    }
}

pub(crate) fn roots(source: &dyn BrickSource, time: u32, channel: u32) -> Vec<BrickId> {
    let level = source.pyramid().coarsest();
    let grid = source.pyramid().level(level).bricks;
    let index = |i: u64| {
        let (x, y) = (grid.x as u64, grid.y as u64);
        BrickIndex::new((i % x) as u32, (i / x % y) as u32, (i / x / y) as u32)
    };
    (0..grid.volume()).map(|i| BrickId { time, channel, level, index: index(i) }).collect()
}

/// Corners of a brick's box in the volume's own world.
pub(crate) fn world_box(source: &dyn BrickSource, level: Level, index: BrickIndex) -> (DVec3, DVec3) {
    let cell = source.pyramid().brick_box_voxel(level, index);
    let corner = |v: [u32; 3]| source.geometry().world_from_voxel(DVec3::from_array(v.map(f64::from)));
    (corner(cell.min.to_array()), corner(cell.max.to_array()))
}
