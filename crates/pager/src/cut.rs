//! The cut: an octree cut of the whole volume, disjoint and covering, as fine as a view wants it.
//!
//! What is in the frustum, not empty under the transfer function and not known to be hidden is split until its screen-space
//! error is below the target; everything else stays as coarse as it is met, visible to nobody. So a cut also has a cell for
//! what another camera sees: a frame may draw an older cut with a newer camera, and still leaves nothing out (see
//! [`VisibleCells`](crate::visible_cells::VisibleCells)).
//!
//! The nodes stay in one arena as a tree, parents before children, all children of a split node contiguous; later steps walk
//! it in linear passes. Volumes that stand on one grid in one place, as the channels of an image do, share one tree: a node is split for
//! all that see it. A cut is a value: the next one is computed from it ([`split`](crate::split)). Pure: no residency, no I/O.

use crate::source::BrickSource;
use brickyard_volume::{
    BrickId, BrickIndex, Clip, Filter, Frustum, Lattice, Level, LevelPolicy, Occupancy, PixelRect, Placement, ViewRays,
};
use glam::DVec3;
use std::ops::Index;
use std::sync::Arc;

/// What is to be shown of a volume: everything that decides a cut, besides the data.
#[derive(Clone, Debug, PartialEq)]
pub struct View {
    /// The camera, resolved for the picture's size.
    pub rays: ViewRays,
    /// The other eye of a stereo pair; `None` for a single eye. What either eye sees is shown, at the level that the nearer eye wants.
    pub other_eye: Option<ViewRays>,
    /// The value bins that can be seen; bricks with none of them are left out. `None` keeps every brick (MIP and the like).
    pub opaque: Option<Occupancy>,
    /// Caps on what the clip cuts through; `None` without any.
    pub caps: Option<Caps>,
    /// How the field is interpolated between voxels. A brick is empty only if all voxels that its samples read are.
    pub filter: Filter,
    /// Which level the view wants.
    pub level: LevelPolicy,
    /// The only pixels that are wanted, in the picture of each eye; `None` wants all.
    pub window: Option<PixelRect>,
    /// How many pixels a voxel may cover under [`LevelPolicy::Auto`].
    pub pixel_error: f64,
    /// The time step that is shown.
    pub time: u32,
    /// The channel that is shown.
    pub channel: u32,
    /// The part of the volume that is shown, in the volume's own world; `None` shows everything.
    pub clip: Option<Clip>,
    /// The placement of the volume's own world, which its source's geometry gives, in the world of the rays.
    pub placement: Placement,
    /// A number that differs between views in which the same brick may hide different things: those with other opacities or another mode.
    pub appearance: u64,
}

/// What can be seen besides of the bricks on a cut: the faces that close surfaces there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Caps {
    /// The value bins that have caps.
    pub bins: Occupancy,
    /// The lattice of the longest segments that are drawn: a brick next to the cut holds the middles of some that the cut shortens.
    pub lattice: Lattice,
}

impl View {
    /// This view from its other eye, which sees the same cells in another order; the view as it is if it has one eye.
    pub fn from_other_eye(&self) -> Self {
        match self.other_eye {
            Some(rays) => Self { rays, other_eye: Some(self.rays), ..self.clone() },
            None => self.clone(),
        }
    }

    /// The view's eyes: one, or two.
    pub(crate) fn eyes(&self) -> impl Iterator<Item = &ViewRays> {
        std::iter::once(&self.rays).chain(&self.other_eye)
    }

    /// The frusta of the view's eyes, in the volume's own world.
    pub(crate) fn frusta(&self) -> Frusta {
        let frustum = |rays: &ViewRays| rays.frustum_of(self.window.unwrap_or(rays.whole())).in_volume(&self.placement);
        Frusta(frustum(&self.rays), self.other_eye.as_ref().map(frustum))
    }

    /// A lower bound of the distance from an eye to a box of the volume's own world. It is exact where the placement only turns and scales, or
    /// stretches along axes; else it is too small by at most as much as the placement stretches one direction more than another.
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

    /// Whether a box of the volume's own world may have a part that is shown.
    pub(crate) fn is_inside_clip(&self, low: DVec3, high: DVec3) -> bool {
        self.clip.as_ref().is_none_or(|clip| clip.meets_box(low, high))
    }

    /// Whether a brick, with this box of the volume's own world, can show something under this view: whether it is not empty.
    pub(crate) fn shows(&self, source: &dyn BrickSource, id: BrickId, (low, high): (DVec3, DVec3)) -> bool {
        let Some(mut mask) = self.opaque else { return true };
        if let (Some(caps), Some(clip)) = (&self.caps, &self.clip) {
            let is_cut = |rays: &ViewRays| clip.cuts_segments((low, high), &caps.lattice, &self.placement, rays.eye);
            if self.eyes().any(is_cut) {
                mask = mask.union(caps.bins);
            }
        }
        source.occupancy(id).meets(mask) || self.filter == Filter::Tricubic && self.shows_neighbour(source, id, mask)
    }

    /// Whether one of the bricks around a brick is not empty. A brick's own occupancy holds for the voxel next to it; wider
    /// filters take in another one.
    fn shows_neighbour(&self, source: &dyn BrickSource, id: BrickId, mask: Occupancy) -> bool {
        let (index, count) = (id.index.to_array(), source.pyramid().level(id.level).bricks.to_array());
        (0..27).any(|i| {
            // One more than the offset along each axis.
            let at: [u32; 3] = std::array::from_fn(|a| index[a] + i / 3u32.pow(a as u32) % 3);
            let is_there = (0..3).all(|a| (1..=count[a]).contains(&at[a]));
            is_there && source.occupancy(BrickId { index: BrickIndex::from_array(at.map(|v| v - 1)), ..id }).meets(mask)
        })
    }

    pub(crate) fn id(&self, level: Level, index: BrickIndex) -> BrickId {
        BrickId { time: self.time, channel: self.channel, level, index }
    }
}

/// The frusta of a view's one or two eyes.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Frusta(Frustum, Option<Frustum>);

impl Frusta {
    /// Whether any of the eyes may see the box.
    pub(crate) fn meet_box(&self, low: DVec3, high: DVec3) -> bool {
        self.0.meets_box(low, high) || self.1.is_some_and(|frustum| frustum.meets_box(low, high))
    }
}

/// The number of cells that a cut may want, the pinned roots included, given this many slots: nine tenths of them, so that there is room
/// to bring in the next brick before the last goes, but never fewer than the roots.
pub fn cut_capacity(slots: u32, roots: usize) -> usize {
    (slots as usize * 9 / 10).max(roots)
}

/// A node's index in the arena of a cut's tree.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(crate) struct NodeId(pub(crate) u32);

impl NodeId {
    pub(crate) fn index(self) -> usize {
        self.0 as usize
    }

    /// The ids of `count` neighbouring nodes in the arena, from `first` on.
    pub(crate) fn range(first: Self, count: usize) -> impl Iterator<Item = Self> + Clone {
        (first.0..first.0 + count as u32).map(Self)
    }
}

/// A set of the volumes that share a tree: one bit for each volume, by its place among them.
pub(crate) type Members = u32;

/// A node of the arena: a cell of the cut, or one that was split.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Node {
    pub(crate) level: Level,
    pub(crate) index: BrickIndex,
    /// The low corner of the node's box in the volume's own world; `high` is the opposite one.
    pub(crate) low: DVec3,
    pub(crate) high: DVec3,
    pub(crate) error_px: f64,
    /// The parent; the node's own id for a root.
    pub(crate) parent: NodeId,
    /// The first child. `None` for a cell of the cut.
    pub(crate) first_child: Option<NodeId>,
    pub(crate) children: u8,
    /// The most light that a ray brings to the node, as a weight (see [`visibility`](crate::visibility)); 0 where no ray comes.
    pub(crate) weight: u8,
    /// The volumes for which the node is in the frustum and not empty.
    pub(crate) visible: Members,
}

/// The [weight](Node::weight) of a node that is seen in the open, or about which nothing is known.
pub(crate) const OPEN: u8 = 9;

impl Node {
    pub(crate) fn is_cell(&self) -> bool {
        self.first_child.is_none()
    }

    /// The ids of the node's children.
    pub(crate) fn children(&self) -> impl Iterator<Item = NodeId> + use<> {
        NodeId::range(self.first_child.unwrap_or(self.parent), self.children as usize)
    }

    /// The volumes for which the node is visible and not hidden.
    pub(crate) fn seen(&self) -> Members {
        if self.weight > 0 { self.visible } else { 0 }
    }
}

/// An octree cut of a volume: the cells that a view wants, among cells that cover the rest.
#[derive(Clone, Debug)]
pub struct Cut {
    pub(crate) view: View,
    /// The tree, which other volumes may share.
    pub(crate) nodes: Arc<Vec<Node>>,
    /// The volume's own bit among those that share the tree.
    pub(crate) member: Members,
    /// The number of roots, which are the first nodes.
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

    /// The cells that the view wants, in no particular order: those in its frustum that are not empty and not known to be hidden.
    pub fn cells(&self) -> impl Iterator<Item = BrickId> {
        self.wanted_cells().map(|node| self.id(node))
    }

    /// The number of cells that the view wants.
    pub fn wanted(&self) -> usize {
        self.wanted
    }

    /// The largest screen-space error among wanted cells that a finer level could still improve, in pixels; 0 where all are
    /// at the finest level, infinite where the eye is inside such a cell.
    pub fn effective_error_px(&self) -> f64 {
        self.effective_error_px
    }

    /// Whether the cut would be finer if more cells fitted.
    pub fn memory_bound(&self) -> bool {
        self.memory_bound
    }

    /// Whether another volume's cut is made of the same tree as this one.
    pub(crate) fn shares_tree_with(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.nodes, &other.nodes)
    }

    /// Whether a node is in the frustum and not empty.
    pub(crate) fn is_visible(&self, node: NodeId) -> bool {
        self[node].visible & self.member != 0
    }

    /// Whether a node is in the frustum and not empty, but hidden behind something that lets no light through.
    pub(crate) fn is_hidden(&self, node: NodeId) -> bool {
        self.is_visible(node) && self[node].weight == 0
    }

    /// Whether a node is a cell that is visible and not hidden.
    pub(crate) fn is_wanted(&self, node: NodeId) -> bool {
        self[node].is_cell() && self[node].seen() & self.member != 0
    }

    /// The ids of all nodes, parents before children.
    pub(crate) fn ids(&self) -> impl Iterator<Item = NodeId> + use<> {
        NodeId::range(NodeId(0), self.nodes.len())
    }

    /// A node, its parent, and so on up to a root.
    pub(crate) fn path_to_root(&self, node: NodeId) -> impl Iterator<Item = NodeId> {
        let parent = |&node: &NodeId| Some(self[node].parent).filter(|parent| *parent != node);
        std::iter::successors(Some(node), parent)
    }

    /// The wanted cells, coarse first.
    pub(crate) fn wanted_cells(&self) -> impl Iterator<Item = NodeId> {
        self.ids().filter(|&node| self.is_wanted(node))
    }

    pub(crate) fn id(&self, node: NodeId) -> BrickId {
        self.view.id(self[node].level, self[node].index)
    }
}

/// All bricks of the coarsest level.
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
