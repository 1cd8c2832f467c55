//! Sight: what a frame's own view sees of a cut, which may have been made for an earlier one.
//!
//! The cells of a cut cover the volume, so those in the view's frustum that are not empty under its transfer function are all
//! there is to draw. Two eyes see the same cells, each in an order of its own: so all that is decided of cells, what is wanted,
//! resident, drawn with what, is decided once for both. Cost: one pass over the part of the tree in the frustum; nothing while
//! neither view nor cut change.

use crate::cut::{Cut, Node, View};
use crate::order;
use crate::source::BrickSource;
use brickyard_volume::{Placement, ViewRays};
use glam::DVec3;

/// The visible cells of a cut.
#[derive(Clone, Debug)]
pub(crate) struct Sight {
    /// Positions in the cut's arena, back to front.
    pub(crate) cells: Vec<u32>,
    /// The same positions, back to front for the view's other eye, if it has one.
    pub(crate) for_other_eye: Option<Vec<u32>>,
    /// Share of the picture that each covers, in arbitrary but common units.
    pub(crate) areas: Vec<f64>,
    /// Whether the cut was made for this view.
    pub(crate) is_planned: bool,
}

impl Sight {
    /// What `view` sees of `cut`, which must be of the same time step and channel.
    pub(crate) fn new(source: &dyn BrickSource, cut: &Cut, view: &View) -> Self {
        let is_planned = cut.view == *view;
        let frusta = view.frusta();
        let is_visible = |node: &Node| {
            if is_planned {
                return node.is_visible;
            }
            let is_in_sight = frusta.meet_box(node.low, node.high) && view.is_inside_clip(node.low, node.high);
            is_in_sight && view.shows(source, view.id(node.level, node.index))
        };
        let placement = &view.placement;
        let (pyramid, geometry) = (source.pyramid(), source.geometry());
        let ordered = |rays: &ViewRays| order::back_to_front(pyramid, geometry, (rays, placement), cut, is_visible);
        let (cells, for_other_eye) = (ordered(&view.rays), view.other_eye.as_ref().map(ordered));
        let area = |&cell: &u32| view.eyes().map(|rays| screen_area(rays, placement, &cut.nodes[cell as usize])).sum();
        let areas = cells.iter().map(area).collect();
        Self { cells, for_other_eye, areas, is_planned }
    }
}

/// A box's silhouette: pixels times a constant.
fn screen_area(rays: &ViewRays, placement: &Placement, &Node { low, high, .. }: &Node) -> f64 {
    // Of a placed box, that of the box around it.
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
