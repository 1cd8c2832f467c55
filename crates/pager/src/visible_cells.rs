//! Visible cells of a cut, possibly made for an earlier view, in a frame's own view.
//!
//! Cuts cover the volume, so the cells to draw are those in the view's frustum and not empty under its transfer function. Volumes
//! sharing a tree are handled together, so their ranks are in one order. Two eyes see the same cells, each in its own order; all other
//! decisions on cells (wanted, resident, drawn with which brick) are shared. Costs one pass over the part of the tree in the frustum;
//! nothing while neither view nor cut change.

use crate::cut::{Cut, Members, Node, NodeId, View};
use crate::order;
use crate::source::BrickSource;
use crate::split::{by_volume, groups};
use brickyard_volume::{Placement, ViewRays};
use glam::DVec3;
use std::sync::Arc;

/// The cells of a cut visible to a view.
#[derive(Clone, Debug)]
pub(crate) struct VisibleCells {
    /// Back to front.
    pub(crate) cells: Vec<Ranked>,
    /// Back to front for the other eye; `None` for a single eye.
    pub(crate) for_other_eye: Option<Vec<Ranked>>,
    /// Screen area of each visible cell, over all eyes, in an arbitrary but common unit.
    pub(crate) areas: Vec<f64>,
    /// Whether the cut was made for this view.
    pub(crate) is_planned: bool,
    /// Index of the first volume whose cells share a ranking with these.
    pub(crate) first: usize,
}

/// A cell, and its back-to-front position over all volumes sharing its tree.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Ranked {
    pub(crate) cell: NodeId,
    pub(crate) rank: u32,
}

/// A viewed volume: its cut and its view.
#[derive(Clone, Copy)]
struct Looked<'a> {
    source: &'a dyn BrickSource,
    cut: &'a Cut,
    view: &'a View,
}

impl<'a> Looked<'a> {
    fn is_planned(&self) -> bool {
        self.cut.view == *self.view
    }

    fn sees(self) -> impl Fn(&Node) -> bool + 'a {
        let Self { source, cut, view } = self;
        let (is_planned, frusta) = (self.is_planned(), view.frusta());
        move |node| {
            if is_planned {
                return node.visible & cut.member != 0;
            }
            frusta.meet_box(node.low, node.high)
                && view.shows(source, view.id(node.level, node.index), (node.low, node.high))
        }
    }
}

impl VisibleCells {
    /// Cells of `cut` visible to `view`, of the same time step and channel.
    pub(crate) fn new(source: &dyn BrickSource, cut: &Cut, view: &View) -> Self {
        of_tree(&[Looked { source, cut, view }], 0).swap_remove(0)
    }

    /// Cells of each volume's cut visible to its view, of the same time step and channel.
    pub(crate) fn all(sources: &[Arc<dyn BrickSource>], cuts: &[Arc<Cut>], views: &[View]) -> Vec<Self> {
        let looked =
            sources.iter().zip(cuts).zip(views).map(|((source, cut), view)| Looked { source: &**source, cut, view });
        let volumes: Vec<Looked<'_>> = looked.collect();
        let groups = groups(&volumes, |a, b| {
            a.cut.shares_tree_with(b.cut) && (a.view.placement, a.view.rays) == (b.view.placement, b.view.rays)
        });
        let sights = groups.iter().map(|members| {
            let looked: Vec<Looked<'_>> = members.iter().map(|&i| volumes[i]).collect();
            of_tree(&looked, members[0])
        });
        by_volume(&groups, sights)
    }
}

/// Visible cells of a shared tree, for volumes in one place with the same eyes.
fn of_tree(volumes: &[Looked<'_>], first: usize) -> Vec<VisibleCells> {
    let sees: Vec<_> = volumes.iter().map(|volume| volume.sees()).collect();
    let visible = |node: &Node| sees.iter().zip(0..).fold(0, |all, (sees, i)| all | (sees(node) as Members) << i);
    let Looked { source, cut, view } = volumes[0];
    let placement = &view.placement;
    let ordered = |rays: &ViewRays| order::back_to_front(source, rays, placement, cut, visible);
    let (order, for_other_eye) = (ordered(&view.rays), view.other_eye.as_ref().map(ordered));
    let area = |ranked: &Ranked| view.eyes().map(|rays| screen_area(rays, placement, &cut[ranked.cell])).sum();
    let sight = |(volume, member): (&Looked<'_>, u32)| {
        let own = |order: &[(NodeId, Members)]| -> Vec<Ranked> {
            let ranked = order.iter().zip(0..).filter(|((_, members), _)| members >> member & 1 != 0);
            ranked.map(|(&(cell, _), rank)| Ranked { cell, rank }).collect()
        };
        let (cells, for_other_eye) = (own(&order), for_other_eye.as_deref().map(own));
        let areas = cells.iter().map(area).collect();
        VisibleCells { cells, for_other_eye, areas, is_planned: volume.is_planned(), first }
    };
    volumes.iter().zip(0..).map(sight).collect()
}

/// Area of a box's silhouette: pixels times a constant.
fn screen_area(rays: &ViewRays, placement: &Placement, &Node { low, high, .. }: &Node) -> f64 {
    // For a placed box, that of its bounding box.
    let (low, high) = placement.world_box((low, high));
    let size = high - low;
    let faces = DVec3::new(size.y * size.z, size.z * size.x, size.x * size.y);
    if rays.orthographic {
        return rays.forward.abs().dot(faces);
    }
    let to_centre = (low + high) * 0.5 - rays.eye;
    // Nearer than its own radius the box fills the picture; the clamp keeps that finite.
    let distance = to_centre.length().max(size.length() * 0.5);
    (to_centre / distance).abs().dot(faces) / (distance * distance)
}
